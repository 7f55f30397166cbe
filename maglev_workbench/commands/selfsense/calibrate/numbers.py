"""Numbers of calibrations for table, page and JSON: intervals, and the lag at a frequency."""

from math import sqrt
from typing import Any

import numpy as np
import scipy

from maglev_workbench.commands.selfsense.calibrate.sources import Dynamic, Static

MEASURED_AT, MEASURED_LAG = 150.0, 30.0  # Hz, degrees: what the dissertation measured
TOP_AT, TOP_LAG = 4000.0, 18.0  # and what it simulated
_NEAR = 0.05  # of a frequency, within which lines are averaged
_HIDDEN = 45.0  # degrees: a phase whose interval has a larger half width is not reported


def gain_interval(s: Static) -> tuple[float, float]:
    """95 % interval of the gain."""
    low, high = s.found.linear_range
    points = int(np.sum((s.displacement >= low) & (s.displacement <= high)))
    half = scipy.stats.t.ppf(0.975, max(points - 2, 1)) * s.found.gain_se
    return s.found.gain - half, s.found.gain + half


def deviation(s: Static) -> np.ndarray:
    """Output minus line, as a share of full scale, (n,)."""
    low, high = s.found.linear_range
    line = s.found.gain * s.displacement + s.found.offset
    return (s.output - line) / abs(s.found.gain * (high - low))


def half_widths(d: Dynamic) -> np.ndarray:
    """Half the 95 % interval of the real and of the imaginary part of the response at each line (n,)."""
    return scipy.stats.t.ppf(0.975, 2 * (d.periods - 1)) * d.found.standard_error / sqrt(2)


def surely_within(d: Dynamic) -> float:
    """Frequency (Hz) up to which, within the intervals, no line is 3 dB below the gain: the least bandwidth."""
    c = d.found
    doubtful = np.flatnonzero(np.abs(c.response) - half_widths(d) < c.gain / sqrt(2))
    last = doubtful[0] - 1 if doubtful.size else c.frequency.size - 1
    return float(c.frequency[last]) if last >= 0 else 0.0


def lag_at(d: Dynamic, frequency: float) -> tuple[float, float]:
    """Lag (degrees) at a frequency (Hz), and half the width of its 95 % interval, which is infinite if noise hides it.

    The lag is that of the lines within 5 % to either side. The phase of the fitted delay is removed first, so that the
    rest changes little and noise cannot cause an error of a full turn. The lines are then averaged with the
    displacement's power as weight. Weights from the variances over a few periods would favour lines that happen to
    scatter little, and the interval would be too narrow.
    """
    c = d.found
    f = c.frequency
    reach = min(_NEAR * frequency, frequency - f[0], f[-1] - frequency)
    near = np.abs(f - frequency) <= max(reach, np.abs(f - frequency).min())
    weight = d.power[near] / d.power[near].sum()
    mean = np.sum(weight * (c.polarity * c.response * np.exp(2j * np.pi * f * c.delay))[near])
    parts = (weight * c.standard_error[near]) ** 2
    # Satterthwaite: every line's variance has 2 (P - 1) degrees of freedom.
    freedom = 2 * (d.periods - 1) * parts.sum() ** 2 / max(np.sum(parts**2), np.finfo(float).tiny)
    half = scipy.stats.t.ppf(0.975, max(freedom, 1.0)) * sqrt(parts.sum() / 2) / abs(mean)
    lag = 360 * frequency * c.delay - np.degrees(np.angle(mean))
    return float(lag), float(np.degrees(np.arcsin(half))) if half < 1 else np.inf


def lags(d: Dynamic) -> dict[float, tuple[float, float]]:
    """`lag_at` the dissertation's frequencies, or at the highest line below both, if noise does not hide it."""
    f = d.found.frequency
    inside = [at for at in (MEASURED_AT, TOP_AT) if f[0] <= at <= f[-1]] or [float(f[-1])]
    found = {at: lag_at(d, at) for at in inside}
    return {at: (lag, half) for at, (lag, half) in found.items() if half < _HIDDEN}


def dynamic_json(d: Dynamic) -> dict[str, Any]:
    """A dynamic calibration as JSON data, SI and degrees."""
    c = d.found
    return {
        "name": d.name,
        "periods": d.periods,
        "delay": c.delay,
        "delay_interval": [c.delay_low, c.delay_high],
        "gain": c.gain,
        "polarity": c.polarity,
        "bandwidth": c.bandwidth,
        "surely_within": surely_within(d),
        "lags": [{"frequency": f, "lag": lag, "half_width": half} for f, (lag, half) in lags(d).items()],
        "frequency": c.frequency,
        "magnitude": np.abs(c.response),
        "phase": np.degrees(np.angle(c.polarity * c.response)),
        "standard_error": c.standard_error,
    }


def static_json(s: Static) -> dict[str, Any]:
    """A static calibration as JSON data, in SI, or in the units of a table (null)."""
    return {
        "name": s.name,
        "quantities": [a.name for a in s.axes],
        "units": ["m" if a.unit else None for a in s.axes],
        "displacement": s.displacement,
        "output": s.output,
        "deviation": deviation(s),
        "gain": s.found.gain,
        "gain_interval": gain_interval(s),
        "offset": s.found.offset,
        "linearity_error": s.found.linearity_error,
        "largest_deviation": s.found.largest_deviation,
        "linear_range": s.found.linear_range,
        "saturated_below": s.found.saturated_below,
        "saturated_above": s.found.saturated_above,
    }
