"""A constant force on a rotor between opposed magnets, by where it rests.

Means are no evidence there: the zeros of both channels, a weight, a spring or an eccentricity may make them, and no
campaign states any of these. But between opposed magnets the pull changes with the place, so that a simulation which
rests elsewhere than the rotor did has another gain and another stiffness. A load of a tenth of what the magnets can
hold was named an eccentricity and a stop beside it.

What is lacking depends on the rig: a support that is stiffer than stated holds a rotor beside the centre with another
force. So the load is that of the rig near which a record is looked at, and not of the nominal one.

An eccentricity, or an offset of the current that pulls, is another reason to rest there: a hypothesis that has one is
simulated without that load, of which the means then need nothing. What is left of a load beside it is a nuisance, as
all of it is.
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Protocol, TypeVar

import numpy as np

from maglev_env.experiment import Experiment
from maglev_env.loop.effect import Effects, effect_value
from maglev_env.loop.magnets.law import ForceLaw, force, linearise
from sim2real.recorded.along_motion import NEAREST, Motion, currents, law_along

ECCENTRIC, OFFSET = "eccentricity", "actuator_offset"
RESTING = {ECCENTRIC, OFFSET}  # effects that say where a rotor rests between its magnets
LEAST = 1e-3  # of the gap: what a load moves the point at which the magnets alone balance, from which it counts


@dataclass(frozen=True)
class Load:
    """Constant forces with which a rotor between opposed magnets is simulated to rest where it was recorded.

    Args:
        force: (axes,), N.
        motion: What was recorded of its motion.
        felt: Mean measured force, (axes,), N.
    """

    force: np.ndarray
    motion: Motion
    felt: np.ndarray


class Loaded(Protocol):
    """A record, of whichever kind, that is simulated with a constant force."""

    load: Load | None
    waves: Mapping[str, np.ndarray]
    name: str

    @property
    def axes(self) -> int: ...


R = TypeVar("R", bound=Loaded)


def static_load(e: Experiment, motion: Motion, felt: np.ndarray) -> Load | None:
    """What the nominal magnets and springs lack along a recorded motion; None where a weight is carried by a single
    magnet, whose balance is that of its current, or where next to nothing is lacking.

    Args:
        e: The nominal experiment.
        motion: What was recorded.
        felt: Mean measured force, (axes,), N.
    """
    rig = e.rig
    if not rig.controlled:
        return None
    laws = [law_along(e, axis) for axis in range(e.rig.axes)]
    pairs = [law for law in laws if isinstance(law, ForceLaw)]
    if len(pairs) < len(laws):
        return None
    found = _lacking(e, pairs, motion, felt)
    least = np.array([LEAST * abs(linearise(law)[1]) * e.rig.gap for law in pairs])
    return Load(found, motion, felt) if (abs(found) > least).any() else None


def _lacking(e: Experiment, laws: Sequence[ForceLaw], motion: Motion, felt: np.ndarray) -> np.ndarray:
    """Forces (axes,) that magnets and springs of an experiment lack along a motion, N."""
    begin, end = (i + effect_value(e.effects, OFFSET) for i in currents(e, motion))
    near, y = NEAREST * e.rig.gap, motion.reading
    centred = np.clip(y + effect_value(e.effects, ECCENTRIC), -near, near)
    pull = [
        np.mean([force(law, at, own) for own in both]) for law, at, *both in zip(laws, centred, begin, end, strict=True)
    ]
    support = e.rig.support_stiffness * (1 + effect_value(e.effects, "support_stiffness"))
    return (support * y + _bent_springs(e.effects, y)).mean(axis=1) - np.array(pull) - felt


def _bent_springs(effects: Effects, y: np.ndarray) -> np.ndarray:
    """Force (N) towards the centre by cubic spring and stop at displacements y (m)."""
    stop = ("distance", "stiffness", "steepness")
    reach, stiffness, power = (effect_value(effects, "soft_stop", key) for key in stop)
    beyond = np.sign(y) * np.maximum(abs(y) - reach, 0.0)
    stopped = stiffness * beyond * (abs(beyond) / reach) ** (power - 1) if np.isfinite(reach) else 0.0
    return effect_value(effects, "cubic_spring") * y**3 + stopped


def balanced(record: R, e: Experiment) -> R:
    """The record with the load that the rig of an experiment needs to rest where it was recorded."""
    if record.load is None:
        return record
    laws = [law for axis in range(e.rig.axes) if isinstance(law := law_along(e, axis), ForceLaw)]
    own = _lacking(e, laws, record.load.motion, record.load.felt)
    waves = under_load(record.waves, own - record.load.force)
    return replace(record, waves=waves, load=replace(record.load, force=own))


def under_load(waves: Mapping[str, np.ndarray], load: np.ndarray) -> Mapping[str, np.ndarray]:
    """What drives a record, by place (axes, samples), with constant forces (axes,), N, if there are any."""
    return {**waves, "force": waves["force"] + load[:, None]}


def without_load(record: R) -> R:
    """The record of a rotor that rests where its own magnets balance, as one that is eccentric in them does."""
    return record if record.load is None else replace(record, waves=under_load(record.waves, -record.load.force))


def rests_otherwise(effects: Iterable[str]) -> bool:
    """Whether effects say where a rotor rests, so that it needs no load for it."""
    return not RESTING.isdisjoint(effects)


def resting(record: R, effects: Iterable[str]) -> R:
    """The record as it is simulated with these effects."""
    return without_load(record) if rests_otherwise(effects) else record


def with_load(record: R) -> R:
    """`without_load` backwards."""
    return record if record.load is None else replace(record, waves=under_load(record.waves, record.load.force))


def load_in_words(load: Load | None) -> list[str]:
    """What is said of a load, if there is one."""
    if load is None:
        return []
    sizes = ", ".join(f"{own:.2g}" for own in load.force)
    return [
        f"where the rotor rests, the nominal magnets lack a constant force of {sizes} N (a load or a weight, an "
        "eccentricity, or the zero of a channel; the means do not tell which): it is simulated with that force, "
        "except where an eccentricity or an offset of the current is taken for it"
    ]


def loads_off(record: R) -> dict[str, R]:
    """The record with twice the load of an axis, by a name: all of it may be something else than a load."""
    if record.load is None:
        return {}
    found = {}
    for axis, load in enumerate(record.load.force):
        more = np.where(np.arange(record.axes) == axis, load, 0.0)
        found[f"static load of {record.name}, axis {axis + 1}"] = replace(record, waves=under_load(record.waves, more))
    return found
