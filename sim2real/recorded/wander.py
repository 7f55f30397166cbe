"""What changes slowly over the periods of a recording: straight lines over time, and a level that wanders."""

import numpy as np
import scipy.fft
from scipy import stats

LEAST = 3  # periods below which a level that wanders cannot be told from noise
LOWEST = 10  # lines of a period whose scatter is taken for that of its mean
SURELY = 1e-5  # probability that noise alone makes a level seem to wander


def straightened(periods: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The slope per period of values (P, ...) of each period, and the values without their straight line over time."""
    at = np.arange(len(periods)) - (len(periods) - 1) / 2
    slope = np.tensordot(at, periods, 1) / (at @ at)
    return slope, periods - periods.mean(axis=0) - np.multiply.outer(at, slope)


def without_wander(values: np.ndarray, per_period: int) -> np.ndarray:
    """Whole periods (axes, samples) without the straight line of a level that surely wanders.

    A ramp leaks into all lines of a period, most into the lowest. Its slope is that of the means of the periods, which
    the periodic part does not have. Values whose level stays are returned as they are.
    """
    count = values.shape[1] // per_period
    if count < LEAST:
        return values
    periods = values.reshape(len(values), count, per_period)
    lines = scipy.fft.rfft(periods, axis=2)[..., : LOWEST + 1].swapaxes(0, 1) / per_period
    slope, rest = straightened(lines)
    at, freedom = np.arange(count) - (count - 1) / 2, 2 * LOWEST * (count - 2)
    # Noise has at zero, where it is real, the power of that of a line, which is complex.
    sd = np.sqrt((abs(rest[..., 1:]) ** 2).sum(axis=(0, 2)) / (LOWEST * (count - 2)) / (at @ at))
    level = slope[:, 0].real
    wanders = abs(level) > stats.t.isf(SURELY / 2, freedom) * sd
    if not wanders.any():
        return values
    time = (np.arange(values.shape[1]) - (values.shape[1] - 1) / 2) / per_period
    return values - np.where(wanders, level, 0.0)[:, None] * time
