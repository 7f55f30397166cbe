"""Tones in a record without a period: sinusoids in its opened residual that no drive and no transient explain.

A tone is fitted to the lines of each window as the transform of a sinusoid over the whole record, beside all that what
drives the record may explain there by a smooth response, and beside transient and drift. It counts as found where it
stands so far above what is left of its own window that noise alone would do so in a share `FALSE_ALARM` of records. A
resonance that a model lacks spreads over several lines, which are then no noise of its window, and does not pass.
Where a nonlinear loop answers to a few sines that drive it, nothing is looked for (see `distortion`).
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import product

import numpy as np
from scipy import stats
from scipy.optimize import minimize_scalar

from estimation.lines.line_windows import KEPT, WIDTH
from estimation.lines.tones import FALSE_ALARM, MOST, Tone
from maglev_env.experiment import Experiment
from maglev_env.linear.poles import closed_loop_poles
from sim2real.compared.distortion import COMMON, distorted
from sim2real.compared.point import NOMINAL, Point
from sim2real.compared.simulated import experiment_near, series_at
from sim2real.recorded.open_evidence import measured_series
from sim2real.recorded.open_loop import nominal_loop
from sim2real.recorded.open_record import OpenRecord
from sim2real.recorded.records import Record
from sim2real.recorded.ringing import driven_directions, ringing_directions
from sim2real.recorded.tones import origin, tone_lines, transform_of_tone

LIGHT, RINGING = 0.1, 0.25  # damping ratio of a mode that rings, and octaves from it within which it does
ALIKE = 0.15  # lines within which tones of unknown origin are the same in two records, however loud they are
ALIKE_SD = 2.5  # standard deviations of the distance of two tones within which they are the same, where that is more
SAME_TONE = 0.03  # lines within which a tone that is found again has the frequency that it had
FINE = 0.5  # lines between frequencies that are tried
SLOWEST = 4.0  # turns in a record below which a drift may pass for a tone, and for the same one in two records
XATOL = {"xatol": 1e-3}  # lines to which the frequency of a tone is refined
UNKNOWN_SIZE = 10.0  # times the size found, within which the tone that a fit takes out may lie


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


def with_tones(record: OpenRecord, near: Point = NOMINAL) -> OpenRecord:
    """The record with the tones that a simulation leaves in it, and no others; unchanged where that touches down.

    A tone that is found again where it was keeps its frequency, so that it stays the same nuisance. Where the rig was
    far off before, it is found elsewhere.
    """
    return _searched(record, near)[0]


def _searched(record: OpenRecord, near: Point) -> tuple[OpenRecord, Residual | None]:
    """As `with_tones`, and the residual without these tones."""
    found: list[Tone] = []
    residual = residual_of(record, near)
    if residual is None:
        return record, None
    while len(found) < MOST:
        tone, residual = _strongest(residual)
        if tone is None:
            break
        known = [
            t.frequency for t in record.tones if abs(t.frequency - tone.frequency) < SAME_TONE * resolution_of(record)
        ]
        found.append(replace(tone, frequency=known[0]) if known else tone)
    return replace(record, tones=tuple(found)), residual


def toned(records: Sequence[Record | OpenRecord], near: Point = NOMINAL) -> list[Record | OpenRecord]:
    """The records, those without a period with the tones that are believed of what a simulation leaves in them.

    A tone of known origin is believed, and one that another record has at the same frequency: a resonance that the
    model lacks looks a little different in every record. A slow one, for which a drift may pass, must be in two records
    in any case, one of the rotation at the speed of each. The record that tells the frequency of a tone best tells it
    for all. Where a record shows a tone, the others are looked at again there, and those that turn at another speed
    where the rotation makes it: at one known frequency, noise passes for a tone far less often than anywhere in a
    record.
    """
    searched = [_searched(r, near) if isinstance(r, OpenRecord) else (r, None) for r in records]
    own = [record for record, _ in searched]
    searched = [(r, left) if left is None else _as_told_better(r, left, own) for r, left in searched]
    found = [record for record, _ in searched]
    shown = [(r, t.frequency) for r in found for t in r.tones]
    again = [
        r if left is None else _looked_again(r, left, [*(f for _, f in shown), *_turning(r, shown)])
        for r, left in searched
        if isinstance(r, OpenRecord)
    ]
    left = iter(again)
    return agreed([next(left) if isinstance(r, OpenRecord) else r for r in found])


def _as_told_better(
    record: OpenRecord, residual: Residual, records: Sequence[Record | OpenRecord]
) -> tuple[OpenRecord, Residual]:
    """A record and its residual without its tones, at the frequencies of those records that tell the same tones best.

    What is left of a loud tone at a frequency that is hardly off stands above the noise.
    """
    tones = []
    shown = [(t, frequency_sd(r, t)) for r in records if isinstance(r, OpenRecord) for t in r.tones]
    for tone in record.tones:
        own = frequency_sd(record, tone)
        best, off = min((other for other in shown if _same(record, tone, own, *other)), key=lambda other: other[1])
        if off < own:
            residual = replace(residual, lines=residual.lines + _lines_of(residual, tone))
            tone, residual = _taken_out(residual, best.frequency / resolution_of(record))
        tones.append(tone)
    return replace(record, tones=tuple(tones)), residual


def _turning(record: OpenRecord, shown: Sequence[tuple[Record | OpenRecord, float]]) -> list[float]:
    """Frequencies (Hz) at which tones of the rotation that other records show lie at the speed of this one."""
    at, found = record.experiment.speed_rpm, []
    for other, frequency in shown:
        speed = other.experiment.speed_rpm
        spacing = resolution_of(other)
        if speed > 0 and at not in (0, speed) and origin(frequency, speed, spacing) == "spin":
            found.append(frequency * at / speed)
    return found


def _looked_again(record: OpenRecord, residual: Residual, frequencies: Sequence[float]) -> OpenRecord:
    """The record with a tone at each of the frequencies (Hz) at which one stands out of what its own tones leave."""
    tones, spacing = list(record.tones), resolution_of(record)
    for f in frequencies:
        line = f / spacing
        if any(abs(t.frequency - f) < 1.0 * spacing for t in tones) or not _within(record, np.array([line]))[0]:
            continue
        refined = _strongest_near(residual, line, ALIKE)
        # What a mode that rings near there makes, or the loop of the drive, has a frequency of its own.
        same = abs(refined - line) < SAME_TONE or _tried(record, np.array([line])).size > 0
        if same and _chance(residual, refined) <= np.log(FALSE_ALARM):
            tone, residual = _taken_out(residual, refined)
            tones.append(tone)
    return replace(record, tones=tuple(tones))


def agreed(records: Sequence[Record | OpenRecord]) -> list[Record | OpenRecord]:
    """The records with those tones of records without a period that are believed, as `toned`."""

    def kept(record: OpenRecord, tone: Tone) -> bool:
        spacing, own = resolution_of(record), frequency_sd(record, tone)
        others = [(t, frequency_sd(r, t)) for r in records if r is not record for t in r.tones]
        turning = _turning(record, [(r, t.frequency) for r in records if r is not record for t in r.tones])
        others += [(replace(tone, frequency=f), own) for f in turning]
        known = origin(tone.frequency, record.experiment.speed_rpm, spacing) is not None
        fast = tone.frequency >= WIDTH * spacing
        return (known and fast) or any(_same(record, tone, own, *other) for other in others)

    return [
        replace(r, tones=tuple(t for t in r.tones if kept(r, t))) if isinstance(r, OpenRecord) and r.tones else r
        for r in records
    ]


def without_tones_of_others(records: Sequence[Record | OpenRecord]) -> list[Record | OpenRecord]:
    """The records, those with a period without the lines on which tones lie that records without one show.

    On a line such a tone cannot be told from what is driven there: a resonance would have to explain it.
    """
    shown = tuple(
        t.frequency for r in records if isinstance(r, OpenRecord) for t in r.tones
        if origin(t.frequency, r.experiment.speed_rpm, resolution_of(r)) is None
    )  # fmt: skip
    return [r if isinstance(r, OpenRecord) else replace(r, elsewhere=shown) for r in records]


def _same(record: OpenRecord, tone: Tone, sd: float, other: Tone, other_sd: float) -> bool:
    """Whether a record's tone and another one, of these standard deviations of their frequencies, may be the same."""
    off = abs(other.frequency - tone.frequency)
    return off < max(ALIKE * resolution_of(record), ALIKE_SD * float(np.hypot(sd, other_sd)))


def frequency_sd(record: Record | OpenRecord, tone: Tone) -> float:
    """Standard deviation of a tone's frequency in a record, Hz; without a period chi2 is that of one window of lines,
    which is nearly all of its power."""
    return bins_off(tone) * resolution_of(record)


def bins_off(tone: Tone) -> float:
    """Least standard error of a tone's frequency in what a record resolves (Cramer-Rao bound of one sinusoid in white
    noise: D. Rife and R. Boorstyn, IEEE Transactions on Information Theory 20, 1974)."""
    return float(np.sqrt(3.0 / tone.chi2) / np.pi)


def resolution_of(record: Record | OpenRecord) -> float:
    """Distance (Hz) of frequencies that a record tells apart; without a period, of its lines."""
    if isinstance(record, OpenRecord):
        return record.windows.sample_rate / record.windows.samples
    e = record.experiment
    return e.fundamental / (record.series["displacement"].shape[1] / e.recorded_per_period)


def nuisance_columns(record: OpenRecord, tone: Tone, outputs: tuple[str, ...]) -> dict[str, np.ndarray]:
    """A tone of unknown size and phase along every axis in every output, as columns (outputs, axes, n) by name.

    The command has it, too: an amplifier that is not the nominal one then leaves of it in the current.
    """
    lines, found = record.windows.project(tone_lines(record.windows, tone.frequency)), {}
    sizes = {"plant": float(np.linalg.norm(tone.amplitude["opened"]))}
    if "amplifier" in outputs:
        sizes["amplifier"] = float(np.linalg.norm(amplitude_of(record.series["current"], tone, record)))
    for output, axis in product(outputs, range(record.axes)):
        where = "" if output == "plant" else " in the current"
        for name, column in zip(("cosine", "sine"), lines, strict=True):
            whole = np.zeros((len(outputs), record.axes, column.size), complex)
            whole[outputs.index(output), axis] = UNKNOWN_SIZE * sizes[output] * column.reshape(-1)
            found[f"{name} of {tone.frequency:.9g} Hz along axis {axis} of {record.name}{where}"] = whole
    return found


def amplitude_of(series: np.ndarray, tone: Tone, record: OpenRecord) -> np.ndarray:
    """Complex amplitude (axes,) of a tone in a series (axes, samples) of a record."""
    turned = np.exp(-2j * np.pi * tone.frequency / record.windows.sample_rate * np.arange(series.shape[-1]))
    return 2 * (series - series.mean(axis=-1, keepdims=True)) @ turned / series.shape[-1]


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


def _strongest(residual: Residual) -> tuple[Tone | None, Residual]:
    """The strongest tone that is significant, and the residual without it."""
    tried = _all_tried(residual.record)
    if not tried.size:
        return None, residual

    def significant(line: float) -> bool:
        return _significant(residual, line, tried.size)

    likeliest = tried[int(np.argmin(log_chances(residual, tried * resolution_of(residual.record))))]
    refined = _strongest_near(residual, float(likeliest), 2 * FINE)
    if not significant(refined):
        return None, residual
    # Where drives may explain most of a window, as those of two axes do, what is left of it tells a frequency badly.
    if 2 * residual.rank[_window(residual, np.array([refined]))[0]] > KEPT:
        again = _strongest_near(residual.undriven(), refined, 2 * FINE)
        refined = again if significant(again) else refined
    return _taken_out(residual, refined)


def stands_out(residual: Residual, frequency: float) -> bool:
    """Whether a tone of a frequency (Hz) stands out of a residual as much as one that is searched for has to."""
    line = frequency / resolution_of(residual.record)
    return _significant(residual, line, max(_all_tried(residual.record).size, 1))


def _significant(residual: Residual, line: float, tried: int) -> bool:
    """Whether noise hardly ever shows as strong a tone as there is at a line on any of so many lines."""
    return _chance(residual, line) + np.log(tried) <= np.log(FALSE_ALARM)


def _all_tried(record: OpenRecord) -> np.ndarray:
    """All lines (n,) of a record at which a tone is looked for."""
    w = record.windows
    return _tried(record, np.arange(w.first, w.first + w.frequency.size - 1 + FINE, FINE))


def _tried(record: OpenRecord, lines: np.ndarray) -> np.ndarray:
    """Those of lines (n,) at which a tone is looked for: not of drift, of ringing, or of the drive."""
    lines = lines[_within(record, lines)]
    lines = lines[~_ringing(record, lines * resolution_of(record))]
    return lines[~_of_the_drive(record, lines * resolution_of(record))]


def _within(record: OpenRecord, lines: np.ndarray) -> np.ndarray:
    """Whether lines (n,) are compared, and too fast for a drift."""
    w = record.windows
    return (lines >= max(w.first, SLOWEST)) & (lines <= w.first + w.frequency.size - 1 + FINE)


def _chance(residual: Residual, line: float) -> float:
    return float(log_chances(residual, np.array([line * resolution_of(residual.record)]))[0])


def _strongest_near(residual: Residual, line: float, within: float) -> float:
    """Of lines within a distance of one, that at which a tone stands out most."""
    bounds = (line - within, line + within)
    return float(minimize_scalar(lambda f: _chance(residual, f), bounds=bounds, method="bounded", options=XATOL).x)


def _taken_out(residual: Residual, line: float) -> tuple[Tone, Residual]:
    """The tone at a line, and the residual without it."""
    frequency = line * resolution_of(residual.record)
    (amplitude,), (chi2,) = tones_in(residual, np.array([frequency]))
    tone = Tone(float(frequency), {"opened": amplitude}, float(chi2))
    return tone, replace(residual, lines=residual.lines - _lines_of(residual, tone))


def _lines_of(residual: Residual, tone: Tone) -> np.ndarray:
    """Coordinates (axes, windows, KEPT) of a tone."""
    w, amplitude = residual.record.windows, tone.amplitude["opened"]
    own = np.array([amplitude.real, -amplitude.imag])
    return np.einsum("ca,cwk->awk", own, w.project(tone_lines(w, tone.frequency)))


def _ringing(record: OpenRecord, frequency: np.ndarray) -> np.ndarray:
    """Whether frequencies (n,) are of no known origin and so near a lightly damped mode of the nominal loop that its
    ringing, which no drive explains smoothly, might pass for a tone there."""
    e, w = record.experiment, record.windows
    poles = closed_loop_poles(e).astype(complex)
    poles = np.log(poles[poles != 0]) * e.rig.control_rate
    light = poles[(poles.imag > 0) & (abs(poles.real) < LIGHT * abs(poles))]
    near = np.zeros(frequency.size, bool)
    for pole in light:
        near |= abs(np.log2(2 * np.pi * frequency / abs(pole))) < RINGING
    for i in np.flatnonzero(near):
        near[i] = origin(float(frequency[i]), e.speed_rpm, w.sample_rate / w.samples) is None
    return near


def _of_the_drive(record: OpenRecord, frequency: np.ndarray) -> np.ndarray:
    """Whether a tone at frequencies (n,), Hz, is more likely made by the loop of the sines that drive it."""
    made = distorted(record, frequency)
    often = distorted(record, frequency, COMMON) if made.any() else made
    spacing = record.windows.sample_rate / record.windows.samples
    for i in np.flatnonzero(made & ~often):
        made[i] = origin(float(frequency[i]), record.experiment.speed_rpm, spacing) is None
    return made


def log_chances(residual: Residual, frequencies: np.ndarray) -> np.ndarray:
    """Logarithms (n,) of the probability that noise of the window of each frequency (Hz) shows as strong a tone."""
    _, chi2 = tones_in(residual, frequencies)
    w, axes = residual.record.windows, residual.record.axes
    freedom = 2 * (KEPT - residual.rank[_window(residual, frequencies * w.samples / w.sample_rate)]) - 2
    return stats.f.logsf(chi2 / (2 * axes), 2 * axes, np.maximum(freedom, 1) * axes)
