"""Tones in the recordings of a campaign: between the lines of the excitation, on them, and as loud bands of noise."""

from collections.abc import Collection
from dataclasses import dataclass, replace

import numpy as np
from scipy import stats

from estimation.lines.tones import Tone, tone_at
from maglev_env.experiment import axis_experiment
from maglev_env.linear.loop import loop_response
from maglev_env.rig.rig import Rig
from sim2real.compared.open_tones import bins_off
from sim2real.compared.point import Point, experiment_at, modes_of, with_own
from sim2real.compared.problem import Part, Problem
from sim2real.compared.tones_left import log_chances, residual_of, resolution_of, stands_out, tones_in
from sim2real.compared.tones_on_lines import tones_on_lines
from sim2real.judgement.tones.noise_at_peak import NO_TANGENT, linear, noise_at_peak
from sim2real.recorded.open_record import OpenRecord
from sim2real.recorded.opened import loud_bands, opened_loop
from sim2real.recorded.records import Record
from sim2real.recorded.tones import (
    HARMONICS,
    HIGHEST,
    MAINS,
    NEAR,
    ON_LINE,
    SAME,
    families,
    order_of,
    origin,
    wanders,
)

FOREIGN, LOUD = "foreign", "loud"
TOGETHER = 1e-4  # probability that noise in all records shows as much at the rotation frequency
# Octaves from a fitted mode within which a tone is attributed to its ringing: at most, and per damping ratio.
RINGING, RINGING_WIDTHS = 0.25, 8.0
SURE = 5.0  # standard errors by which a tone's frequency is off at most
SHIFTED = 0.1  # bins of the resolution within which a tone lies where the drive shifts another one
BESIDE_MODE = 1.4  # twice the octaves from a fitted mode within which loud noise is attributed to it


@dataclass(frozen=True)
class Sighting:
    """A tone in one record.

    Attributes:
        record: Index of the record.
        family: Its origin.
        harmonic: Order within the family; 1 is the fundamental, 0 what the lines of the drive make of the family.
        frequency: Hz.
        size: Residual of the opened loop at that frequency, m.
        sd: Standard deviation of the size, m.
        receptance: Receptance at that frequency, m/N.
        chi2: Chi-square of the tone.
    """

    record: int
    family: str
    harmonic: int
    frequency: float
    size: float
    sd: float
    receptance: float
    chi2: float


def sightings(problem: Problem, point: Point, drifting: bool = False) -> list[Sighting]:
    """Tones of every part: those found between the harmonics, and those on lines that a point's simulation leaves.

    Args:
        problem: the campaign.
        point: the best known parameters.
        drifting: whether the gain drifts, which scatters over the periods too.
    """
    found = []
    for i, part in enumerate(problem.parts):
        between = [s for s in _between(i, part, point) if not (drifting and _is_trend(part, s.frequency))]
        found += between + _on_lines(i, part, point) + _bands(i, part, point, drifting)
    found = _one_family(problem, _mixed(problem, _higher_harmonics(problem, _foreign_elsewhere(problem, found))))
    turning = {s.record for s in found if s.family == "spin" and s.harmonic == 1}
    rest = [s for i, part in enumerate(problem.parts) if i not in turning for s in _unseen(i, part, point)]
    rest = [s for s in rest if not _is_foot(problem, s, found)]
    axes = problem.parts[0].record.axes
    # At a known rotation frequency, pooling the records finds tones that no single record shows; and where the rotation
    # is seen in some records, a small amplitude in the others is evidence as well.
    if turning or stats.chi2.sf(sum(s.chi2 for s in rest), 2 * axes * len(rest)) < TOGETHER:
        found += rest
    return found + [s for i in sorted(turning) for s in _at_twice(i, problem.parts[i], point, found)]


def _at_twice(index: int, part: Part, point: Point, found: list[Sighting]) -> list[Sighting]:
    """Amplitude at twice the rotation frequency of a record that shows that frequency, if it was not seen there."""
    if any(s.record == index and s.family == "spin" and s.harmonic == 2 for s in found):
        return []
    at = seen_at(index, part, point, part.record.experiment.speed_rpm / 30, "spin")
    return [replace(s, harmonic=2) for s in at]


def _is_foot(problem: Problem, s: Sighting, found: list[Sighting]) -> bool:
    """Whether what a record shows at a frequency may be a tone beside it, which the record does not resolve from it."""
    resolution = resolution_of(problem.parts[s.record].record)
    return any(k.record == s.record and k.size > 0 and abs(k.frequency - s.frequency) < resolution for k in found)


def _is_trend(part: Part, frequency: float) -> bool:
    """Whether a tone lies so near an excited line that the periods hold no whole turn between them: it is then the
    trend of that line, if there is one."""
    record = part.record
    if isinstance(record, OpenRecord):
        return False
    apart = abs(frequency - record.frequency[record.excited]).min(initial=np.inf)
    return bool(apart < record.experiment.fundamental / record.count)


def _foreign_elsewhere(problem: Problem, found: list[Sighting]) -> list[Sighting]:
    """Assign tones that a short record cannot tell from a harmonic of the mains or the rotation to a clearer one of
    unknown origin at the same frequency in another record, which does. A family that is seen more clearly stays."""

    def named(s: Sighting) -> Sighting:
        if s.family in (FOREIGN, LOUD) or any(k.family == s.family and k.chi2 > s.chi2 for k in found):
            return s
        off = SAME * resolution_of(problem.parts[s.record].record)
        same = [
            k for k in found if k.family == FOREIGN and k.record != s.record and abs(k.frequency - s.frequency) < off
        ]
        clearest = max(same, key=lambda k: k.chi2, default=s)
        return replace(s, family=FOREIGN, harmonic=1, frequency=clearest.frequency) if clearest.chi2 > s.chi2 else s

    return [named(s) for s in found]


def _higher_harmonics(problem: Problem, found: list[Sighting]) -> list[Sighting]:
    """Assign tones of unknown origin to the mains or the rotation where these are seen and have a harmonic there.

    A distorted mains, or a journal that is not round, shows more than the harmonics that are looked for. Only where the
    family is seen, and more clearly, is one of these its likely origin.
    """
    clearest: dict[str, float] = {}
    for s in found:
        if s.family not in (FOREIGN, LOUD):
            clearest[s.family] = max(clearest.get(s.family, 0.0), s.chi2)

    def named(s: Sighting) -> Sighting:
        record = problem.parts[s.record].record
        off = SAME * resolution_of(record)
        for name, (first, *_) in families(record.experiment.speed_rpm).items():
            order = round(s.frequency / first)
            near = abs(s.frequency - order * first) < off + NEAR * s.frequency
            if near and HARMONICS < order <= HIGHEST and clearest.get(name, 0.0) > s.chi2:
                return replace(s, family=name, harmonic=order)
        return s

    return [named(s) if s.family == FOREIGN else s for s in found]


def _mixed(problem: Problem, found: list[Sighting]) -> list[Sighting]:
    """Assign tones of unknown origin to a clearer one of the same record that the drive shifts.

    A force that is not linear, as that of a single magnet, mixes a tone with the lines of the drive: sums and
    differences of both are seen. Without a period any frequency would be one of these.
    """

    def named(s: Sighting) -> Sighting:
        record = problem.parts[s.record].record
        if s.family != FOREIGN or isinstance(record, OpenRecord):
            return s
        spacing, off = record.experiment.fundamental, SHIFTED * resolution_of(record)
        clearer = [k for k in found if k.record == s.record and k.family not in (FOREIGN, LOUD) and k.chi2 > s.chi2]
        for known in sorted(clearer, key=lambda k: -k.chi2):
            apart = (abs(s.frequency - known.frequency), s.frequency + known.frequency)
            if any(abs(f - spacing * round(f / spacing)) < off for f in apart):
                return replace(s, family=known.family, harmonic=0)
        return s

    return [named(s) for s in found]


def of_mains(problem: Problem, found: list[Sighting]) -> bool:
    """Whether mains of one frequency may make all tones of the rotation."""
    own = [s for s in found if s.family == "spin"]
    return any(all(_within(problem, s, {f"pickup {f:g} Hz"}) is not None for s in own) for f in MAINS)


def _one_family(problem: Problem, found: list[Sighting]) -> list[Sighting]:
    """Assign tones to one family where it explains them all, for a rotor that turns near the mains frequency.

    What either explains is given to the rotation, of which it is asked whether the mains make it.
    """
    present = {s.family for s in found}
    of_rotation = {s: _within(problem, s, {"spin"}) for s in found if s.family.startswith("pickup")}
    if "spin" not in present and of_rotation and None not in of_rotation.values():
        return [of_rotation.get(s) or s for s in found]
    for name in ("pickup", "spin"):
        others = {family for family in present if not family.startswith(name)}
        renamed = {s: _within(problem, s, others) for s in found if s.family.startswith(name)}
        if renamed and None not in renamed.values():
            known = {(s.record, s.family, s.harmonic) for s in found}
            kept = [s for s in found if s not in renamed]
            return kept + [s for s in renamed.values() if (s.record, s.family, s.harmonic) not in known]
    return found


def _within(problem: Problem, s: Sighting, others: Collection[str]) -> Sighting | None:
    """A sighting renamed to another family that has a tone close enough; None if there is none."""
    record = problem.parts[s.record].record
    e = record.experiment
    off = SAME * resolution_of(record) if isinstance(record, OpenRecord) else ON_LINE * e.fundamental
    for name, tones in families(e.speed_rpm).items():
        for harmonic, f in enumerate(tones, 1):
            if name in others and abs(s.frequency - f) < off + NEAR * f:
                return replace(s, family=name, harmonic=harmonic)
    return None


def _between(index: int, part: Part, point: Point) -> list[Sighting]:
    record, found = part.record, []
    if not record.tones:
        return []
    speed = record.experiment.speed_rpm
    resolution = resolution_of(record)
    left = residual_of(record, point) if isinstance(record, OpenRecord) else None  # None, too, where that touches down
    for tone in record.tones:
        name = origin(tone.frequency, speed, resolution * _told(record, tone)) or FOREIGN
        if not name.startswith("spin") and _rings(part, point, tone.frequency):
            continue  # noise that excites a lightly damped mode
        if noise_at_peak(record, point, tone):
            continue
        if name == FOREIGN and left is not None and not stands_out(left, tone.frequency):
            continue  # it was what other parameters or effects had left, as of friction after steps
        slow = left is None and (wanders(tone, resolution) or _creeps(record, point, tone.frequency))
        if name == FOREIGN and slow:
            continue
        harmonic = 1 if name == FOREIGN else order_of(tone.frequency, name, speed)
        opened, reading = tone.amplitude.get("opened"), tone.amplitude.get("displacement")
        size, receptance = _opened(record, point, tone.frequency, reading, opened)
        found.append(
            Sighting(index, name, harmonic, tone.frequency, size, size / np.sqrt(tone.chi2), receptance, tone.chi2)
        )
    return found


def _creeps(record: Record | OpenRecord, point: Point, frequency: float) -> bool:
    """Whether a tone below the lines of the drive may be the rotor that creeps to rest, as it does under friction."""
    below = not isinstance(record, OpenRecord) and frequency < record.experiment.fundamental
    return below and may_creep(record.nominal, point)


def may_creep(nominal: Rig, point: Point) -> bool:
    """Whether effects act with which a rotor comes to rest more slowly than any pole of its loop says."""
    return not with_own(point, nominal).keys().isdisjoint(NO_TANGENT)


def _rings(part: Part, point: Point, frequency: float) -> bool:
    """Whether a mode that acts at a point rings at a frequency: noise excites it there, and its lines are simulated
    worst."""
    modes = modes_of(with_own(point, part.record.nominal))
    near = ((mode["frequency"], min(RINGING, RINGING_WIDTHS * mode["damping_ratio"])) for mode in modes)
    return any(abs(np.log2(frequency / f)) < within for f, within in near)


def _told(record: Record | OpenRecord, tone: Tone) -> float:
    """Share of the resolution to which a tone's frequency is told, at most 1.

    A tone that is loud enough is told far better (`bins_off`). Beside a line of a record with periods it is not.
    """
    if not isinstance(record, OpenRecord):
        return 1.0
    return float(np.clip(SURE * bins_off(tone), SHIFTED, SAME)) / SAME


def _unseen(index: int, part: Part, point: Point) -> list[Sighting]:
    """Amplitude at the rotation frequency of a record in which no tone stands out; nothing where a line hides it."""
    return seen_at(index, part, point, part.record.experiment.speed_rpm / 60, "spin")


def seen_at(index: int, part: Part, point: Point, f: float, family: str = FOREIGN) -> list[Sighting]:
    """The sighting at a frequency (Hz) between the lines, however small; nothing at 0 or on a line."""
    e = part.record.experiment
    if isinstance(part.record, OpenRecord):
        return _at_open(index, part.record, point, f, family)
    if f == 0 or abs(f / e.fundamental - round(f / e.fundamental)) < ON_LINE:
        return []
    values = part.record.series["displacement"]
    amplitude, chi2 = tone_at(values, f, e.recorded_per_period, e.recorded_rate)
    size, receptance = _opened(part.record, point, f, amplitude)
    return [Sighting(index, family, 1, f, size, size / np.sqrt(chi2), receptance, chi2)]


def _at_open(index: int, record: OpenRecord, point: Point, f: float, family: str) -> list[Sighting]:
    """The sighting at a frequency (Hz) in what a point leaves of a record without a period."""
    if not record.windows.frequency[0, 0] <= f <= record.windows.frequency[-1, -1]:
        return []
    if (residual := residual_of(record, point)) is None:
        return []
    (amplitude,), (beyond,) = tones_in(residual, at := np.array([f]))
    # The noise is told from a single window: as a chi-square, the value of the same probability.
    chi2 = min(beyond, float(stats.chi2.isf(np.exp(log_chances(residual, at)[0]), 2 * record.axes)))
    size, receptance = _opened(record, point, f, None, amplitude)
    return [Sighting(index, family, 1, f, size, size / np.sqrt(max(chi2, 1e-300)), receptance, chi2)]


def _opened(
    record: Record | OpenRecord,
    point: Point,
    frequency: float,
    reading: np.ndarray | None,
    opened: np.ndarray | None = None,
) -> tuple[float, float]:
    """Size (m, rms of the axes) of a tone with the loop opened as at a point, and the receptance (m/N) there.

    Args:
        reading: its amplitude (axes,) in the closed loop.
        opened: or its amplitude (axes,) with the loop opened as at the nominal rig.
    """
    at, amplitude = np.array([frequency]), reading if opened is None else opened
    sizes, receptances = [], []
    for axis, size in enumerate(np.abs(amplitude)):
        e = axis_experiment(experiment_at(record.experiment, linear(point)), axis)
        r = loop_response(e, at)
        back = abs(1 + r.plant * r.controller)[0]
        if opened is not None:  # as at the nominal rig
            n = loop_response(axis_experiment(record.experiment, axis), at)
            back /= abs(1 + n.plant * n.controller)[0]
        sizes.append(size * back)
        receptances.append(abs(r.receptance / r.sensitivity)[0])
    return float(np.sqrt(np.mean(np.square(sizes)))), float(np.mean(receptances))


def _bands(index: int, part: Part, point: Point, drifting: bool) -> list[Sighting]:
    """Loud bands, as tones of unknown size.

    The noise is white only if the loop is opened correctly. It is opened as at the point and as on the nominal rig,
    because noise does not meet the tangent of a friction; a band must be loud in both.
    """
    if isinstance(part.record, OpenRecord):
        return []  # its noise is told from the scatter of neighbouring lines, and so are bands of it
    if may_creep(part.record.nominal, point):
        return []  # these effects give the loop's noise no definite shape, either
    corrected = replace(part.record, experiment=experiment_at(part.record.experiment, point))
    opened = [replace(opened_loop(r), outputs=part.opened.outputs) for r in (corrected, part.record)]
    loops = [loud_bands(r, o, drifting) for r, o in zip((corrected, part.record), opened, strict=True)]
    loud = min(loops, key=lambda bands: sum(chi2 for *_, chi2 in bands))
    modes = [mode["frequency"] for mode in modes_of(with_own(point, part.record.nominal))]
    # Near a lightly damped mode the noise depends on the mode's damping, which no fit determines well enough.
    loud = [band for band in loud if all(abs(np.log2(f * f / (band[0] * band[1]))) > BESIDE_MODE for f in modes)]
    return [Sighting(index, LOUD, 1, (lo * hi) ** 0.5, 0.0, 0.0, 0.0, chi2) for lo, hi, chi2 in loud]


def _on_lines(index: int, part: Part, point: Point) -> list[Sighting]:
    record, found = part.record, []
    plant = part.opened.outputs.index("plant")
    for tone in tones_on_lines(part, point):
        f = families(record.experiment.speed_rpm)[tone.family][tone.harmonic - 1]
        if not tone.family.startswith("spin") and _rings(part, point, f):
            continue
        noise = part.noise[plant, :, tone.line]
        size = float(np.sqrt(np.mean(abs(tone.amplitude) ** 2)))
        sd = float(np.sqrt(np.mean(noise**2) / 2 / noise.size))  # of the mean of the axes
        receptance = float(np.mean(abs(part.opened.receptance[:, tone.line])))
        found.append(Sighting(index, tone.family, tone.harmonic, f, size, sd, receptance, tone.chi2))
    return found
