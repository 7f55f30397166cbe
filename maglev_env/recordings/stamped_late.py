"""Do the time stamps jitter because the samples do, or were regular samples stamped when they were written?"""

from collections.abc import Iterable

import numpy as np

_NEIGHBOURS = np.array([-2, -1, 1, 2])
_TOLD = 4.0  # standard errors from which the readings decide
_FEWEST = 100


def regular_stamps(time: np.ndarray, channels: Iterable[np.ndarray]) -> np.ndarray | None:
    """The stamps of a regular clock, where the readings show that the samples were taken by one.

    A reading that moves smoothly lies near the cubic through its neighbours, if these are placed where they were taken.
    Each sample is predicted once at the stamps and once at regular instants; the placing that predicts better is right.
    Noise spoils both alike: each error is divided by what noise of one size makes of it.

    Args:
        time: s, (samples,), rising.
        channels: readings (samples,) in any units.

    Returns:
        Stamps (samples,), with gaps where samples are missing; None where the readings jitter, too, or do not tell.
    """
    steps = np.diff(time)
    usual = float(np.median(steps)) if steps.size else 0.0
    if not usual > 0 or (steps <= 0).any() or steps.max() / usual > time.size:
        return None
    counts = np.concatenate([[0.0], np.cumsum(np.maximum(np.rint(steps / usual), 1))])
    step, begin = np.polyfit(counts, time, 1)
    whole = np.convolve(np.diff(counts, prepend=counts[0] - 1) == 1, np.ones(5), "same") > 4.5  # no gap nearby
    at = np.flatnonzero(whole[2:-2]) + 2
    if at.size < _FEWEST:
        return None
    told = max((_better_regular(counts, time / step, values, at) for values in channels), key=abs, default=0.0)
    return begin + step * counts if told > _TOLD else None


def _better_regular(regular: np.ndarray, stamped: np.ndarray, values: np.ndarray, at: np.ndarray) -> float:
    """By how many standard errors regular instants predict the samples `at` better than their stamps do."""
    gained = _errors(stamped, values, at) ** 2 - _errors(regular, values, at) ** 2
    off = gained - gained.mean()
    # Neighbouring errors share samples, so their products are counted, too.
    shared = sum(2 * float(off[k:] @ off[:-k]) for k in range(1, _NEIGHBOURS.size + 1))
    power = float(off @ off)
    return float(gained.sum() / np.sqrt(max(power + shared, power))) if power else 0.0


def _errors(instants: np.ndarray, values: np.ndarray, at: np.ndarray) -> np.ndarray:
    """What samples differ by from the cubic through two neighbours on either side, in units of its noise, (at,)."""
    near = at[:, None] + _NEIGHBOURS
    apart = instants[near] - instants[at][:, None]
    weights = np.ones(near.shape)
    for one in range(_NEIGHBOURS.size):
        for other in range(_NEIGHBOURS.size):
            if one != other:
                weights[:, one] *= apart[:, other] / (apart[:, other] - apart[:, one])
    return (values[at] - (weights * values[near]).sum(axis=1)) / np.sqrt(1 + (weights**2).sum(axis=1))
