"""By how much of a control period the command steps after the readings: what a controller takes to compute.

Channels that are read at the control ticks do not show it where only the current is recorded. Behind a lag of about a
control period it decides when the current between its readings flows, and so the damping. Where the command is recorded
too, its response to the current tells it.
"""

from math import sqrt

import numpy as np

from estimation.lines.periods import LineStatistics

UNKNOWN = 1 / sqrt(3)  # rms, in control periods, of a step that comes anywhere in the period after a reading
USUAL = 0.1  # relative standard deviation of an amplifier's time constant of which no tolerance is stated
STARTS, WHOLE = (0.1, 0.3, 0.5, 0.7, 0.9), (0, 1, 2)  # parts of a period from which a fit begins, beside whole periods
MISFIT = 25.0  # mean square of what a fit leaves, over its noise, from which another law made the current


def sampled_lag(x: np.ndarray, lag: float, late: float) -> np.ndarray:
    """Response (n,) of a first-order lag to a held command that steps after the readings, from sample to sample.

    Args:
        x: cycles per sample.
        lag: time constant, in samples.
        late: in samples, any number.
    """
    whole, part = divmod(late, 1.0)
    z, kept, fresh = np.exp(2j * np.pi * x), np.exp(-1 / lag), np.exp(-(1 - part) / lag)
    return (1 - fresh + (fresh - kept) / z) / (z - kept) * z**-whole


def flowing_lag(x: np.ndarray, lag: float, late: float) -> np.ndarray:
    """The same response in the continuous: what flows behind the lag, for one value of the command a sample."""
    return np.sinc(x) * np.exp(-1j * np.pi * x * (1 + 2 * late)) / (1 + 2j * np.pi * x * lag)


def behind_readings(lag: float, late: float) -> float:
    """By how many samples a slow current flows later than its readings show."""
    x = np.array([1e-4])
    return float(-np.angle(flowing_lag(x, lag, late) / sampled_lag(x, lag, late))[0] / (2 * np.pi * x[0]))


def step_after_reading(
    statistics: LineStatistics, sample_rate: float, lag: float, tolerance: float | None
) -> tuple[float, float]:
    """By how much of a control period the command steps after each reading, and its standard deviation.

    Args:
        statistics: with the channels "current" and, where it is recorded, "command".
        sample_rate: the control rate, Hz.
        lag: the amplifier's nominal time constant, s.
        tolerance: its relative standard deviation, None where it is not stated.

    Returns:
        0 and UNKNOWN where no command tells it.
    """
    if "command" not in statistics.channels or statistics.frequency.size < 2:
        return 0.0, UNKNOWN
    x, u, i = statistics.frequency / sample_rate, statistics.amplitude("command"), statistics.amplitude("current")
    own, shared = (np.real(statistics.cross(name, name)) for name in ("current", "command"))
    both = statistics.cross("current", "command")

    def left(p: np.ndarray) -> np.ndarray:
        response = p[0] * sampled_lag(x, lag * sample_rate * np.exp(p[2] * (tolerance or USUAL)), p[1])
        variance = own + abs(response) ** 2 * shared - 2 * np.real(np.conj(response) * both)
        least = 1e-12 * np.max(abs(i)) ** 2
        off = (i - response * u) / np.sqrt(np.maximum(variance, least) / 2)
        return np.concatenate([off.real, off.imag, p[2:]])

    from scipy.optimize import least_squares  # here because it takes long to import

    fits = [
        least_squares(left, [1.0, whole + start, 0.0], x_scale=[1.0, 0.1, 1.0]) for whole in WHOLE for start in STARTS
    ]
    best = min(fits, key=lambda fit: fit.cost)
    misfit = 2 * best.cost / (2 * x.size - 2)
    if not misfit <= MISFIT:
        return 0.0, UNKNOWN
    spread = np.sqrt(max(misfit, 1.0) * np.linalg.pinv(best.jac.T @ best.jac)[1, 1])
    return float(best.x[1] % 1.0), min(float(spread), UNKNOWN)
