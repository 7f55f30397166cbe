"""Which tones of records without a period are believed, and what a fit makes of them.

They are looked for in each record alone (`tones_left`). Records of one campaign then confirm each other.
"""

from collections.abc import Sequence
from dataclasses import replace
from itertools import product

import numpy as np

from estimation.lines.line_windows import WIDTH
from estimation.lines.tones import FALSE_ALARM, MOST, Tone
from sim2real.compared.point import NOMINAL, Point
from sim2real.compared.tones_left import (
    Residual,
    compared,
    lines_of,
    log_chance,
    residual_of,
    resolution_of,
    strongest,
    strongest_near,
    taken_out,
    tried,
)
from sim2real.recorded.open_record import OpenRecord
from sim2real.recorded.records import Record
from sim2real.recorded.tones import origin, overtones, tone_lines

ALIKE = 0.15  # lines within which tones of unknown origin are the same in two records, however loud they are
ALIKE_SD = 2.5  # standard deviations of the distance of two tones within which they are the same, where that is more
SAME_TONE = 0.03  # lines within which a tone that is found again has the frequency that it had
UNKNOWN_SIZE = 10.0  # times the size found, within which the tone that a fit takes out may lie


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
        tone, residual = strongest(residual)
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
    where the rotation makes it, and so where mains or rotation that are seen have higher harmonics: at one known
    frequency, noise passes for a tone far less often than anywhere in a record.
    """
    searched = [_searched(r, near) if isinstance(r, OpenRecord) else (r, None) for r in records]
    own = [record for record, _ in searched]
    searched = [(r, left) if left is None else _as_told_better(r, left, own) for r, left in searched]
    found = [record for record, _ in searched]
    shown = [(r, t.frequency) for r in found for t in r.tones]
    again = [
        r if left is None else _looked_again(r, left, [*(f for _, f in shown), *_turning(r, shown), *_above(r, shown)])
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
            residual = replace(residual, lines=residual.lines + lines_of(residual, tone))
            tone, residual = taken_out(residual, best.frequency / resolution_of(record))
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


def _above(record: OpenRecord, shown: Sequence[tuple[Record | OpenRecord, float]]) -> list[float]:
    """Frequencies (Hz) of the higher harmonics of mains and rotation that records show, at the speed of this one."""
    found = []
    for other, frequency in shown:
        speed, spacing = other.experiment.speed_rpm, resolution_of(other)
        if speed == record.experiment.speed_rpm or origin(frequency, speed, spacing) != "spin":
            found += overtones(frequency, speed, spacing)
    return found


def _looked_again(record: OpenRecord, residual: Residual, frequencies: Sequence[float]) -> OpenRecord:
    """The record with a tone at each of the frequencies (Hz) at which one stands out of what its own tones leave."""
    tones, spacing = list(record.tones), resolution_of(record)
    for f in frequencies:
        line = f / spacing
        if any(abs(t.frequency - f) < 1.0 * spacing for t in tones) or not compared(record, np.array([line]))[0]:
            continue
        refined = strongest_near(residual, line, ALIKE)
        # What a mode that rings near there makes, or the loop of the drive, has a frequency of its own.
        same = abs(refined - line) < SAME_TONE or tried(record, np.array([line])).size > 0
        if same and log_chance(residual, refined) <= np.log(FALSE_ALARM):
            tone, residual = taken_out(residual, refined)
            tones.append(tone)
    return replace(record, tones=tuple(tones))


def agreed(records: Sequence[Record | OpenRecord]) -> list[Record | OpenRecord]:
    """The records with those tones of records without a period that are believed, as `toned`."""

    def kept(record: OpenRecord, tone: Tone) -> bool:
        spacing, own = resolution_of(record), frequency_sd(record, tone)
        others = [(t, frequency_sd(r, t)) for r in records if r is not record for t in r.tones]
        turning = _turning(record, [(r, t.frequency) for r in records if r is not record for t in r.tones])
        above = _above(record, [(r, t.frequency) for r in records for t in r.tones])
        others += [(replace(tone, frequency=f), own) for f in (*turning, *above)]
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
