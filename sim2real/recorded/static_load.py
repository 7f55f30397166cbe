"""A constant force on a rotor between opposed magnets, by where it rests.

Means are no evidence there: the zeros of both channels, a weight, a spring or an eccentricity may make them, and no
campaign states any of these. But between opposed magnets the pull changes with the place, so that a simulation which
rests elsewhere than the rotor did has another gain and another stiffness. A load of a tenth of what the magnets can
hold was named an eccentricity and a stop beside it.

An eccentricity, or an offset of the current that pulls, is another reason to rest there: a hypothesis that has one is
simulated without that load, of which the means then need nothing. What is left of a load beside it is a nuisance, as
all of it is.
"""

from collections.abc import Iterable, Mapping
from dataclasses import replace
from typing import Protocol, TypeVar

import numpy as np

from maglev_env.experiment import Experiment
from maglev_env.loop.effect import effect_value
from maglev_env.loop.magnets.law import ForceLaw, force, linearise
from sim2real.recorded.along_motion import NEAREST, Motion, currents, law_along

ECCENTRIC, OFFSET = "eccentricity", "actuator_offset"
RESTING = {ECCENTRIC, OFFSET}  # effects that say where a rotor rests between its magnets
LEAST = 1e-3  # of the gap: what a load moves the point at which the magnets alone balance, from which it counts


class Loaded(Protocol):
    """A record, of whichever kind, that is simulated with a constant force."""

    load: np.ndarray | None
    waves: Mapping[str, np.ndarray]
    name: str


R = TypeVar("R", bound=Loaded)


def static_load(e: Experiment, motion: Motion, felt: np.ndarray) -> np.ndarray | None:
    """Constant forces (axes,) that the nominal magnets and springs lack along a recorded motion, N; None where a weight
    is carried by a single magnet, whose balance is that of its current, or where next to nothing is lacking.

    Args:
        e: The nominal experiment.
        motion: What was recorded.
        felt: Mean measured force, (axes,), N.
    """
    rig = e.rig
    if not rig.controlled:
        return None
    found, notable = np.zeros(rig.axes), False
    begin, end = (i + effect_value(e.effects, OFFSET) for i in currents(e, motion))
    for axis in range(rig.axes):
        law = law_along(e, axis)
        if not isinstance(law, ForceLaw):
            return None
        centred = motion.reading[axis] + effect_value(e.effects, ECCENTRIC)
        place = np.clip(centred, -NEAREST * rig.gap, NEAREST * rig.gap)
        pull = np.mean([force(law, place, i[axis]) for i in (begin, end)])
        found[axis] = rig.support_stiffness * motion.reading[axis].mean() - pull - felt[axis]
        notable |= bool(abs(found[axis]) > LEAST * abs(linearise(law)[1]) * rig.gap)
    return found if notable else None


def under_load(waves: Mapping[str, np.ndarray], load: np.ndarray | None) -> Mapping[str, np.ndarray]:
    """What drives a record, by place (axes, samples), with constant forces (axes,), N, if there are any."""
    return waves if load is None else {**waves, "force": waves["force"] + load[:, None]}


def without_load(record: R) -> R:
    """The record of a rotor that rests where its own magnets balance, as one that is eccentric in them does."""
    return record if record.load is None else replace(record, waves=under_load(record.waves, -record.load))


def rests_otherwise(effects: Iterable[str]) -> bool:
    """Whether effects say where a rotor rests, so that it needs no load for it."""
    return not RESTING.isdisjoint(effects)


def resting(record: R, effects: Iterable[str]) -> R:
    """The record as it is simulated with these effects."""
    return without_load(record) if rests_otherwise(effects) else record


def with_load(record: R) -> R:
    """`without_load` backwards."""
    return replace(record, waves=under_load(record.waves, record.load))


def load_in_words(load: np.ndarray | None) -> list[str]:
    """What is said of a load, if there is one."""
    if load is None:
        return []
    sizes = ", ".join(f"{own:.2g}" for own in load)
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
    for axis, load in enumerate(record.load):
        more = np.where(np.arange(record.load.size) == axis, load, 0.0)
        found[f"static load of {record.name}, axis {axis + 1}"] = replace(record, waves=under_load(record.waves, more))
    return found
