"""Numbers that all estimators of normal errors share."""

NORMAL_95 = 1.959964  # standard errors on either side of a normal estimate that hold 95 %
NOISELESS = 1e-18  # relative power: a record without noise is weighted as if it had a relative noise of 1e-9
