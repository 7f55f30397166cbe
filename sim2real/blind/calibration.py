"""Whether stated probabilities are kept: reliability in bins and the expected calibration error."""

from dataclasses import dataclass

import numpy as np

BINS = 10


@dataclass(frozen=True)
class Reliability:
    """Per occupied bin of the stated probability, arrays (b,): mean stated, share right, and how many."""

    stated: np.ndarray
    right: np.ndarray
    count: np.ndarray


def reliability(top: np.ndarray) -> Reliability:
    """Bins of equal width over 0..1; top (n, 2): stated probability, and 1 where it was right, else 0."""
    which = np.minimum((top[:, 0] * BINS).astype(int), BINS - 1)
    count = np.bincount(which, minlength=BINS)
    stated, right = (np.bincount(which, top[:, column], BINS) for column in (0, 1))
    used = count > 0
    return Reliability(stated[used] / count[used], right[used] / count[used], count[used])


def calibration_error(top: np.ndarray) -> float:
    """Expected calibration error (Naeini et al. 2015): mean |share right - mean stated| over bins, weighted by count.

    top as in `reliability`. Chance alone gives more than 0 in bins with few cases.
    """
    r = reliability(top)
    return float(np.abs(r.right - r.stated) @ r.count / r.count.sum())
