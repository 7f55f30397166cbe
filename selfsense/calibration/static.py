"""Static calibration of a gap sensor, recorded or simulated: its line, linear range and saturation (D 6.4.2.2)."""

from dataclasses import dataclass
from math import ceil

import numpy as np
from numpy.typing import ArrayLike

from selfsense.sensor import SelfSensor, samples_and_periods
from selfsense.simulate import simulate
from selfsense.validity import AT_END, SETTLING, refuse_invalid

ROUNDING = 1e-9  # of the output's size, what its last digits may differ by


@dataclass(frozen=True)
class StaticCalibration:
    """The line output = gain * displacement + offset over linear_range, in the units given.

    Attributes:
        gain: Slope of the line.
        offset: Its offset.
        gain_se: Standard error of the gain.
        offset_se: Standard error of the offset.
        largest_deviation: Largest deviation from the line of a point in the range.
        linearity_error: That deviation as a share of full scale, which is gain times the width of the range.
        linear_range: Displacements over which the line holds.
        saturated_below: Displacement below which the output changes less than half as much as the line; None where
            the data do not show it.
        saturated_above: The same above the range.
    """

    gain: float
    offset: float
    gain_se: float
    offset_se: float
    largest_deviation: float
    linearity_error: float
    linear_range: tuple[float, float]
    saturated_below: float | None
    saturated_above: float | None


def static_calibration(
    displacement: ArrayLike, output: ArrayLike, tolerance: float = 0.01, rest: float | None = None
) -> StaticCalibration:
    """Fit a line to output over displacement, in the widest range in which it is linear within a tolerance.

    The standard errors come from the deviations, with n - 2 degrees of freedom and the range taken as given. Where
    noise alone reaches the tolerance, the range shrinks to what fits by chance.

    Args:
        displacement: Displacements (n,).
        output: Outputs (n,).
        tolerance: Largest deviation that counts as linear, as a share of full scale. 1 % lies between the reading
            errors of a dial gauge and a millivolt (D Table 6.1: 0.39 %) and the deviation of the first saturated
            point (8 %).
        rest: A displacement that the range must contain, by default the smallest.

    Raises:
        ValueError: The data do not fit, the output does not follow the displacement (`check_follows`), or no three
            displacements lie on a line this well.
    """
    x, y = _finite("displacement", displacement), _finite("output", output)
    if x.shape != y.shape:
        raise ValueError(f"displacement {x.shape} and output {y.shape} must have one value per point each")
    if not 0 < tolerance < 1:
        raise ValueError(f"tolerance = {tolerance} must be a share of full scale between 0 and 1")
    check_follows(y)
    order = np.argsort(x, kind="stable")
    x, y = x[order], y[order]
    rest = x[0] if rest is None else rest
    places = np.unique(x)
    windows = [(low, high) for low in places[places <= rest] for high in places[places >= rest]]
    for low, high in sorted(windows, key=lambda w: w[0] - w[1]):
        inside = (x >= low) & (x <= high)
        if np.unique(x[inside]).size < 3:
            continue
        gain, offset = np.polyfit(x[inside], y[inside], 1)
        deviation = y[inside] - gain * x[inside] - offset
        if abs(gain) * (high - low) <= ROUNDING * np.abs(y[inside]).max():
            continue  # the output stands still there: no sensor's line
        if np.abs(deviation).max() <= tolerance * abs(gain) * (high - low):
            break
    else:
        raise ValueError(
            f"no three displacements around {rest:g} lie on a line within {tolerance:.2g} of full scale; "
            "check the readings, or allow a larger tolerance"
        )
    spread = x[inside] - x[inside].mean()
    variance = deviation @ deviation / max(spread.size - 2, 1)
    gain_se = np.sqrt(variance / (spread @ spread))
    largest = float(np.abs(deviation).max())
    return StaticCalibration(
        float(gain),
        float(offset),
        float(gain_se),
        float(np.hypot(np.sqrt(variance / spread.size), gain_se * x[inside].mean())),
        largest,
        largest / float(abs(gain) * (high - low)),
        (float(low), float(high)),
        _saturated(x[::-1], y[::-1], low, gain),
        _saturated(x, y, high, gain),
    )


def check_follows(output: ArrayLike) -> None:
    """Raise ValueError if an output (n,) is the same at every displacement, but for rounding."""
    y = np.asarray(output, dtype=float)
    if np.ptp(y) <= ROUNDING * np.abs(y).max():
        raise ValueError(f"the output is {y[0]:g} throughout and does not follow the displacement; check the sensor")


def static_sweep(
    sensor: SelfSensor, gaps: ArrayLike, drive: float = 0.0, periods: int = 50, seed: int = 0
) -> np.ndarray:
    """Mean estimates (n,) m of a simulated sensor held at gaps (n,) m, over whole PWM periods, at least `periods`.

    A gap outside the estimator's range reads as the end of the range. The seed is that of the reading noise.

    Raises:
        ValueError: The estimate cannot be trusted for another reason.
    """
    gaps = _finite("gaps", gaps)
    if periods < 1:
        raise ValueError(f"periods = {periods}: the mean needs at least one PWM period")
    cycle, per_cycle = samples_and_periods(sensor)
    settling, kept = ceil(SETTLING * sensor.acquisition.rate), cycle * ceil(periods / per_cycle)
    sensors = [sensor] * gaps.size
    held = np.broadcast_to(gaps[:, None], (gaps.size, settling + kept))
    sensed = simulate(sensors, held, drive, seed=seed)
    refuse_invalid(sensed, sensors, settling, AT_END)
    return sensed.estimate[:, -kept:].mean(axis=1)


def _saturated(x: np.ndarray, y: np.ndarray, edge: float, gain: float) -> float | None:
    """Displacement from which on, outward from the linear range, the output always gains less than half of the line."""
    out = np.abs(x - x[-1]) <= abs(edge - x[-1])
    x, y = x[out], y[out]
    for k in range(x.size - 1):
        later = x != x[k]
        later[:k] = False
        if later.any() and np.all((y[later] - y[k]) / (gain * (x[later] - x[k])) < 0.5):
            return float(x[k])
    return None


def _finite(name: str, values: ArrayLike) -> np.ndarray:
    values = np.asarray(values, dtype=float)
    if values.ndim != 1 or values.size == 0 or not np.all(np.isfinite(values)):
        raise ValueError(f"{name} must be a one-dimensional array of finite numbers, not {values}")
    return values
