"""The parameters of a batch of one-axis experiments, as the blocks of the loop read them."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from maglev_env.experiment import Experiment
from maglev_env.loop.bodies import mass_ratios
from maglev_env.loop.effect import Effects, effect_value
from maglev_env.loop.magnets.kinds import force_law
from maglev_env.loop.magnets.law import ForceLaw, SingleSidedLaw, reshaped, with_distances_over
from maglev_env.rig.rig import Rig


@dataclass(frozen=True)
class LaneValues:
    """Lanes of one-axis rigs with their effects; implements `Values`, which the blocks of the loop read.

    Args:
        rigs: of every lane, with one axis each.
        effects: of every lane.
        speeds: speed of rotation of every lane, 1/min; may be empty if no lane rotates.
    """

    rigs: tuple[Rig, ...]
    effects: tuple[Effects, ...]
    speeds: tuple[float, ...] = ()

    def effect(self, name: str, parameter: str | None = None) -> np.ndarray:
        """A parameter of an effect (default: its first) in every lane, (n,); where absent, its neutral value."""
        if name not in self._present:
            return np.full(len(self.effects), effect_value({}, name, parameter))
        return np.array([effect_value(effects, name, parameter) for effects in self.effects], float)

    @cached_property
    def _present(self) -> frozenset[str]:
        """Names of the effects that any lane has."""
        return frozenset(name for effects in self.effects for name in effects)

    @cached_property
    def _same_rig(self) -> bool:
        """Whether all lanes have one rig, as those of a sweep."""
        return all(rig is self.rigs[0] for rig in self.rigs)

    def rig(self, name: str) -> np.ndarray:
        """A parameter of the rig in every lane, (n,)."""
        if self._same_rig:
            return np.full(len(self.rigs), getattr(self.rigs[0], name))
        return np.array([getattr(rig, name) for rig in self.rigs])

    @cached_property
    def mass(self) -> np.ndarray:
        """Mass (kg) of the mover, including the effect mass and without bodies on springs that belong to it, (n,)."""
        ratio = sum(mass_ratios(self))
        hung = self.effect("support_resonance", "inside") * ratio / (1 + ratio)
        return self.rig("mass") * (1 + self.effect("mass")) * (1 - hung)

    @cached_property
    def laws(self) -> tuple[ForceLaw | SingleSidedLaw | None, ...]:
        """Force law of each lane with the changes of its shape; None without magnets. Changes of its gain and of its
        stiffness at rest are applied elsewhere."""
        if not self._same_rig:
            plain = [force_law(rig) if rig.controlled else None for rig in self.rigs]
        else:
            plain = [force_law(self.rigs[0]) if self.rigs[0].controlled else None] * len(self.rigs)
        return tuple(law and shaped_law(law, own) for law, own in zip(plain, self.effects, strict=True))

    @property
    def inductance(self) -> np.ndarray:
        """Inductance of the coil (H), infinite if the rig does not give it, (n,)."""
        return np.array([rig.coil_inductance or np.inf for rig in self.rigs])

    @property
    def noise(self) -> np.ndarray:
        """Rms of the reading's noise (m), (n,)."""
        return np.array([rig.noise.displacement for rig in self.rigs])

    @property
    def speed(self) -> np.ndarray:
        """Speed of rotation (rad/s), (n,)."""
        return 2 * np.pi / 60 * np.array(self.speeds)


def shaped_law(law: ForceLaw | SingleSidedLaw, effects: Effects) -> ForceLaw | SingleSidedLaw:
    """The law as the effect force_law reshapes it, and as the forms of the effects of gain and stiffness do.

    By the form of actuator_gain, (1 + change)^force_share of the change scales the force and not the current. By that
    of negative_stiffness, distances are divided by (1 + change)^distance_share; the rest of that change scales the pull
    without current. So neither gain nor stiffness at rest depends on the form.
    """
    exponent, offset = (effect_value(effects, "force_law", key) for key in ("exponent", "offset"))
    own = reshaped(law, exponent, offset) if exponent or offset else law
    if force := _form_factor(effects, "actuator_gain", "force_share"):
        own = replace(own, force_scale=own.force_scale * force, gain_scale=own.gain_scale / force)
    if nearer := _form_factor(effects, "negative_stiffness", "distance_share"):
        own = replace(with_distances_over(own, nearer), stiffness_scale=own.stiffness_scale / nearer)
    return own


def _form_factor(effects: Effects, name: str, share: str) -> float | None:
    """(1 + change)^share of an effect that has both; None where it has not."""
    change, part = (effect_value(effects, name, key) for key in ("change", share))
    return (1 + change) ** part if change and part else None


def lane_values(own: Sequence[Experiment]) -> LaneValues:
    """The values of one-axis experiments, one lane each."""
    return LaneValues(tuple(e.rig for e in own), tuple(e.effects for e in own), tuple(e.speed_rpm for e in own))
