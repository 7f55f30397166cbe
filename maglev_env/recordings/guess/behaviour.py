"""What the values of a column show without its name: time, steps, a derivative, two readings of one current."""

import numpy as np

from maglev_env.recordings.formats.time_stamps import rounded_step

MOST = 20_000  # samples that are looked at
_JITTER = 0.5  # largest rms deviation of a time step, of the median step
_FEW, _HELD = 8, 4  # values of a signal that switches between few, and samples for which it holds each
_LEVELS = 0.25  # share of samples at which a piecewise constant signal may change
_DERIVATIVE = 0.85  # correlation with the slope of another column
_MOST_LAG = 10  # samples by which a current follows its command
_ALIKE = 0.9  # correlation of two readings of the same quantity
_ONE_SIDED = 0.02  # of its largest value, that a current of one sign may read below zero


def is_time(values: np.ndarray) -> bool:
    """Whether the values (samples,) rise all the time with nearly equal steps."""
    steps = np.diff(values)
    if values.size < 8 or not (steps >= 0).all() or not (steps > 0).mean() > 0.9:
        return False
    middle = np.median(steps)
    return bool(np.mean(np.abs(steps - middle) <= _JITTER * middle) > 0.9) or rounded_step(values) is not None


def is_constant(values: np.ndarray) -> bool:
    """Whether all values (samples,) are the same."""
    return bool(values.size and values.min() == values.max())


def of_one_sign(values: np.ndarray) -> bool:
    """Whether the values (samples,) stay above zero, but for a little noise."""
    return bool(values.min() > -_ONE_SIDED * values.max())


def steps_in(values: np.ndarray) -> int:
    """Number of changes of a piecewise constant signal (samples,); 0 where it is none."""
    at = np.flatnonzero(np.diff(values))
    if not 0 < at.size < _LEVELS * values.size:
        return 0
    # Many changes are those of a random binary or a staircase signal if its values are few and hold for a while; a
    # converter's last digit flickers.
    held = at.size > 1 and np.unique(values).size <= _FEW and np.mean(np.diff(at) >= _HELD) > 0.95
    return int(at.size) if at.size <= max(8, values.size / 40) or held else 0


def correlation(a: np.ndarray, b: np.ndarray) -> float:
    """Correlation coefficient of two signals (samples,); 0 where one is constant."""
    a, b = a - a.mean(), b - b.mean()
    size = np.sqrt((a @ a) * (b @ b))
    return float(a @ b / size) if size else 0.0


def derivative_of(values: np.ndarray, others: dict[str, np.ndarray]) -> tuple[str, float]:
    """The column whose slope these values follow, with the correlation; "" where none is."""
    # The slope of a smooth signal only: differences of a noisy one are noise.
    found = {name: abs(correlation(values, np.gradient(_smooth(other)))) for name, other in others.items()}
    best = max(found, key=lambda name: found[name], default="")
    return (best, found[best]) if best and found[best] >= _DERIVATIVE else ("", 0.0)


def _smooth(values: np.ndarray, width: int = 3) -> np.ndarray:
    return np.convolve(values, np.full(width, 1 / width), "same")


def alike(a: np.ndarray, b: np.ndarray) -> float:
    """How far two signals (samples,) are the same quantity: their correlation at the best lag of a few samples, where
    level and size agree, else 0."""
    spread = max(a.std(), b.std())
    if not spread or min(a.std(), b.std()) < 0.3 * spread or abs(a.mean() - b.mean()) > spread:
        return 0.0
    lags = range(-_MOST_LAG, _MOST_LAG + 1)
    close = max(correlation(a[max(-k, 0) : a.size - max(k, 0)], b[max(k, 0) : b.size - max(-k, 0)]) for k in lags)
    return close if close >= _ALIKE else 0.0


def leads(a: np.ndarray, b: np.ndarray, most: int = 20) -> bool:
    """Whether the first signal (samples,) comes before the second."""
    most = min(most, a.size // 4)
    ahead = [correlation(a[: a.size - lag], b[lag:]) for lag in range(1, most + 1)]
    behind = [correlation(b[: a.size - lag], a[lag:]) for lag in range(1, most + 1)]
    return max(ahead, default=0.0) >= max(behind, default=0.0)


def roughness(values: np.ndarray) -> float:
    """Rms of the differences of neighbouring samples over the standard deviation: 2^0.5 for white noise, 0 for slow."""
    spread = values.std()
    return float(np.diff(values).std() / spread) if spread else 0.0
