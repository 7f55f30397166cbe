"""Stability margins of a loop from its measured sensitivity, with intervals.

A sensitivity S = 1 / (1 + L) measured on a running loop belongs to a stable closed loop, so every crossing of L is a
distance to instability. Nothing is known outside the excited lines; a margin that is not found there is missing, with a
reason.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy
from numpy.typing import ArrayLike, NDArray

from estimation.lines.curves import Crossings, crossings, largest, refine, refined_parts, smooth_response

CONFIDENCE = 0.95
MISSING_SHARE = 0.05  # an interval end is withheld when the margin is absent in a larger share of the draws

Array = NDArray[np.float64]
Interval = tuple[float | None, float | None]


TOGETHER = 32  # loops
ALONG = 2.0  # standard deviations of Im L within which L may cross the real axis
# Largest standard error of L at lines that tell it: this share of |L|, and as much of SMALL where |L| is smaller, so
# that noise does not make |L| = 1 on one of hundreds of lines. Near a peak of |S| lines tell L well whose S is noisy,
# because L is near -1 there and its error is that of S over |S|^2.
TOLD, SMALL = 0.3, 0.4
FEWEST = 4  # lines that a curve can be laid through
UNRESOLVED = 1.5  # a peak higher than this many times its nearest lines comes from the interpolation


@dataclass(frozen=True)
class Margins:
    """Margins of one loop; None where the lines hold none.

    Lines that do not tell the loop gain from noise are left out. The upper gain margin is that of a smooth curve
    through the lines, if that has one, and there is no lower one where that curve has none. Noise biases the other
    values to the cautious side (peaks up, margins down). The intervals allow for that, so a value may lie at the end of
    its own interval. A peak at the first or last line is reported with a reason, because it bounds the true peak from
    one side only.

    Attributes:
        peak_sensitivity: Largest |S|.
        gain_margin_high: Factor > 1 by which the loop gain may rise.
        gain_margin_low: Largest factor < 1 to which the loop gain may fall (loops around an unstable plant have one).
        phase_margin: Smallest phase change of either sign that brings L to -1, deg.
        delay_margin: Smallest added delay that brings L to -1, s.
        disk_margin: 1 / max |S - 1/2|, the balanced disk margin (skew 0).
        peak_frequency: Frequency of the peak, Hz; each margin has its frequency in a field of the same form.
        reasons: Why a value is missing or bounds the true one from one side only, by field name.
        intervals: 95 % intervals (low, high) by name, for the six quantities and peak_frequency. An end is None where
            the lines do not bound it; empty without draws.
    """

    peak_sensitivity: float
    peak_frequency: float
    gain_margin_high: float | None
    gain_margin_high_frequency: float | None
    gain_margin_low: float | None
    gain_margin_low_frequency: float | None
    phase_margin: float | None
    phase_margin_frequency: float | None
    delay_margin: float | None
    delay_margin_frequency: float | None
    disk_margin: float
    disk_margin_frequency: float
    reasons: Mapping[str, str]
    intervals: Mapping[str, Interval]


def loop_gain(sensitivity: ArrayLike) -> NDArray[np.complex128]:
    """Loop gain L = 1 / S - 1 of complex sensitivities (...).

    Raises:
        ValueError: S is zero or not finite.
    """
    s = np.asarray(sensitivity, dtype=np.complex128)
    if not np.all(np.isfinite(s)) or np.any(s == 0):
        raise ValueError("sensitivity must be finite and not zero; leave out lines without a value")
    return np.asarray(1 / s - 1, dtype=np.complex128)


def peak_sensitivity(frequency: ArrayLike, sensitivity: ArrayLike) -> tuple[Array, Array]:
    """Largest |S| and its frequency in Hz, each (...), of many loops; the same numbers as in `margins`.

    L is interpolated by a cubic spline in log frequency (`estimation.lines.curves`).

    Args:
        frequency: Increasing frequencies (n,), Hz, n >= 4.
        sensitivity: Complex sensitivities (..., n).

    Raises:
        ValueError: Bad input.
    """
    return _peak(*_refined(frequency, sensitivity))


def margin_arrays(frequency: ArrayLike, sensitivity: ArrayLike) -> dict[str, Array]:
    """Margins of many loops: the numeric fields of `Margins` by name, each (...), nan where missing.

    The lines are taken as free of noise: an upper gain margin is then too low where noise crosses the real axis;
    `margins` smooths before.

    Args:
        frequency: Increasing frequencies (n,), Hz, n >= 4.
        sensitivity: Complex sensitivities (..., n).

    Raises:
        ValueError: Bad input.
    """
    gain = _checked_gain(frequency, sensitivity)
    grid, curves = refined_parts(frequency, gain.reshape(-1, gain.shape[-1]), TOGETHER)
    parts = [margins_of_curves(grid, curve) for curve in curves]
    return {name: np.concatenate([part[name] for part in parts]).reshape(gain.shape[:-1]) for name in parts[0]}


def margins_of_curves(grid: Array, gain: NDArray[np.complex128]) -> dict[str, Array]:
    """As `margin_arrays`, of loop gains (..., m) that are known so closely that nothing is laid through them.

    Args:
        grid: Increasing logarithms of frequencies in Hz, (m,).
        gain: Loop gains.
    """
    re, im = gain.real, gain.imag
    out: dict[str, Array] = {}
    out["peak_sensitivity"], out["peak_frequency"] = _peak(grid, gain)
    found, factors = _gain_crossings(grid, gain)
    for name, factor in factors.items():
        out[name], out[f"{name}_frequency"] = found.least(factor, factor)
    out["gain_margin_low"] = 1 / out["gain_margin_low"]
    found = crossings(grid, re**2 + im**2 - 1, re, im)
    re_at, im_at = found.others
    lag = np.arctan2(-im_at, -re_at)  # phase of -L, the phase lag that brings L to -1
    out["phase_margin"], out["phase_margin_frequency"] = found.least(np.degrees(np.abs(lag)), np.abs(lag))
    delay = lag % (2 * np.pi) / (2 * np.pi * np.exp(found.log_frequency))
    out["delay_margin"], out["delay_margin_frequency"] = found.least(delay, delay)
    # |S - 1/2| = |1 - L| / (2 |1 + L|)
    ratio, out["disk_margin_frequency"] = largest(grid, ((1 - re) ** 2 + im**2) / ((1 + re) ** 2 + im**2))
    out["disk_margin"] = 2 / np.sqrt(ratio)
    return out


def margins(
    frequency: ArrayLike,
    sensitivity: ArrayLike,
    variance: ArrayLike,
    draws: int = 2000,
    seed: int = 0,
    freedom: float = np.inf,
) -> Margins:
    """Margins of one loop with 95 % intervals by a seeded parametric bootstrap.

    Args:
        frequency: Increasing frequencies (n,), Hz, n >= 4.
        sensitivity: Complex sensitivity (n,).
        variance: Its variance E|noise|^2 (n,); the noise is circular complex Gaussian and independent between lines.
        draws: Number of bootstrap draws, at least 100; 0 for no intervals. All recordings share the draws of a seed, so
            that what too few of them get wrong in the ends is wrong everywhere: 400 cover a percent more or less.
        seed: Seed of the draws.
        freedom: Degrees of freedom of the variance of neighbouring lines; infinite where it is known.

    Raises:
        ValueError: Bad input.
    """
    f, s = np.asarray(frequency, dtype=float), np.asarray(sensitivity, dtype=complex)
    noise = np.asarray(variance, dtype=float)
    if s.ndim != 1:
        raise ValueError("sensitivity must be one loop (n,); use margin_arrays for many")
    if noise.shape != s.shape or not np.all(np.isfinite(noise)) or np.any(noise < 0):
        raise ValueError(f"variance must hold {s.size} finite values >= 0, one per line")
    if draws != 0 and draws < 100:
        raise ValueError("draws must be 0 (no intervals) or at least 100")
    told = _told(s, noise)
    f, s, noise = f[told], s[told], noise[told]
    values = {name: float(value) for name, value in margin_arrays(f, s).items()}
    # Draws around the noisy estimate would add its bias a second time; the smoothed curve has almost none. L is
    # smoothed and not S, because L has no sharp peak; |dL| = |dS| / |S|^2.
    centre = _smoothed(f, loop_gain(s), noise / np.abs(s) ** 4)
    # Sizes of single lines as weights would pull the curve toward the lines that noise moved toward -1.
    centre = _smoothed(f, loop_gain(s), noise / np.abs(centre) ** 4)
    middle = {name: float(value) for name, value in margin_arrays(f, centre).items()}
    # Noise crosses the real axis wherever L is small, and the worst of such crossings is no margin of the loop.
    if not np.isnan(middle["gain_margin_high"]):
        values |= {name: middle[name] for name in ("gain_margin_high", "gain_margin_high_frequency")}
    if np.isnan(middle["gain_margin_low"]):
        values |= dict.fromkeys(("gain_margin_low", "gain_margin_low_frequency"), np.nan)
    reasons = _reasons(f, np.abs(s), values)
    intervals = _intervals(f, centre, noise, values, middle, _drawn(noise, draws, seed, freedom)) if draws else {}
    fields: dict[str, Any] = {name: None if np.isnan(value) else value for name, value in values.items()}
    return Margins(**fields, reasons=reasons, intervals=intervals)


def _told(s: NDArray[np.complex128], variance: Array) -> NDArray[np.bool_]:
    """Which lines (n,) tell a loop gain; all where too few do.

    Where S is lost in noise, L = 1 / S - 1 is any number, and a curve through such numbers crosses everything.
    """
    # The median of neighbours, as a line that chance made small is not to be picked by that.
    size, error = (
        scipy.ndimage.median_filter(own, 5, mode="nearest")
        for own in (np.abs(loop_gain(s)), np.sqrt(variance) / np.abs(s) ** 2)
    )
    told = error <= TOLD * np.maximum(size, SMALL)
    if told.sum() < FEWEST:
        return np.ones(s.size, bool)
    # Where noise grows past the limit, chance picks lines; a curve would swing across the gaps between the others.
    first, last = np.flatnonzero(told)[[0, -1]]
    told[first:last] |= size[first:last] < SMALL
    return told


def _smoothed(f: Array, gain: NDArray[np.complex128], variance: Array) -> NDArray[np.complex128]:
    """The sensitivity (..., n) of smooth loop gains through gains (..., n) with a variance (n,)."""
    return 1 / (1 + smooth_response(f, gain, variance))


def _refined(frequency: ArrayLike, sensitivity: ArrayLike) -> tuple[Array, NDArray[np.complex128]]:
    return refine(frequency, _checked_gain(frequency, sensitivity))


def _checked_gain(frequency: ArrayLike, sensitivity: ArrayLike) -> NDArray[np.complex128]:
    """Loop gains (..., n) at the lines, which curves are laid through."""
    # L is interpolated and not S: near a sharp peak of S, L is still smooth. For peaks of 8 to 15 at lines 5 Hz apart
    # the error is 0.03 % instead of 8 %.
    gain = loop_gain(sensitivity)
    if gain.ndim == 0 or gain.shape[-1] != np.size(frequency):
        raise ValueError(f"sensitivity must have {np.size(frequency)} lines in its last dimension, one per frequency")
    return gain


def _peak(grid: Array, gain: NDArray[np.complex128]) -> tuple[Array, Array]:
    top, at = largest(grid, -((1 + gain.real) ** 2 + gain.imag**2))
    return 1 / np.sqrt(-top), at


def _gain_crossings(grid: Array, gain: NDArray[np.complex128]) -> tuple[Crossings, dict[str, Array]]:
    """Crossings of the real axis, and at each the gain factor to instability per side (greater than 1; inf: none)."""
    found = crossings(grid, gain.imag, gain.real)
    (re_at,) = found.others
    high = np.divide(-1, re_at, out=np.full_like(re_at, np.inf), where=(re_at < 0) & (re_at > -1))
    return found, {"gain_margin_high": high, "gain_margin_low": np.where(re_at < -1, -re_at, np.inf)}


def _drawn(variance: Array, draws: int, seed: int, freedom: float) -> NDArray[np.complex128]:
    """Noise (draws, n), as large in each draw as its true variance may be, given one of so many degrees of freedom."""
    rng = np.random.default_rng(seed)
    parts = rng.standard_normal((2, draws, variance.size)) * np.sqrt(variance / 2)
    # A margin depends on lines that lie close together, and their variances are estimated together.
    larger = np.sqrt(freedom / rng.chisquare(freedom, (draws, 1))) if np.isfinite(freedom) else 1.0
    return np.asarray((parts[0] + 1j * parts[1]) * larger, dtype=np.complex128)


def _quantiles(values: Array) -> tuple[float, float]:
    present = values[~np.isnan(values)]
    if present.size == 0:
        return np.nan, np.nan
    # Of n draws another one lies below the k-th with probability k / (n + 1); by the usual quantiles, which place the
    # ends at the extreme draws, 400 of them would cover half a percent too little.
    low, high = np.quantile(present, [(1 - CONFIDENCE) / 2, (1 + CONFIDENCE) / 2], method="weibull")
    return float(low), float(high)


def _intervals(
    f: Array,
    centre: NDArray[np.complex128],
    variance: Array,
    values: Mapping[str, float],
    middle: Mapping[str, float],
    noise: NDArray[np.complex128],
) -> dict[str, Interval]:
    """Intervals from draws of the noise around the smoothed sensitivity `centre`, whose margins are `middle`."""
    of_gain = variance / np.abs(centre) ** 4
    drawn = _drawn_margins(f, centre, of_gain, middle, noise)
    ends: dict[str, tuple[float, float]] = {}
    for name in ("peak_sensitivity", "peak_frequency", "phase_margin", "delay_margin", "disk_margin"):
        # The draws are reflected in the logarithm, which subtracts the bias that they show.
        low, high = _quantiles(drawn[name])
        scale = values[name] * middle[name]
        ends[name] = scale / high, scale / low
    ends["gain_margin_high"] = _quantiles(drawn["gain_margin_high"])
    near, far = _quantiles(drawn["nearest_below"])[0], _quantiles(drawn["furthest_below"])[1]
    ends["gain_margin_low"] = (1 / (np.nan if np.isnan(middle["gain_margin_low"]) else far), 1 / near)
    for name, (low, high) in ends.items():
        if np.mean(np.isnan(drawn[name])) > MISSING_SHARE:
            ends[name] = (np.nan, high) if name == "gain_margin_low" else (low, np.nan)
    if _at_edge(f, values["peak_frequency"]):
        ends["peak_sensitivity"], ends["peak_frequency"] = (ends["peak_sensitivity"][0], np.nan), (np.nan, np.nan)
    if _at_edge(f, values["disk_margin_frequency"]):
        ends["disk_margin"] = (np.nan, ends["disk_margin"][1])
    # The loop gain vanishes at high frequencies, so |S| is 1 somewhere, and above 1 elsewhere (H. W. Bode); no phase is
    # further than half a turn away.
    ends["peak_sensitivity"] = (float(np.fmax(ends["peak_sensitivity"][0], 1.0)), ends["peak_sensitivity"][1])
    ends["phase_margin"] = (ends["phase_margin"][0], float(np.minimum(ends["phase_margin"][1], 180.0)))
    # A strongly biased value may lie outside its interval on the cautious side; the interval is then extended to it.
    return {
        name: (_known(np.minimum(low, values[name])), _known(np.maximum(high, values[name])))
        for name, (low, high) in ends.items()
    }


def _drawn_margins(
    f: Array,
    centre: NDArray[np.complex128],
    of_gain: Array,
    middle: Mapping[str, float],
    noise: NDArray[np.complex128],
) -> dict[str, Array]:
    """Margins (draws,) of the curves through `centre` and each noise; `of_gain` is the variance (n,) of L."""
    gain, at = loop_gain(centre + noise), middle["gain_margin_low_frequency"]
    low, high = _along_the_axis(f, loop_gain(centre), of_gain, at)

    def read(curve: NDArray[np.complex128]) -> dict[str, Array]:
        # Noise adds crossings: the near end takes the worst of each draw, the far end the best that may be the one of
        # the smooth curve, anywhere where that lies along the real axis within the noise.
        found, factors = _gain_crossings(grid, curve)
        factor, away = factors["gain_margin_low"], np.abs(found.log_frequency - np.log(at))
        inside = (found.log_frequency >= low) & (found.log_frequency <= high) & np.isfinite(factor)
        away = np.where(inside, -factor, np.where(np.isinf(factor), np.inf, away))
        ends = {"nearest_below": found.least(factor, factor)[0], "furthest_below": found.least(factor, away)[0]}
        return margins_of_curves(grid, curve) | ends

    grid, curves = refined_parts(f, gain, TOGETHER)
    parts = [read(curve) for curve in curves]
    drawn = {name: np.concatenate([part[name] for part in parts]) for name in parts[0]}
    # An upper gain margin is that of the smooth curve, and is drawn as that of smooth curves.
    drawn["gain_margin_high"] = margin_arrays(f, _smoothed(f, gain, of_gain))["gain_margin_high"]
    return drawn


def _along_the_axis(f: Array, gain: NDArray[np.complex128], variance: Array, crossing: float) -> tuple[float, float]:
    """Log frequencies around a crossing between which L lies along the real axis within its noise."""
    apart = f[np.abs(gain.imag) > ALONG * np.sqrt(variance / 2)]
    below, above = apart[apart < crossing], apart[apart > crossing]
    return np.log(below.max(initial=f[0])), np.log(above.min(initial=f[-1]))


def _known(end: float) -> float | None:
    return None if np.isnan(end) else float(end)


def _at_edge(f: Array, at: float) -> bool:
    return bool(np.any(np.isclose(at, f[[0, -1]], rtol=1e-9, atol=0)))


def _reasons(f: Array, gain: Array, values: Mapping[str, float]) -> dict[str, str]:
    band = f"between {f[0]:g} and {f[-1]:g} Hz"
    texts = {
        "gain_margin_high": f"the phase of L does not cross -180 deg with |L| < 1 {band}",
        "gain_margin_low": f"the phase of L does not cross -180 deg with |L| > 1 {band}",
        "phase_margin": f"|L| does not cross 1 {band}",
        "delay_margin": f"|L| does not cross 1 {band}",
    }
    reasons = {name: text for name, text in texts.items() if np.isnan(values[name])}
    if _at_edge(f, values["peak_frequency"]):
        reasons["peak_sensitivity"] = f"a lower bound: |S| is largest at an end of the lines {band}"
    else:
        i = int(np.clip(np.searchsorted(f, values["peak_frequency"]), 1, f.size - 1))
        nearest = gain[i - 1 : i + 1].max()
        if values["peak_sensitivity"] > UNRESOLVED * nearest:
            reasons["peak_sensitivity"] = (
                f"not resolved: |S| is {nearest:.3g} at the lines of {f[i - 1]:g} and {f[i]:g} Hz, and more is the "
                "curve between them; excite lines there"
            )
    if _at_edge(f, values["disk_margin_frequency"]):
        reasons["disk_margin"] = f"an upper bound: |S - 1/2| is largest at an end of the lines {band}"
    return reasons
