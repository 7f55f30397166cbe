"""Do the time stamps jitter because the samples do, or were regular samples stamped when they were written?"""

from collections.abc import Iterable

import numpy as np

# Weights of a sample and of its neighbours that cubics cancel in.
_CUBIC = np.array([1.0, -4.0, 6.0, -4.0, 1.0]) / 6
_TOLD = 0.15  # standard error of the share of the jitter that the readings show, from which it decides
_SHARE = 0.5


def regular_stamps(time: np.ndarray, channels: Iterable[np.ndarray]) -> np.ndarray | None:
    """The stamps of a regular clock, where the readings show that the samples were taken by one.

    A sample that is taken later by d reads v d more, with v the velocity. What a sample differs by from a cubic through
    its neighbours is regressed on that, for the jitter of all of them: the slope is 1 where the samples jitter as their
    stamps do, and 0 where only the stamps do, as those of a serial monitor.

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
    late = (time - begin) / step - counts  # in steps
    share, se = _shown(late - late.mean(), counts, channels)
    return begin + step * counts if se < _TOLD and share + 2 * se < _SHARE else None


def _shown(late: np.ndarray, counts: np.ndarray, channels: Iterable[np.ndarray]) -> tuple[float, float]:
    """Share of the jitter that readings show, and its standard error: of the reading that tells it best."""
    whole = np.convolve(np.diff(counts, prepend=counts[0] - 1) == 1, np.ones(7), "same") > 6.5  # no gap nearby
    best = (0.0, np.inf)
    for values in channels:
        x = np.convolve(np.gradient(values) * late, _CUBIC, "same")
        r = np.convolve(values, _CUBIC, "same")
        keep = whole.copy()
        keep[:4] = keep[-4:] = False
        x, r = x[keep], r[keep]
        power = float(x @ x)
        if not power or x.size < 100:
            continue
        share = float(r @ x) / power
        # Neighbouring differences share samples: the errors of the product are summed over them.
        product = (r - share * x) * x
        lagged = sum(2 * float(product[k:] @ product[:-k]) for k in range(1, _CUBIC.size))
        se = float(np.sqrt(max(product @ product + lagged, product @ product))) / power
        best = min(best, (share, se), key=lambda one: one[1])
    return best
