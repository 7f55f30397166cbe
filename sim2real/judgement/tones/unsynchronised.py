"""Evidence of tones: mains pickup, effects of the rotation, and tones that nothing known explains."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from scipy import stats

from sim2real.compared.point import Point
from sim2real.compared.problem import Problem
from sim2real.judgement.tones.sightings import FOREIGN, LOUD, Sighting, seen_at
from sim2real.recorded.tones import HARMONICS, NEAR

FORM = 0.03  # relative error of an amplitude that its model may make
BAND = 1 / 6  # octaves to either side within which the tones of a vibration may lie
SLIP = 0.05  # share of the stated speed by which a rotor may turn at another one, as a motor slips
OF_BEARING = 0.1  # share of the tone at the speed of rotation that a bearing may turn into one at twice the speed
# Cost (-2 ln likelihood ratio) at most of a tone at twice the speed for an unbalance, which makes none. A shaft that is
# not equally stiff all around makes one of its weight, and a coupling that is not aligned, so it is no proof.
TWICE_PER_TURN = 8.0
BY_NOISE = 0.01  # probability that noise shows as much there as does not count


def evidence(found: list[Sighting]) -> dict[str, float]:
    """Summed chi-square of each family: "pickup", "spin", "foreign", "loud"."""
    total: dict[str, float] = {}
    for s in found:
        name = s.family.split()[0]
        total[name] = total.get(name, 0.0) + s.chi2
    return total


def spin_costs(problem: Problem, found: list[Sighting], mains: bool = False) -> dict[str, float]:
    """Cost of explaining the tones of the rotation by "runout", by "unbalance" and, where it may be, by "pickup".

    A runout gives the same reading at every speed; an unbalance is a force that grows with the square of the speed. A
    surface that is not round shows at twice the speed as well, an unbalance only what the bearing makes of it.

    Args:
        problem: the campaign.
        found: all sightings.
        mains: whether the mains may make them, too (see `of_mains`).
    """
    own = once_per_turn(found)
    if not own:
        return {"runout": 0.0, "unbalance": 0.0}
    size, sd = np.array([s.size for s in own]), np.array([s.sd for s in own])
    weight = 1 / (sd**2 + (FORM * size) ** 2)
    speed = np.array([problem.parts[s.record].record.experiment.speed_rpm for s in own])
    force = speed**2 * np.array([s.receptance for s in own])
    twice = _twice_per_turn(own, found)
    same = _misfit(size, np.ones_like(size), weight)
    return {
        "runout": same,
        "unbalance": _misfit(size, force, weight) + twice,
        **({"pickup": same} if mains else {}),
    }


def once_per_turn(found: Sequence[Sighting]) -> list[Sighting]:
    """The tone at the speed of rotation of each record that has one."""
    own = [s for s in found if s.family == "spin" and s.harmonic == 1]
    return [_whole([s for s in own if s.record == record]) for record in sorted({s.record for s in own})]


def _twice_per_turn(own: list[Sighting], found: list[Sighting]) -> float:
    """What tones at twice the speed of rotation cost that no bearing makes of those at that speed, `own`."""
    once = {s.record: s.size for s in own}
    twice = [s for s in found if s.family == "spin" and s.harmonic == 2 and s.record in once]
    more = [(s.size - OF_BEARING * once[s.record], s.sd) for s in twice]
    beyond = [size / sd for size, sd in more if size > 0]
    by_noise = float(stats.chi2.isf(BY_NOISE, 2 * len(twice))) if twice else 0.0
    return float(np.clip(np.square(beyond).sum() - by_noise, 0.0, TWICE_PER_TURN))


def _whole(parts: list[Sighting]) -> Sighting:
    """One tone of a record of which parts were seen apart, as beside a line of its excitation and on it.

    How their phases lie is not known, so the size of the largest is uncertain by all the others.
    """
    largest = max(parts, key=lambda s: s.size)
    rest = sum(s.size for s in parts) - largest.size
    return replace(largest, sd=float(np.hypot(largest.sd, rest)))


def _misfit(size: np.ndarray, shape: np.ndarray, weight: np.ndarray) -> float:
    scale = (weight * size * shape).sum() / (weight * shape**2).sum()
    return float((weight * (size - scale * shape) ** 2).sum())


def vibration_costs(problem: Problem, found: list[Sighting], point: Point) -> dict[str, dict[str, float]]:
    """Cost, for each family, of explaining it by one foreign vibration: a tone or a narrow band, and its harmonics.

    A tone must be a force of the same size in all records. What lies elsewhere is not explained.

    Args:
        problem: the campaign.
        found: all sightings.
        point: the best known parameters.
    """
    tones = [s for s in found if s.family == FOREIGN]
    if not tones:
        return {}
    first = max(tones, key=lambda s: s.chi2).frequency
    own = [s for s in tones if abs(np.log2(s.frequency / first)) < BAND]
    rest = sum(s.chi2 for s in tones if s not in own and not _harmonic(s.frequency, first))
    if all(abs(s.frequency - first) < 2 * NEAR * first for s in own):
        seen = {s.record for s in own}
        own += [s for i, part in enumerate(problem.parts) if i not in seen for s in seen_at(i, part, point, first)]
        force, sd = (np.array([getattr(s, key) / s.receptance for s in own]) for key in ("size", "sd"))
        rest += _misfit(force, np.ones_like(force), 1 / (sd**2 + (FORM * force) ** 2))
    beside = [s for s in found if s.family == LOUD and abs(np.log2(s.frequency / first)) > 2 * BAND]
    return {
        FOREIGN: {"foreign_vibration": float(rest)},
        LOUD: {"foreign_vibration": float(sum(s.chi2 for s in beside if not _harmonic(s.frequency, first)))},
    }


def near_rotation(problem: Problem, found: list[Sighting]) -> list[str]:
    """What is said of a tone of unknown origin so near the stated speed of rotation that this may be stated wrong."""
    said = []
    for s in found:
        record = problem.parts[s.record].record
        stated = record.experiment.speed_rpm / 60
        if s.family == FOREIGN and stated > 0 and abs(s.frequency / stated - 1) < SLIP:
            said.append(
                f"{record.name}: the vibration at {s.frequency:.4g} Hz is {100 * abs(s.frequency / stated - 1):.2g} % "
                f"from the stated rotation ({60 * stated:.6g} rpm are {stated:.4g} Hz); if that is not the measured "
                f"speed, state {60 * s.frequency:.5g} rpm: then it may be runout or unbalance"
            )
    return said


def _harmonic(frequency: float, first: float) -> bool:
    """Whether a frequency is one of the first harmonics of another one, within a band."""
    return any(abs(np.log2(frequency / (n * first))) < BAND / n for n in range(2, HARMONICS + 1))
