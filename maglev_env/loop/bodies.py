"""The equations of bodies on springs on the rotor, of effect support_resonance: a second one, and a further one."""

import numpy as np

from maglev_env.loop.system import System, Values

BODY = ("body", "body_velocity")  # of the second body, relative to the mover
FURTHER = ("further_body", "further_velocity")  # of one more


def mass_ratios(values: Values) -> tuple[np.ndarray, np.ndarray]:
    """Masses of the second body and of the further one over that of the rotor, (n,) each; 0 where there is none."""
    there = values.effect("support_resonance") > 0
    first, further = (values.effect("support_resonance", key) for key in ("mass_ratio", "further_ratio"))
    return np.where(there, first, 0.0), np.where(there, further, 0.0)


def with_bodies(system: System, values: Values, acceleration: np.ndarray, further: bool = True) -> np.ndarray:
    """The rotor's acceleration including the forces of the springs and dampers of the bodies on it.

    Relative to the rotor each body is an oscillator that the rotor's acceleration drives.

    Args:
        system: with all of BODY and, with `further`, of FURTHER, whose equations are written.
        values: of its lanes.
        acceleration: signal of the acceleration by all other forces, m per unit of time squared.
        further: whether the system has the further body.

    Returns:
        Signal of the rotor's acceleration, m per unit of time squared.
    """
    frequency, damping, times, own = (
        values.effect("support_resonance", key)
        for key in (None, "damping_ratio", "further_frequency", "further_damping")
    )
    bodies = [(BODY, frequency, damping), (FURTHER, frequency * times, own)][: 2 if further else 1]
    present = []
    for (names, hz, damped), ratio in zip(bodies, mass_ratios(values), strict=False):
        if not system.without(names, there := ratio > 0):
            returning = system.oscillator(names, hz, damped)
            acceleration = acceleration - ratio[:, None] * returning
            present.append((names, returning, there))
    for names, returning, there in present:
        system.put(names[1], returning - acceleration)
        system.there[:, system.at(*names)] = there[:, None]
    return acceleration
