"""Whether stated probabilities are correct: reliability in bins and the expected calibration error."""

from dataclasses import dataclass

import numpy as np

BINS = 10


@dataclass(frozen=True)
class Reliability:
    """Reliability in each occupied bin of the stated probability.

    Attributes:
        stated: Mean stated probability (b,).
        right: Share that was right (b,).
        count: Number of cases (b,).
    """

    stated: np.ndarray
    right: np.ndarray
    count: np.ndarray


def reliability(top: np.ndarray) -> Reliability:
    """Reliability in bins of equal width over 0..1.

    Args:
        top: Stated probability, and 1 where it was right or 0, (n, 2).
    """
    which = np.minimum((top[:, 0] * BINS).astype(int), BINS - 1)
    count = np.bincount(which, minlength=BINS)
    stated, right = (np.bincount(which, top[:, column], BINS) for column in (0, 1))
    used = count > 0
    return Reliability(stated[used] / count[used], right[used] / count[used], count[used])


def calibration_error(top: np.ndarray) -> float:
    """Expected calibration error (Naeini et al. 2015): mean |share right - mean stated| over bins, weighted by count.

    The argument is that of `reliability`. In bins with few cases chance alone gives more than 0.
    """
    r = reliability(top)
    return float(np.abs(r.right - r.stated) @ r.count / r.count.sum())


def debiased_error(top: np.ndarray) -> float:
    """Root mean square calibration error without what chance alone gives (Kumar, Liang and Ma 2019).

    Of each bin's squared difference the variance of its share is taken away. What is left may fall below 0 by chance,
    and counts as 0 then. The argument is that of `reliability`.
    """
    r = reliability(top)
    share = np.where(r.count > 1, r.right, r.stated)  # one case alone tells nothing of its variance
    chance = share * (1 - share) / np.maximum(r.count - 1, 1)
    return float(np.sqrt(max(((r.right - r.stated) ** 2 - chance) @ r.count / r.count.sum(), 0.0)))
