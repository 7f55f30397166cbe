"""A constant force on a rotor between opposed magnets, by where it rests.

Means are no evidence there: the zeros of both channels, a weight, a spring or an eccentricity may make them, and no
campaign states any of these. But between opposed magnets the pull changes with the place, so that a simulation which
rests elsewhere than the rotor did has another gain and another stiffness. A load of a tenth of what the magnets can
hold was named an eccentricity and a stop beside it.

What is lacking depends on the rig: a support that is stiffer than stated holds a rotor beside the centre with another
force. So every rig that is simulated gets the load that it needs to rest where the rotor did, and none of them rests
elsewhere. An eccentricity, or an offset of the current that pulls, is another reason to rest there: a rig that has one
is simulated without a load, of which the means then need nothing. What is left of a load beside it is a nuisance, as
all of it is.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Protocol, TypeVar

import numpy as np

from maglev_env.experiment import Experiment
from maglev_env.loop.effect import Effects, effect_value
from maglev_env.loop.magnets.law import ForceLaw, force, linearise
from sim2real.recorded.along_motion import NEAREST, Motion, currents, law_along

ECCENTRIC, OFFSET = "eccentricity", "actuator_offset"
RESTING = (ECCENTRIC, OFFSET)  # effects that say where a rotor rests between its magnets
# Of the gap: what a load moves the point at which the magnets alone balance, from which it counts, and from which it is
# said, because half a step of a converter moves it by less.
LEAST, SAID = 1e-3, 1e-2
SAMPLES = 4000  # of a motion, that tell its mean pull


@dataclass(frozen=True)
class Load:
    """The constant force with which a rig between opposed magnets rests where a rotor was recorded.

    Args:
        nominal: What the nominal rig needs, (axes,), N.
        place: Displacement at some samples, (axes, n), m.
        current: At the begin and at the end of the control steps of these samples, (2, axes, n), A.
        felt: Mean measured force, (axes,), N.
        said: Whether it is large enough to be said.
    """

    nominal: np.ndarray
    place: np.ndarray
    current: np.ndarray
    felt: np.ndarray
    said: bool = True

    def __call__(self, e: Experiment) -> np.ndarray:
        """What the rig of an experiment needs, (axes,), N; none where an effect that it has not by itself says where it
        rests.
        """
        if any(effect_value(e.effects, name) != effect_value(e.rig.effects, name) for name in RESTING):
            return np.zeros_like(self.nominal)
        return _lacking(e, self)


class Loaded(Protocol):
    """A record, of whichever kind, that is simulated with a constant force."""

    load: Load | None
    waves: Mapping[str, np.ndarray]
    name: str

    @property
    def axes(self) -> int: ...


R = TypeVar("R", bound=Loaded)


def static_load(e: Experiment, motion: Motion, felt: np.ndarray) -> Load | None:
    """What magnets and springs lack along a recorded motion; None where a weight is carried by a single magnet, whose
    balance is that of its current, or where the nominal rig lacks next to nothing.

    Args:
        e: The nominal experiment.
        motion: What was recorded.
        felt: Mean measured force, (axes,), N.
    """
    rig = e.rig
    if not rig.controlled:
        return None
    laws = [law_along(e, axis) for axis in range(rig.axes)]
    pairs = [law for law in laws if isinstance(law, ForceLaw)]
    if len(pairs) < len(laws):
        return None
    n = motion.reading.shape[1]
    some = np.unique(np.linspace(0, n - 1, SAMPLES).round().astype(int))
    found = Load(np.zeros(rig.axes), motion.reading[:, some], np.array(currents(e, motion))[..., some], felt)
    lacking = _lacking(e, found)
    moves = abs(lacking) / [abs(linearise(law)[1]) * rig.gap for law in pairs]
    return replace(found, nominal=lacking, said=bool((moves > SAID).any())) if (moves > LEAST).any() else None


def _lacking(e: Experiment, load: Load) -> np.ndarray:
    """Forces (axes,) that magnets and springs of an experiment lack along a motion, N."""
    near, y = NEAREST * e.rig.gap, load.place
    current = load.current + effect_value(e.effects, OFFSET)
    centred = np.clip(y + effect_value(e.effects, ECCENTRIC), -near, near)
    laws = [law_along(e, axis) for axis in range(e.rig.axes)]
    pull = [force(law, centred[axis], current[:, axis]).mean() for axis, law in enumerate(laws)]
    support = e.rig.support_stiffness * (1 + effect_value(e.effects, "support_stiffness"))
    return (support * y + _bent_springs(e.effects, y)).mean(axis=1) - np.array(pull) - load.felt


def _bent_springs(effects: Effects, y: np.ndarray) -> np.ndarray:
    """Force (N) towards the centre by cubic spring and stop at displacements y (m)."""
    stop = ("distance", "stiffness", "steepness", "side")
    reach, stiffness, power, side = (effect_value(effects, "soft_stop", key) for key in stop)
    beyond = np.sign(y) * np.maximum(abs(y) - reach, 0.0)
    share = 1 - np.maximum(-np.sign(y) * side, 0.0)
    stopped = stiffness * share * beyond * (abs(beyond) / reach) ** (power - 1) if np.isfinite(reach) else 0.0
    return effect_value(effects, "cubic_spring") * y**3 + stopped


def load_in_words(load: Load | None, recording: str) -> list[str]:
    """What is said of the load of a recording, if there is one."""
    if load is None or not load.said:
        return []
    sizes = ", ".join(f"{own:.2g}" for own in load.nominal)
    return [
        f"{recording}: where the rotor rests, the nominal magnets lack a constant force of {sizes} N (a load or a "
        "weight, an eccentricity, the zero of a channel, or beside the centre another stiffness; the means do not tell "
        "which): it is simulated with that force, except where an eccentricity or an offset of the current is taken "
        "for it"
    ]


def loads_off(record: R) -> dict[str, R]:
    """The record with twice the load of an axis, by a name: all of it may be something else than a load."""
    if record.load is None:
        return {}
    found = {}
    for axis, load in enumerate(record.load.nominal):
        more = np.where(np.arange(record.axes) == axis, load, 0.0)
        waves = {**record.waves, "force": record.waves["force"] + more[:, None]}
        found[f"static load of {record.name}, axis {axis + 1}"] = replace(record, waves=waves)
    return found
