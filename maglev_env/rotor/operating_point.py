"""The rotor linearised where it runs: about the position to which its weight pulls it, and along its orbit."""

from dataclasses import replace

import numpy as np
import scipy

from maglev_env.loop.magnets.law import force
from maglev_env.loop.magnets.kinds import force_law
from maglev_env.rig.rig import with_parameters
from maglev_env.rotor.linear import (
    at_planes, control_matrices, control_response, controller_readings, controllers, held_current, mechanics,
    unbalance_response,
)  # fmt: skip
from maglev_env.rotor.rotor import Rotor

ANGLES = 64  # per turn; the harmonics of the force law decrease fast
INSIDE = 0.95  # of the clearance, up to which a position is looked for
ALIKE = 1e-3  # relative difference of slopes in x and y that is none
STEP_I, STEP_X = 1e-4, 1e-9  # steps of the differences, A and m


def sag(rotor: Rotor) -> np.ndarray:
    """Position q (4,), m and rad, ordered as `linear.MOTIONS`, at which the weight is carried; of the linear model."""
    m, load = mechanics(rotor), np.array([rotor.gravity[0], 0.0, rotor.gravity[1], 0.0]) * rotor.body.mass
    return np.linalg.solve(m.stiffness + m.drive @ _static_control(rotor), load)


def resting(rotor: Rotor) -> np.ndarray:
    """Position q (4,), m and rad, ordered as `linear.MOTIONS`, at which the weight is carried by the force law itself.

    The law pulls more than its tangent far from the centre, so a soft rotor sags less than `sag` says.

    Raises:
        ValueError: Nowhere in the gap.
    """
    control, law = _static_control(rotor), force_law(rotor.axis)
    load = np.array([rotor.gravity[0], 0.0, rotor.gravity[1], 0.0]) * rotor.body.mass
    at, gap = at_planes(*rotor.planes.magnets), rotor.axis.clearance
    fluid = rotor.fluid.stiffness * at.T @ at

    def missing(q: np.ndarray) -> np.ndarray:
        inside = np.clip(at @ q, -INSIDE * gap, INSIDE * gap)
        return at.T @ force(law, inside, -control @ q) / 2 + load - fluid @ q

    q = sag(rotor)
    if np.any(load):
        scale = np.where(np.arange(4) % 2, 1.0, gap)  # metres beside radians
        found = scipy.optimize.root(lambda u: missing(scale * u) / np.abs(load).max(), q / scale, tol=1e-10)
        q = scale * found.x
        if not found.success or np.abs(at @ q).max() >= INSIDE * gap:
            raise ValueError(f"rotor {rotor.axis.name}: its gains do not carry its weight within the gap")
    return q


def at_operating_point(rotor: Rotor, speed: float) -> Rotor:
    """The rotor with the actuator gain and stiffness that small motion beside its orbit at speed (rad/s) experiences.

    Both are slopes of the force law, averaged over a turn, over x and y and over the two bearings, along displacement
    and current of the linear model: the constant part of a loop that varies with the turn (Magnus and Winkler, Hill's
    equation). Differences between x and y, and the rotating part, are left out.
    """
    gain, stiffness = _slopes(rotor, speed)
    return _with_slopes(rotor, gain.mean(), stiffness.mean())


def by_direction(rotor: Rotor, speed: float) -> tuple[Rotor, ...]:
    """As `at_operating_point`, for motion in x and in y by itself; one rotor where the two do not differ.

    Across the weight the law is that of the centre, along it steeper where the rotor sags. What is required has to
    hold in both directions, and a mean of the two, as of a softer and a stiffer spring, says nothing of the softer.
    """
    slopes = np.array([one.reshape(2, 2).mean(axis=0) for one in _slopes(rotor, speed)])  # bearings, directions
    if np.allclose(*slopes.T, rtol=ALIKE, atol=0):
        return (_with_slopes(rotor, *slopes.mean(axis=1)),)
    return tuple(_with_slopes(rotor, *one) for one in slopes.T)


def _slopes(rotor: Rotor, speed: float) -> tuple[np.ndarray, np.ndarray]:
    """Actuator gain and stiffness (4,) at the magnets, ordered as `linear.AXES`, as means over a turn."""
    at, law = at_planes(*rotor.planes.magnets), force_law(rotor.axis)
    still = resting(rotor)
    x, i = (at @ still)[:, None], (-_static_control(rotor) @ still)[:, None]
    if speed:
        q, turns = unbalance_response(rotor, np.array([speed])), np.array([speed / (2 * np.pi)])
        moving, read = q[0], controller_readings(rotor, q, np.array([speed]))[0]
        forward = -held_current(rotor, turns) * (control_response(rotor, turns, speed)[0] @ read[::2])
        current = np.outer(forward, [1, -1j]).ravel()
        turn = np.exp(2j * np.pi * np.arange(ANGLES) / ANGLES)
        x, i = (still_part + np.outer(part, turn).real for still_part, part in ((x, at @ moving), (i, current)))
    gain = (force(law, x, i + STEP_I) - force(law, x, i - STEP_I)).mean(axis=1) / (2 * STEP_I)
    return gain, -(force(law, x + STEP_X, i) - force(law, x - STEP_X, i)).mean(axis=1) / (2 * STEP_X)


def _with_slopes(rotor: Rotor, gain: float, stiffness: float) -> Rotor:
    here = with_parameters(rotor.axis, {"actuator_gain": float(gain), "negative_stiffness": float(stiffness)})
    return replace(rotor, axis=here)


def _static_control(rotor: Rotor) -> np.ndarray:
    """Current that the controllers subtract at rest, A per m and rad of q, (4, 4)."""
    into, out = control_matrices(rotor)
    gains = np.diag([g.kp + g.ki for g in controllers(rotor)])
    return out @ gains @ into @ mechanics(rotor).probes
