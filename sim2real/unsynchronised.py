"""Evidence of tones: pickup, what turns with the rotor, and what nothing known explains."""

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from maglev_env.experiment import axis_experiment
from maglev_env.linear import loop_response
from sim2real.opened import loud_bands, opened_loop
from sim2real.problem import Part, Problem
from sim2real.simulated import Point, experiment_at
from sim2real.tones import HARMONICS, MAINS, ON_LINE, families, origin, outstanding

FOREIGN = "foreign"
AROUND = 12  # lines to either side that a tone on a line must stand out from
FORM = 0.05  # of an amplitude: what a model of it may miss


@dataclass(frozen=True)
class Sighting:
    """A tone in one record, as the opened loop's residual (m) at its frequency with its standard deviation and the
    receptance there (m/N); harmonic 1 is the family's fundamental."""

    record: int
    family: str
    harmonic: int
    frequency: float
    size: float
    sd: float
    receptance: float
    chi2: float


def sightings(problem: Problem, point: Point) -> list[Sighting]:
    """Tones of every part: those found between the harmonics, and those on a line that a point's simulation leaves."""
    found = []
    for i, part in enumerate(problem.parts):
        found += _between(i, part) + _on_lines(i, part, point) + _bands(i, part, point)
    return found


def evidence(found: list[Sighting]) -> dict[str, float]:
    """Summed chi-square of each family: "pickup", "spin", "foreign"."""
    total: dict[str, float] = {}
    for s in found:
        name = s.family.split()[0]
        total[name] = total.get(name, 0.0) + s.chi2
    return total


def _between(index: int, part: Part) -> list[Sighting]:
    record, found = part.record, []
    speed = record.experiment.speed_rpm
    resolution = record.experiment.fundamental / (
        record.series["displacement"].shape[1] / record.experiment.recorded_per_period
    )
    for tone in record.tones:
        e = axis_experiment(record.experiment, 0)
        r = loop_response(replace(e, effects={}), np.array([tone.frequency]))
        size = float(np.linalg.norm(tone.amplitude["displacement"])) * float(abs(1 + r.plant * r.controller)[0])
        name = origin(tone.frequency, speed, resolution) or FOREIGN
        harmonic = 1
        if name != FOREIGN:
            harmonic = int(np.argmin([abs(tone.frequency - f) for f in families(speed)[name]])) + 1
        receptance = float(abs(r.receptance / r.sensitivity)[0])
        found.append(
            Sighting(index, name, harmonic, tone.frequency, size, size / np.sqrt(tone.chi2), receptance, tone.chi2)
        )
    return found


def _bands(index: int, part: Part, point: Point) -> list[Sighting]:
    """Loud bands, as foreign tones of unknown size. For noise to be white the loop is opened as a point has it, and as
    the nominal rig does, for what noise meets is not the tangent of a friction; what is loud is so in both."""
    corrected = replace(part.record, experiment=experiment_at(part.record.experiment, point))
    loops = [loud_bands(r, replace(opened_loop(r), outputs=part.opened.outputs)) for r in (corrected, part.record)]
    loud = min(loops, key=lambda bands: sum(chi2 for *_, chi2 in bands))
    return [Sighting(index, FOREIGN, 1, (lo * hi) ** 0.5, 0.0, 0.0, 0.0, chi2) for lo, hi, chi2 in loud]


def _on_lines(index: int, part: Part, point: Point) -> list[Sighting]:
    record = part.record
    if not record.masked.any():
        return []
    predicted = part.predictor([point])[0]
    if not np.isfinite(predicted).all():
        return []
    plant = part.opened.outputs.index("plant")
    r = ((part.measured - predicted) * np.sqrt(2) / part.noise)[plant]  # (axes, n)
    excited = record.excited
    found = []
    for name, tones in families(record.experiment.speed_rpm).items():
        for harmonic, f in enumerate(tones, 1):
            at = np.flatnonzero(abs(record.frequency - f) < ON_LINE * record.experiment.fundamental)
            if not at.size:
                continue
            line = int(at[0])
            near = np.arange(max(line - AROUND, 0), min(line + AROUND + 1, r.shape[1]))
            near = near[(near != line) & (excited[near] == excited[line]) & ~record.masked[near]]
            chi2 = outstanding(r[:, line], r[:, near].reshape(-1))
            if chi2 > 0:
                sd = float(np.linalg.norm(part.noise[plant, :, line])) / np.sqrt(2)
                size = float(np.linalg.norm(r[:, line])) * sd
                receptance = float(np.mean(abs(part.opened.receptance[:, line])))
                found.append(Sighting(index, name, harmonic, f, size, sd, receptance, chi2))
    return found


def spin_costs(problem: Problem, found: list[Sighting]) -> dict[str, float]:
    """Cost of "runout" (the same reading at every speed) and of "unbalance" (a force that grows with the square of the
    speed) as what the sightings at 1x are; harmonics tell nothing: a bearing makes them of either."""
    own = [s for s in found if s.family == "spin" and s.harmonic == 1]
    if not own:
        return {"runout": 0.0, "unbalance": 0.0}
    size, sd = np.array([s.size for s in own]), np.array([s.sd for s in own])
    weight = 1 / (sd**2 + (FORM * size) ** 2)
    speed = np.array([problem.parts[s.record].record.experiment.speed_rpm for s in own])
    force = speed**2 * np.array([s.receptance for s in own])
    return {"runout": _misfit(size, np.ones_like(size), weight), "unbalance": _misfit(size, force, weight)}


def _misfit(size: np.ndarray, shape: np.ndarray, weight: np.ndarray) -> float:
    scale = (weight * size * shape).sum() / (weight * shape**2).sum()
    return float((weight * (size - scale * shape) ** 2).sum())


def tone_parameters(problem: Problem, found: list[Sighting], effect: str) -> Mapping[str, float]:
    """Parameters of runout, pickup or unbalance from their sightings; phases are left at their default."""
    family = "spin" if effect in ("runout", "unbalance") else "pickup"
    own = [s for s in found if s.family.startswith(family)]
    sizes = [np.mean([s.size for s in own if s.harmonic == h] or [0.0]) for h in range(1, HARMONICS + 1)]
    if effect == "unbalance":
        shares = [
            s.size / s.receptance / (problem.parts[s.record].record.experiment.speed_rpm * np.pi / 30) ** 2
            for s in own
            if s.harmonic == 1
        ]
        return {"moment": float(np.mean(shares or [0.0])), "phase": 0.0}
    ratio = float(np.clip(sizes[1] / sizes[0], 0.0, 0.9)) if sizes[0] > 0 else 0.0
    first = sizes[0] if sizes[0] > 0 else max(sizes)
    parameters = {"amplitude": float(first), "harmonics": ratio, "phase": 0.0}
    if effect == "pickup":
        mains = [f for f in MAINS if any(s.family == f"pickup {f:g} Hz" for s in own)]
        parameters["frequency"] = mains[0] if mains else MAINS[0]
    return parameters
