"""Tones in what a simulation leaves of one record without a period: sinusoids that no drive and no transient explain.

A tone is fitted to the lines of each window as the transform of a sinusoid over the whole record, beside all that what
drives the record may explain there by a smooth response, and beside transient and drift. It counts as found where it
stands so far above what is left of its own window that noise alone would do so in a share `FALSE_ALARM` of records. A
resonance that a model lacks spreads over several lines, which are then no noise of its window, and does not pass.
Where a nonlinear loop answers to a few sines that drive it, nothing is looked for (see `distortion`).
"""

from dataclasses import dataclass, replace

import numpy as np
from scipy import stats
from scipy.optimize import minimize_scalar

from estimation.lines.line_windows import KEPT, WIDTH
from estimation.lines.tones import FALSE_ALARM, Tone
from maglev_env.experiment import Experiment
from maglev_env.linear.poles import closed_loop_poles
from sim2real.compared.distortion import COMMON, distorted
from sim2real.compared.point import Point
from sim2real.compared.simulated import experiment_near, series_at
from sim2real.recorded.open_evidence import measured_series
from sim2real.recorded.open_loop import nominal_loop
from sim2real.recorded.open_record import OpenRecord
from sim2real.recorded.records import Record
from sim2real.recorded.ringing import driven_directions, ringing_directions
from sim2real.recorded.tones import origin, tone_lines, transform_of_tone

LIGHT, RINGING = 0.1, 0.25  # damping ratio of a mode that rings, and octaves from it within which it does
FINE = 0.5  # lines between frequencies that are tried
SLOWEST = 4.0  # turns in a record below which a drift may pass for a tone, and for the same one in two records
XATOL = {"xatol": 1e-3}  # lines to which the frequency of a tone is refined


@dataclass(frozen=True)
class Residual:
    """What a simulation leaves of an open record's displacement, opened.

    Args:
        record: the record.
        lines: (axes, windows, KEPT), its coordinates.
        driven: (windows, KEPT, directions), orthonormal or zero: what the drives, and how the plant rings, may explain.
        rank: (windows,), how many of them are not zero.
        near: the record's experiment at the point of the simulation.
    """

    record: OpenRecord
    lines: np.ndarray
    driven: np.ndarray
    rank: np.ndarray
    near: Experiment

    def undriven(self) -> "Residual":
        """The same where the drives explain nothing, and the ringing alone does."""
        rung, rank = ringing_directions(self.record, self.near, self.driven[..., :0])
        return replace(self, driven=rung, rank=rank)


def residual_of(record: OpenRecord, point: Point) -> Residual | None:
    """What the simulation at a point leaves of a record; None where it touches down."""
    predicted = series_at(record, point)
    if not np.isfinite(predicted).all():
        return None
    off = measured_series(record) - predicted
    lines = record.windows.project(nominal_loop(record).opened(record, off[0], off[2], None)[0])
    driven, rank = driven_directions(record)
    at = experiment_near(record, point)
    beside, more = ringing_directions(record, at, driven)
    return Residual(record, lines, np.concatenate([driven, beside], axis=-1), rank + more, at)


def resolution_of(record: Record | OpenRecord) -> float:
    """Distance (Hz) of frequencies that a record tells apart; without a period, of its lines."""
    if isinstance(record, OpenRecord):
        return record.windows.sample_rate / record.windows.samples
    e = record.experiment
    return e.fundamental / (record.series["displacement"].shape[1] / e.recorded_per_period)


def strongest(residual: Residual) -> tuple[Tone | None, Residual]:
    """The strongest tone that is significant, and the residual without it."""
    tried = _all_tried(residual.record)
    if not tried.size:
        return None, residual

    def significant(line: float) -> bool:
        return _significant(residual, line, tried.size)

    likeliest = tried[int(np.argmin(log_chances(residual, tried * resolution_of(residual.record))))]
    refined = strongest_near(residual, float(likeliest), 2 * FINE)
    if not significant(refined):
        return None, residual
    # Where drives may explain most of a window, as those of two axes do, what is left of it tells a frequency badly.
    if 2 * residual.rank[_window(residual, np.array([refined]))[0]] > KEPT:
        again = strongest_near(residual.undriven(), refined, 2 * FINE)
        refined = again if significant(again) else refined
    return taken_out(residual, refined)


def strongest_near(residual: Residual, line: float, within: float) -> float:
    """Of lines within a distance of one, that at which a tone stands out most."""
    bounds = (line - within, line + within)
    return float(minimize_scalar(lambda f: log_chance(residual, f), bounds=bounds, method="bounded", options=XATOL).x)


def taken_out(residual: Residual, line: float) -> tuple[Tone, Residual]:
    """The tone at a line, and the residual without it."""
    frequency = line * resolution_of(residual.record)
    (amplitude,), (chi2,) = tones_in(residual, np.array([frequency]))
    tone = Tone(float(frequency), {"opened": amplitude}, float(chi2))
    return tone, replace(residual, lines=residual.lines - lines_of(residual, tone))


def lines_of(residual: Residual, tone: Tone) -> np.ndarray:
    """Coordinates (axes, windows, KEPT) of a tone."""
    w, amplitude = residual.record.windows, tone.amplitude["opened"]
    own = np.array([amplitude.real, -amplitude.imag])
    return np.einsum("ca,cwk->awk", own, w.project(tone_lines(w, tone.frequency)))


def tones_in(residual: Residual, frequencies: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Tones of known frequencies (n,), Hz, each alone and however small.

    Returns:
        amplitude: complex (n, axes), of the opened residual, m.
        chi2: (n,), its power over that of what is left around it, as a chi-square of two degrees of freedom per axis.
    """
    w = residual.record.windows
    line = np.asarray(frequencies) * w.samples / w.sample_rate
    own = _window(residual, line)
    around = w.first + own[:, None] * WIDTH + np.arange(WIDTH)
    c = transform_of_tone(around, line[:, None], w.samples) @ w.directions  # (2, n, KEPT)
    c = c if w.turned is None else np.einsum("pnk,nkl->pnl", c, np.conj(w.turned[own]))
    driven = residual.driven[own]
    y, c = (
        v - np.einsum("pnd,nkd->pnk", np.einsum("pnk,nkd->pnd", v, np.conj(driven)), driven)
        for v in (residual.lines[:, own], c)
    )
    freedom = KEPT - residual.rank[own]
    parts = np.moveaxis(np.concatenate([c.real, c.imag], axis=-1), 0, -1)  # (n, 2 KEPT, 2)
    target = np.moveaxis(np.concatenate([y.real, y.imag], axis=-1), 0, -1)  # (n, 2 KEPT, axes)
    coefficients = np.linalg.pinv(parts, rcond=1e-9) @ target  # (n, 2, axes)
    fitted = parts @ coefficients
    left = np.sum((target - fitted) ** 2, axis=(1, 2)) / np.maximum((2 * freedom - 2) * len(y), 1)
    chi2 = np.sum(fitted**2, axis=(1, 2)) / np.maximum(left, 1e-300)
    return coefficients[:, 0] - 1j * coefficients[:, 1], chi2


def _window(residual: Residual, line: np.ndarray) -> np.ndarray:
    w = residual.record.windows
    return np.clip((np.round(line).astype(int) - w.first) // WIDTH, 0, w.count - 1)


def log_chance(residual: Residual, line: float) -> float:
    return float(log_chances(residual, np.array([line * resolution_of(residual.record)]))[0])


def log_chances(residual: Residual, frequencies: np.ndarray) -> np.ndarray:
    """Logarithms (n,) of the probability that noise of the window of each frequency (Hz) shows as strong a tone."""
    _, chi2 = tones_in(residual, frequencies)
    w, axes = residual.record.windows, residual.record.axes
    freedom = 2 * (KEPT - residual.rank[_window(residual, frequencies * w.samples / w.sample_rate)]) - 2
    return stats.f.logsf(chi2 / (2 * axes), 2 * axes, np.maximum(freedom, 1) * axes)


def stands_out(residual: Residual, frequency: float) -> bool:
    """Whether a tone of a frequency (Hz) stands out of a residual as much as one that is searched for has to."""
    line = frequency / resolution_of(residual.record)
    return _significant(residual, line, max(_all_tried(residual.record).size, 1))


def _significant(residual: Residual, line: float, tried: int) -> bool:
    """Whether noise hardly ever shows as strong a tone as there is at a line on any of so many lines."""
    return log_chance(residual, line) + np.log(tried) <= np.log(FALSE_ALARM)


def _all_tried(record: OpenRecord) -> np.ndarray:
    """All lines (n,) of a record at which a tone is looked for."""
    w = record.windows
    return tried(record, np.arange(w.first, w.first + w.frequency.size - 1 + FINE, FINE))


def tried(record: OpenRecord, lines: np.ndarray) -> np.ndarray:
    """Those of lines (n,) at which a tone is looked for: not of drift, of ringing, or of the drive."""
    lines = lines[compared(record, lines)]
    lines = lines[~_ringing(record, lines * resolution_of(record))]
    return lines[~_of_the_drive(record, lines * resolution_of(record))]


def compared(record: OpenRecord, lines: np.ndarray) -> np.ndarray:
    """Whether lines (n,) are compared, and too fast for a drift."""
    w = record.windows
    return (lines >= max(w.first, SLOWEST)) & (lines <= w.first + w.frequency.size - 1 + FINE)


def _ringing(record: OpenRecord, frequency: np.ndarray) -> np.ndarray:
    """Whether frequencies (n,) are of no known origin and so near a lightly damped mode of the nominal loop that its
    ringing, which no drive explains smoothly, might pass for a tone there."""
    e = record.experiment
    poles = closed_loop_poles(e).astype(complex)
    poles = np.log(poles[poles != 0]) * e.rig.control_rate
    light = poles[(poles.imag > 0) & (abs(poles.real) < LIGHT * abs(poles))]
    near = np.zeros(frequency.size, bool)
    for pole in light:
        near |= abs(np.log2(2 * np.pi * frequency / abs(pole))) < RINGING
    for i in np.flatnonzero(near):
        near[i] = origin(float(frequency[i]), e.speed_rpm, resolution_of(record)) is None
    return near


def _of_the_drive(record: OpenRecord, frequency: np.ndarray) -> np.ndarray:
    """Whether a tone at frequencies (n,), Hz, is more likely made by the loop of the sines that drive it."""
    made = distorted(record, frequency)
    often = distorted(record, frequency, COMMON) if made.any() else made
    spacing = resolution_of(record)
    for i in np.flatnonzero(made & ~often):
        made[i] = origin(float(frequency[i]), record.experiment.speed_rpm, spacing) is None
    return made
