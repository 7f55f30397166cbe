"""Exact discretisation of the linear parts of a lane: the poles between command, force and reading over one step.

The blocks of the loop write the equations; the unit of time is the integration step h, so velocities are h v and
accelerations h^2 a.
"""

from collections.abc import Sequence

import numpy as np

from maglev_env.experiment import Experiment
from maglev_env.loop import amplifier, sensor
from maglev_env.loop.effect import split_delay
from maglev_env.loop.mechanics import MOTION
from maglev_env.loop.system import System, Values
from maglev_lanes.matrix_exponential import expm

# A motion y as a cubic: its derivatives are states, and their initial values follow from the values and slopes
# (y0, v0, y1, v1) at both ends of a unit step.
CUBIC = ("y", "y'", "y''", "y'''")
HERMITE = np.array([[1, 0, 0, 0], [0, 1, 0, 0], [-6, -4, 6, -2], [12, 6, -12, 6]])


def steps(own: Sequence[Experiment]) -> np.ndarray:
    """Control steps, s."""
    return np.array([1 / e.rig.control_rate for e in own])


def delays(own: Sequence[Experiment]) -> tuple[np.ndarray, np.ndarray]:
    """Number of whole samples, and the remaining time (s), of every delay."""
    whole, fraction = np.array([split_delay(e.effects, 1 / e.rig.control_rate) for e in own]).T
    return whole, fraction


def sensor_rows(values: Values, h: np.ndarray) -> np.ndarray:
    """Next probe states from (z1, z2, y0, h v0, y1, h v1) with y the cubic through both ends; shape (12, n)."""
    system = System((*sensor.PROBE, *CUBIC), h, packed=True)
    sensor.probe(system, values, system.signal("y"))
    system.integrate(CUBIC)
    step = system.shown[:, :2] @ expm(system.a)  # an absent pole shows what enters it
    rows = np.concatenate([step[:, :, :2], step[:, :, 2:] @ HERMITE], axis=2)
    return rows.reshape(len(h), 12).T


def sensor_current_rows(
    driving: Values, seeing: Values, h: np.ndarray, switch: np.ndarray, pull: np.ndarray, cubic: np.ndarray
) -> np.ndarray:
    """Corrections of the probe states, coefficients of (x1, x2, old command, new command); shape (8, n).

    Within a step the current changes the motion in a way that a cubic cannot represent. The correction is the exact
    effect of the current on the probe of the centred rotor minus that of the cubic through the ends of the same motion.

    Args:
        driving: lanes whose amplifiers carry the current.
        seeing: lanes whose probes see the motion.
        h: integration steps, s, (n,).
        switch: times at which the new command begins to act, s, (n,).
        pull: acceleration, m per step^2 and ampere, (n,).
        cubic: the probes' `sensor_rows`.
    """
    n = len(h)
    system = System((*amplifier.STATES, "command", *MOTION, *sensor.PROBE), h, packed=True)
    coil = amplifier.coil_current(system, driving, system.signal("command"))
    position, velocity = MOTION
    system.integrate(MOTION)
    system.put(velocity, pull[:, None] * coil)
    sensor.probe(system, seeing, system.signal(position))
    end = switched(system.a, switch / h, np.ones(n))
    rows = cubic.T.reshape(n, 2, 6)
    return (system.shown[:, 5:7] @ end - rows[:, :, 4:] @ end[:, 3:5]).reshape(n, 8).T


def actuator_rows(values: Values, h: np.ndarray, switch: np.ndarray) -> np.ndarray:
    """Next states and nodal currents (see `nodal`) from (x1, x2, old command, new command); shape (20, n).

    The new command acts from `switch` (s) on. An absent pole shows what enters it.
    """
    n = len(h)
    system = System((*amplifier.STATES, "command", "impulse", "displacement"), h, packed=True)
    coil = amplifier.coil_current(system, values, system.signal("command"))
    system.put("impulse", coil)
    system.integrate(("displacement", "impulse"))
    s, there = switch / h, system.there[:, :2]
    full = switched(system.a, s, np.ones(n))
    halfway = switched(system.a, np.minimum(s, 0.5), np.full(n, 0.5))
    mean = full[:, 3]
    middle = np.where(there.any(axis=1)[:, None], np.einsum("ni,nij->nj", coil, halfway), mean)
    return np.concatenate([system.shown[:, :2] @ full, nodal(mean, full[:, 4], middle)], axis=1).reshape(n, 20).T


def nodal(impulse: np.ndarray, displacement: np.ndarray, middle: np.ndarray) -> np.ndarray:
    """Three currents c0, c1, c2 that represent the current in the integration step, (n, 3, .).

    They give the exact impulse (c0 + 4 c1 + c2) h / 6 and the exact displacement (c0 + 2 c1) h^2 / 6, and c1 is the
    current in the middle of the step. Without a pole the current may jump inside the step; then the mean (the impulse)
    is used for the middle.
    """
    c0 = 3 * (2 * displacement) - 2 * middle
    return np.stack([c0, middle, 6 * impulse - 4 * middle - c0], axis=1)


def switched(a: np.ndarray, switch: np.ndarray, end: np.ndarray, command: int = 2) -> np.ndarray:
    """State map over [0, end] with a command that changes from old to new at `switch`.

    Returns:
        (n, states, command + 2), from the states before state number `command`, the old and the new command.
    """
    first = expm(a * switch[:, None, None])
    second = expm(a * (end - switch)[:, None, None])
    state = np.concatenate([first[:, :, : command + 1], np.zeros((*a.shape[:2], 1))], axis=2)
    state[:, command] = 0.0
    state[:, command, -1] = 1.0
    return second @ state
