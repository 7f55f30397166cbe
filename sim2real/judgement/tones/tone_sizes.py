"""How large the tones are that have a name, and the parameters of what makes them."""

from collections.abc import Sequence
from dataclasses import dataclass
from math import hypot, pi

import numpy as np

from maglev_env.loop.effect import EFFECTS
from sim2real.compared.problem import Problem
from sim2real.judgement.tones.sightings import FOREIGN, Sighting
from sim2real.judgement.tones.unsynchronised import FORM
from sim2real.recorded.tones import MAINS, NEAR
from sim2real.words import quantity

TOLD = 3.0  # standard errors of a size from which a higher harmonic is listed


@dataclass(frozen=True)
class ToneSize:
    """A tone of a named origin.

    Attributes:
        harmonic: Its order; 1 is the fundamental.
        frequency: Hz, where it is clearest.
        value: Its amplitude in the unit of the effect's size.
        se: Standard error of that.
    """

    harmonic: int
    frequency: float
    value: float
    se: float


def tone_sizes(problem: Problem, found: Sequence[Sighting], effect: str) -> tuple[ToneSize, ...]:
    """The tones of an effect that are told, the fundamental first; empty where none is.

    Args:
        problem: The campaign.
        found: All sightings.
        effect: The name of one that makes tones.
    """
    own = [(_own_size(problem, s, effect), s) for s in _of(found, effect) if s.harmonic]
    sizes = []
    for harmonic in sorted({s.harmonic for _, s in own}):
        rows = [(unit, s) for unit, s in own if s.harmonic == harmonic]
        records = [_whole([row for row in rows if row[1].record == i]) for i in sorted({s.record for _, s in rows})]
        value, sd = (np.array(column) for column in zip(*records, strict=True))
        weight = 1 / (sd**2 + (FORM * value) ** 2)
        mean = float((weight * value).sum() / weight.sum())
        spread = float((weight * (value - mean) ** 2).sum()) / max(len(value) - 1, 1)
        se = float(np.sqrt(max(spread, 1.0) / weight.sum()))
        clearest = max((s for _, s in rows), key=lambda s: s.chi2)
        if harmonic == 1 or mean > TOLD * se:
            sizes.append(ToneSize(harmonic, clearest.frequency, mean, se))
    return tuple(sizes)


def tone_parameters(problem: Problem, found: Sequence[Sighting], effect: str) -> dict[str, float]:
    """Parameters of what makes tones from their sightings; phases keep their default."""
    sizes = {s.harmonic: s for s in tone_sizes(problem, found, effect)}
    if not sizes:
        return {_size(effect): 0.0, "phase": 0.0}
    first = sizes.get(1) or max(sizes.values(), key=lambda s: s.value)
    parameters = {_size(effect): first.value, "phase": 0.0}
    if effect == "foreign_vibration":
        parameters["frequency"] = first.frequency
    if "harmonics" in EFFECTS[effect].parameters:
        second = sizes[2].value if 1 in sizes and 2 in sizes else 0.0
        parameters["harmonics"] = float(np.clip(second / first.value, 0.0, 0.9)) if first.value else 0.0
    if effect == "pickup":
        parameters["frequency"] = min(MAINS, key=lambda f: abs(f - first.frequency / first.harmonic))
    return parameters


def tones_in_words(effect: str, sizes: Sequence[ToneSize], intervals: float = 1.0) -> str:
    """The tones of an effect, each with so many standard errors: "pickup 600 +- 9 nm at 50.03 Hz"."""
    unit = EFFECTS[effect].parameters[_size(effect)].unit
    listed = [f"{quantity(s.value, intervals * s.se, unit)} at {s.frequency:.4g} Hz" for s in sizes]
    return f"{effect} {' and '.join(listed)}"


def _size(effect: str) -> str:
    """The parameter that is the size of a tone: the first one of its effect."""
    return next(iter(EFFECTS[effect].parameters))


def _of(found: Sequence[Sighting], effect: str) -> list[Sighting]:
    """The sightings of an effect's tones."""
    if effect == "foreign_vibration":
        shaken = [s for s in found if s.family == FOREIGN]
        if not shaken:
            return []
        loudest = max(shaken, key=lambda s: s.chi2)
        return [s for s in shaken if abs(s.frequency - loudest.frequency) < 2 * NEAR * loudest.frequency]
    family = "spin" if effect in ("runout", "unbalance") else "pickup"
    own = [s for s in found if s.family.startswith(family)] or [s for s in found if s.family == "spin"]
    return [s for s in own if s.harmonic == 1] if effect == "unbalance" else own


def _own_size(problem: Problem, s: Sighting, effect: str) -> float:
    """What one metre of a sighting's size is in the unit of the effect's size."""
    if effect == "foreign_vibration":
        return 1 / s.receptance
    if effect == "unbalance":
        speed = problem.parts[s.record].record.experiment.speed_rpm * pi / 30
        return 1 / (s.receptance * speed**2)
    return 1.0


def _whole(parts: Sequence[tuple[float, Sighting]]) -> tuple[float, float]:
    """One tone of a record and its standard deviation, of which parts were seen apart, as beside a line of its
    excitation and on it. How their phases lie is not known."""
    sizes = [unit * s.size for unit, s in parts]
    rest = sum(sizes) - max(sizes)
    return sum(sizes), max(hypot(*(unit * s.sd for unit, s in parts), rest / 2), 1e-300)
