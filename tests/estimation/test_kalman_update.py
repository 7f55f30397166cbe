"""The update of a Kalman filter against filterpy's."""

import numpy as np
import pytest
from filterpy.kalman import KalmanFilter

from estimation.kalman_update import kalman_update


@pytest.mark.parametrize(("n", "m"), [(3, 1), (2, 2), (2, 5)])
def test_update_equals_that_of_filterpy(n, m):
    rng = np.random.default_rng(n + m)
    state, observed, root, noise = (rng.normal(size=shape) for shape in (n, (m, n), (n, n), (m, m)))
    covariance, noise, measured = root @ root.T, noise @ noise.T, rng.normal(size=m)
    theirs = KalmanFilter(n, m)
    theirs.x, theirs.P = state, covariance
    theirs.update(measured, R=noise, H=observed)
    x, p, spread = kalman_update(state, covariance, measured - observed @ state, observed, noise)
    np.testing.assert_allclose(x, theirs.x, rtol=1e-9)
    np.testing.assert_allclose(p, theirs.P, rtol=1e-9, atol=1e-12)
    np.testing.assert_allclose(spread, theirs.S, rtol=1e-9)
