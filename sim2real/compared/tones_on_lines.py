"""Tones of the mains or of the rotation that lie on lines of a recording with periods, and what they do to the others.

A line on which a known tone lies is not compared. But magnets that are not linear mix the tone with the drive, and the
sums and differences of both lie on lines again. So a tone is put into what drives the simulation, with the size and the
phase that the recording shows: an error of the reading, as the command that the controller makes of it. What an
unbalance moves, the loop takes for nearly the same.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from sim2real.compared.point import NOMINAL, Point
from sim2real.compared.problem import Part, Problem
from sim2real.recorded.open_record import OpenRecord
from sim2real.recorded.records import Record
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
    for line, amplitude in record.heard.items():  # the simulation has it
        left[:, line] = amplitude
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


def with_tones_on_lines(problem: Problem, near: Point = NOMINAL) -> dict[str, Record]:
    """Name -> record of each recording with periods whose simulation is driven by the tones on its lines, too.

    Those of the rotation are an error of the reading, as a runout, or a force, as an unbalance: whichever leaves less
    on the lines that are compared.

    Args:
        problem: The recordings.
        near: The best known parameters.
    """
    found = {}
    for part in problem.parts:
        record, tones = part.record, tones_on_lines(part, near)
        if tones and isinstance(record, Record) and record.nominal.controlled:  # else it is linear
            places = ("current", "force") if any(tone.family == "spin" for tone in tones) else ("current",)
            driven = [_driven_by(record, tones, part, near, place) for place in places]
            found[record.name] = min(driven, key=lambda own: own[1])[0]
    return found


def _driven_by(record: Record, tones: Sequence[OnLine], part: Part, near: Point, place: str) -> tuple[Record, float]:
    """The record driven by tones besides, at a place of the rotation's ones, and what that leaves of the other lines.

    What a tone of the reading leaves of an opened linear loop is the tone itself, and what a force does, its receptance
    times the force. A loop that is not linear answers otherwise, and by how much, the simulation with the tone tells:
    beside the linear answer, -P C d to a tone d of the reading.
    """
    plant, opened = part.opened.outputs.index("plant"), part.opened
    of = {t.line: (t.amplitude, place == "force" and t.family == "spin") for t in tones}
    for turn in range(ROUNDS + 1):
        driven = _humming(record, of, part)
        predicted = replace(part.predictor, record=driven).smoothed([near])[0]
        if not np.isfinite(predicted).all():
            return driven, np.inf
        if turn < ROUNDS:
            left = (part.measured - predicted)[plant]
            linear = {
                n: amplitude if forced else (1 - opened.closed[:, n]) * amplitude
                for n, (amplitude, forced) in of.items()
            }
            of = {n: (left[:, n] + linear[n], forced) for n, (_, forced) in of.items()}
    return driven, float(np.sum(abs(part.whitened((part.measured - predicted)[None])) ** 2))


def _humming(record: Record, of: Mapping[int, tuple[np.ndarray, bool]], part: Part) -> Record:
    """The record with tones of these amplitudes (axes,), m, by line, and whether each is a force."""
    turn = 2j * np.pi * np.arange(record.waves["current"].shape[-1]) / record.waves["current"].shape[-1]
    humming = {place: np.zeros_like(record.waves[place]) for place in ("current", "force")}
    for n, (amplitude, forced) in of.items():
        by = 1 / part.opened.receptance[:, n] if forced else -part.opened.of_injection[:, n]
        humming["force" if forced else "current"] += ((by * amplitude)[:, None] * np.exp(record.lines[n] * turn)).real
    return replace(record, heard={n: amplitude for n, (amplitude, _) in of.items()}, humming=humming)
