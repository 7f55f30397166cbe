"""Tones of the mains or of the rotation that lie on lines of a recording with periods, and what they do to the others.

A line on which a known tone lies is not compared. But magnets that are not linear mix the tone with the drive, and the
sums and differences of both lie on lines again. So a tone is put into what drives the simulation, with the size and the
phase that the recording shows: as an error of the reading, by the command that the controller makes of it, or, of a
rotation, as a force.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from sim2real.compared.point import NOMINAL, Point
from sim2real.compared.problem import Part, Problem
from sim2real.recorded.open_record import OpenRecord
from sim2real.recorded.records import Heard, Record
from sim2real.recorded.tones import ON_LINE, families, outstanding

ROUNDS = 2  # of telling how large a tone is from its simulation
AROUND = 12  # lines on either side above which a tone on a line must stand out


@dataclass(frozen=True)
class OnLine:
    """A tone on a line.

    Attributes:
        family: Its origin.
        harmonic: Its order within the family.
        line: Index of the line.
        amplitude: Complex residual (axes,) of the opened loop, m.
        chi2: By which it stands out.
    """

    family: str
    harmonic: int
    line: int
    amplitude: np.ndarray
    chi2: float


def tones_on_lines(part: Part, point: Point) -> list[OnLine]:
    """The tones of known origin on lines of a recording with periods; none where the simulation touches down.

    Args:
        part: The recording in its problem.
        point: The best known parameters.
    """
    record = part.record
    if isinstance(record, OpenRecord) or not record.masked.any():
        return []
    predicted = part.predictor.smoothed([point])[0]
    if not np.isfinite(predicted).all():
        return []
    plant = part.opened.outputs.index("plant")
    left, noise = (part.measured - predicted)[plant], part.noise[plant]  # (axes, n)
    for line, tone in record.heard.items():  # the simulation has it, so that only the rest is left
        left[:, line] += _linear(tone, part, line)
    r, excited = left * np.sqrt(2) / noise, record.excited
    found = []
    for name, tones in families(record.experiment.speed_rpm).items():
        for harmonic, f in enumerate(tones, 1):
            at = np.flatnonzero(abs(record.frequency - f) < ON_LINE * record.experiment.fundamental)
            if not at.size:
                continue
            line = int(at[0])
            near = np.arange(max(line - AROUND, 0), min(line + AROUND + 1, r.shape[1]))
            near = near[(near != line) & (excited[near] == excited[line]) & ~record.masked[near]]
            if (chi2 := outstanding(r[:, line], r[:, near].reshape(-1))) > 0:
                found.append(OnLine(name, harmonic, line, left[:, line], chi2))
    return found


def with_tones_on_lines(*problems: Problem, near: Point = NOMINAL) -> dict[str, Record]:
    """Name -> record of each recording with periods whose simulation is driven by the tones on its lines, too.

    Those of the rotation are an error of the reading, as a runout, or a force, as an unbalance: whichever leaves less
    on the lines that are compared. On a line that the drive excites, a tone is not told from a gap.

    Args:
        problems: The recordings, each of them in one or more.
        near: The best known parameters.
    """
    found = {}
    for part in {p.record.name: p for problem in problems for p in problem.parts}.values():
        record, tones = part.record, tones_on_lines(part, near)
        tones = [tone for tone in tones if not record.excited[tone.line]]
        if tones and isinstance(record, Record) and record.nominal.controlled:  # else it is linear
            forces = (False, True) if any(tone.family == "spin" for tone in tones) else (False,)
            driven = [_driven_by(record, tones, part, near, force) for force in forces]
            found[record.name] = min(driven, key=lambda own: own[1])[0]
    return found


def _driven_by(record: Record, tones: Sequence[OnLine], part: Part, near: Point, force: bool) -> tuple[Record, float]:
    """The record driven by tones besides, the rotation's as forces or not, and what that leaves of the other lines.

    A loop that is not linear answers to a tone otherwise than `_linear`, and by how much, the simulation with the tone
    tells.
    """
    plant = part.opened.outputs.index("plant")
    heard = {t.line: Heard(t.amplitude, force and t.family == "spin") for t in tones}
    for turn in range(ROUNDS + 1):
        driven = _humming(record, heard, part)
        predicted = replace(part.predictor, record=driven).smoothed([near])[0]
        if not np.isfinite(predicted).all():
            return driven, np.inf
        if turn < ROUNDS:
            left = (part.measured - predicted)[plant]
            heard = {n: replace(t, amplitude=left[:, n] + _linear(t, part, n)) for n, t in heard.items()}
    return driven, float(np.sum(abs(part.whitened((part.measured - predicted)[None])) ** 2))


def _linear(tone: Heard, part: Part, line: int) -> np.ndarray:
    """Opened residual (axes,) of the simulation of a linear loop with a tone: a force leaves its receptance times
    itself; an error d of the reading moves the rotor, which leaves -P C d of it."""
    return tone.amplitude if tone.force else (1 - part.opened.closed[:, line]) * tone.amplitude


def _humming(record: Record, heard: Mapping[int, Heard], part: Part) -> Record:
    """The record with these tones by line."""
    turn = 2j * np.pi * np.arange(record.waves["current"].shape[-1]) / record.waves["current"].shape[-1]
    humming = {place: np.zeros_like(record.waves[place]) for place in ("current", "force")}
    for n, tone in heard.items():
        by = 1 / part.opened.receptance[:, n] if tone.force else -part.opened.of_injection[:, n]
        wave = ((by * tone.amplitude)[:, None] * np.exp(record.lines[n] * turn)).real
        humming["force" if tone.force else "current"] += wave
    return replace(record, heard=heard, humming=humming)
