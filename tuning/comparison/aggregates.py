"""Statistics of tuners over n rigs, with 95 % intervals (Agarwal et al., NeurIPS 2021: Deep RL at the edge of the
precipice).

In that work the tasks are fixed and the runs random, so runs are resampled within each task. Here the rigs are random
and a new rig is of interest, so whole rigs are resampled with all their repeats, and the same ones for every tuner.
"""

import numpy as np
import scipy

RESAMPLES = 2000
LEVEL = 0.95  # of the intervals
# Fewest rigs of which an interval of their middle is given. The median lies beyond all of n rigs with the chance 0.5^n
# on either side, so that even all that they span covers it too seldom: 94 % for 5 rigs, 50 % for 2.
LEAST = 6


def resamples(rigs: int, seed: int) -> np.ndarray:
    """Indices (RESAMPLES, rigs) of rigs drawn with replacement."""
    return np.random.default_rng(seed).integers(rigs, size=(RESAMPLES, rigs))


def median(values: np.ndarray, draws: np.ndarray) -> np.ndarray:
    """Median of all values (rigs, repeats) and the ends of its interval, (3,); nan for less than LEAST rigs."""
    return _of_enough(_with_ends(np.median(values), np.median(_drawn(values, draws), axis=1), len(values)), len(values))


def interquartile_mean(values: np.ndarray, draws: np.ndarray) -> np.ndarray:
    """Mean of the middle half of all values (rigs, repeats) and the ends of its interval, (3,), as of `median`."""
    redrawn = scipy.stats.trim_mean(_drawn(values, draws), 0.25, axis=1)
    return _of_enough(_with_ends(scipy.stats.trim_mean(values.ravel(), 0.25), redrawn, len(values)), len(values))


def performance_profile(values: np.ndarray, thresholds: np.ndarray, draws: np.ndarray) -> np.ndarray:
    """Share of values (rigs, repeats) below rising thresholds (m,), and pointwise ends of its interval, (3, m)."""
    value, low, high = _mean(np.mean(values[..., None] < thresholds, axis=1), draws)
    # A share below a threshold bounds those below all others on one side.
    return np.stack([value, np.minimum.accumulate(low[::-1])[::-1], np.maximum.accumulate(high)])


def improvement(one: np.ndarray, other: np.ndarray, draws: np.ndarray) -> np.ndarray:
    """Probability that `one` is below `other` on the same rig, and the ends of its interval, (3,).

    Every repeat is compared with every repeat; ties count half. Values are (rigs, repeats).
    """
    a, b = one[:, :, None], other[:, None, :]
    return _mean(np.mean((a < b) + 0.5 * (a == b), axis=(1, 2))[:, None], draws)[:, 0]


def _drawn(values: np.ndarray, draws: np.ndarray) -> np.ndarray:
    return values[draws].reshape(len(draws), -1)


def _mean(per_rig: np.ndarray, draws: np.ndarray) -> np.ndarray:
    """Mean over rigs of numbers (rigs, m) in [0, 1], with the ends of its interval, (3, m)."""
    n = len(per_rig)
    # Weights by how often each rig was drawn need far less memory than the draws themselves.
    weights = np.stack([np.bincount(row, minlength=n) for row in draws]) / n
    value, low, high = _with_ends(per_rig.mean(axis=0), weights @ per_rig, n)
    # Where all rigs agree, resampling shows no spread: use the ends of Clopper and Pearson (1934) for 0 or n out of n.
    least = ((1 - LEVEL) / 2) ** (1 / n)
    low, high = np.where(value == 1, least, np.fmax(low, 0)), np.where(value == 0, 1 - least, np.fmin(high, 1))
    return np.stack([value, low, high])


def _of_enough(found: np.ndarray, rigs: int) -> np.ndarray:
    """The same value, (3,), without ends where there are too few rigs."""
    return found if rigs >= LEAST else np.array([found[0], np.nan, np.nan])


def _with_ends(value: np.ndarray, redrawn: np.ndarray, rigs: int) -> np.ndarray:
    """Expanded percentiles (Hesterberg 2015, American Statistician 69), as plain ones are too narrow with few rigs.

    nan for one rig, which shows nothing about others.
    """
    if rigs < 2:
        return np.stack([value, np.full_like(value, np.nan), np.full_like(value, np.nan)])
    tail = scipy.stats.norm.cdf(-np.sqrt(rigs / (rigs - 1)) * scipy.stats.t.ppf((1 + LEVEL) / 2, rigs - 1))
    return np.stack([value, *np.percentile(redrawn, (100 * tail, 100 * (1 - tail)), axis=0)])
