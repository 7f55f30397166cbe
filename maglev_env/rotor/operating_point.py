"""The rotor linearised where it runs: about the position to which its weight pulls it, and along its orbit."""

from dataclasses import replace

import numpy as np

from maglev_env.loop.magnets.law import force
from maglev_env.loop.magnets.kinds import force_law
from maglev_env.rig.rig import with_parameters
from maglev_env.rotor.linear import (
    at_planes, control_matrices, control_response, controllers, held_current, mechanics, probe_readings,
    unbalance_response,
)  # fmt: skip
from maglev_env.rotor.rotor import Rotor

ANGLES = 64  # per turn; the harmonics of the force law decrease fast
STEP_I, STEP_X = 1e-4, 1e-9  # steps of the differences, A and m


def sag(rotor: Rotor) -> np.ndarray:
    """Position q (4,), m and rad, ordered as `linear.MOTIONS`, at which the weight is carried; of the linear model."""
    m, load = mechanics(rotor), np.array([rotor.gravity[0], 0.0, rotor.gravity[1], 0.0]) * rotor.body.mass
    return np.linalg.solve(m.stiffness + m.drive @ _static_control(rotor), load)


def at_operating_point(rotor: Rotor, speed: float) -> Rotor:
    """The rotor with the actuator gain and stiffness that small motion beside its orbit at speed (rad/s) experiences.

    Both are slopes of the force law, averaged over a turn, over x and y and over the two bearings, along displacement
    and current of the linear model: the constant part of a loop that varies with the turn (Magnus and Winkler, Hill's
    equation). Differences between x and y, and the rotating part, are left out.
    """
    axis, at, law = rotor.axis, at_planes(*rotor.planes.magnets), force_law(rotor.axis)
    still = sag(rotor)
    x, i = (at @ still)[:, None], (-_static_control(rotor) @ still)[:, None]
    if speed:
        q, turns = unbalance_response(rotor, np.array([speed])), np.array([speed / (2 * np.pi)])
        moving, read = q[0], probe_readings(rotor, q, np.array([speed]))[0]
        forward = -held_current(rotor, turns) * (control_response(rotor, turns, speed)[0] @ read[::2])
        current = np.outer(forward, [1, -1j]).ravel()
        turn = np.exp(2j * np.pi * np.arange(ANGLES) / ANGLES)
        x, i = (still_part + np.outer(part, turn).real for still_part, part in ((x, at @ moving), (i, current)))
    gain = np.mean(force(law, x, i + STEP_I) - force(law, x, i - STEP_I)) / (2 * STEP_I)
    stiffness = -np.mean(force(law, x + STEP_X, i) - force(law, x - STEP_X, i)) / (2 * STEP_X)
    here = with_parameters(axis, {"actuator_gain": float(gain), "negative_stiffness": float(stiffness)})
    return replace(rotor, axis=here)


def _static_control(rotor: Rotor) -> np.ndarray:
    """Current that the controllers subtract at rest, A per m and rad of q, (4, 4)."""
    into, out = control_matrices(rotor)
    gains = np.diag([g.kp + g.ki for g in controllers(rotor)])
    return out @ gains @ into @ mechanics(rotor).probes
