"""Exact linear chains of a lane: what poles between command, force and reading do over one integration step."""

from collections.abc import Sequence

import numpy as np

from maglev_env.loop.effect import effect_value, split_delay
from maglev_env.experiment import Experiment, moving_mass
from maglev_env.loop.magnets.law import linearise
from maglev_env.loop.magnets.kinds import force_law
from maglev_lanes.matrix_exponential import expm

# Derivatives at the start of the cubic with values and slopes (y0, v0, y1, v1) at both ends of a unit step.
HERMITE = np.array([[1, 0, 0, 0], [0, 1, 0, 0], [-6, -4, 6, -2], [12, 6, -12, 6]])


def steps(own: Sequence[Experiment]) -> np.ndarray:
    """Control steps, s."""
    return np.array([1 / e.rig.control_rate for e in own])


def delays(own: Sequence[Experiment]) -> tuple[np.ndarray, np.ndarray]:
    """Whole samples and the rest (s) of every delay."""
    whole, fraction = np.array([split_delay(e.effects, 1 / e.rig.control_rate) for e in own]).T
    return whole, fraction


def sensor_poles(own: Sequence[Experiment]) -> np.ndarray:
    """Time constants (s) of the probe and its further lag, those that are there first, (n, 2)."""
    return _poles([(e.rig.sensor_time_constant, effect_value(e.effects, "sensor_lag")) for e in own])


def amplifier_poles(own: Sequence[Experiment]) -> np.ndarray:
    """Time constants (s) of the amplifier and its further lag, those that are there first, (n, 2)."""
    return _poles([(e.rig.amplifier_time_constant, effect_value(e.effects, "amplifier_lag")) for e in own])


def actuator(e: Experiment) -> tuple[float, float]:
    """The force law's current scale, and the acceleration per ampere (m/s2 A) at the centre."""
    if not e.rig.controlled:
        return 1.0, 0.0
    law, change = force_law(e.rig), 1 + effect_value(e.effects, "actuator_gain")
    return law.gain_scale * change, linearise(law)[0] * change / moving_mass(e)


def _poles(pairs: list[tuple[float, float]]) -> np.ndarray:
    """Non-zero time constants first, shape (n, 2)."""
    return np.array([sorted(pair, key=lambda t: t == 0) for pair in pairs])


def sensor_rows(poles: np.ndarray, h: np.ndarray) -> np.ndarray:
    """Next probe states from (z1, z2, y0, h v0, y1, h v1) with y the cubic through both ends; shape (12, n)."""
    n = len(poles)
    # States z1, z2 and the scaled derivatives y, h y', h^2 y'', h^3 y''' of the cubic, over one unit of tau / h.
    a = np.zeros((n, 6, 6))
    _put_poles(a, poles, h, first=0, source=2)
    a[:, 2, 3] = a[:, 3, 4] = a[:, 4, 5] = 1.0
    step = expm(a)[:, :2]
    rows = np.concatenate([step[:, :, :2], step[:, :, 2:] @ HERMITE], axis=2)
    return rows.reshape(n, 12).T


def sensor_current_rows(
    sensor: np.ndarray, amplifier: np.ndarray, h: np.ndarray, switch: np.ndarray, pull: np.ndarray, cubic: np.ndarray
) -> np.ndarray:
    """What the probe states gain over the cubic motion, from (x1, x2, old command, new command); shape (8, n).

    The current bends the motion inside a step by more than a cubic can follow. Its exact effect on the probe, with
    the acceleration pull (m per step^2 and ampere) of the centred rotor, less what the cubic through the ends of that
    same motion gives.
    """
    n = len(sensor)
    # States x1, x2, command, y, v, z1, z2, over one unit of tau / h.
    a = np.zeros((n, 7, 7))
    source = _put_poles(a, amplifier, h, first=0, source=2)
    a[:, 4, source], a[:, 3, 4] = pull, 1.0
    _put_poles(a, sensor, h, first=5, source=3)
    end = switched(a, switch / h, np.ones(n))
    rows = cubic.T.reshape(n, 2, 6)
    return (end[:, 5:7] - rows[:, :, 4:] @ end[:, 3:5]).reshape(n, 8).T


def _put_poles(a: np.ndarray, poles: np.ndarray, h: np.ndarray, first: int, source: int) -> int:
    """Write a cascade of poles into the system matrices a, fed by state `source`; returns its output state."""
    for j in range(poles.shape[1]):
        rate = h / poles[:, j]
        a[:, first + j, first + j], a[:, first + j, source] = -rate, rate
        source = first + j
    return source


def actuator_rows(poles: np.ndarray, h: np.ndarray, switch: np.ndarray) -> np.ndarray:
    """Next states and nodal currents from (x1, x2, old command, new command); shape (20, n).

    The new command acts from `switch` (s) on. The three nodal currents c0, c1, c2 stand for the current in the
    integration step so that its impulse (c0 + 4 c1 + c2) h / 6 and its displacement (c0 + 2 c1) h^2 / 6 are exact.
    """
    n, order = poles.shape
    # States x1, x2, command, integral and double integral of the current, over one unit of tau / h.
    a = np.zeros((n, 5, 5))
    source = _put_poles(a, poles, h, first=0, source=2)
    a[:, 3, source] = a[:, 4, 3] = 1.0
    s = switch / h
    full = switched(a, s, np.ones(n))
    middle = switched(a, np.minimum(s, 0.5), np.full(n, 0.5))
    mean, moment = full[:, 3], 2 * full[:, 4]
    # Without a pole the command itself may jump inside the step: its mean stands for the middle.
    c1 = middle[:, order - 1] if order else mean
    c0 = 3 * moment - 2 * c1
    c2 = 6 * mean - 4 * c1 - c0
    next_states = full[:, :2].copy()
    next_states[:, order:] = 0.0
    return np.concatenate([next_states, c0[:, None], c1[:, None], c2[:, None]], axis=1).reshape(n, 20).T


def switched(a: np.ndarray, switch: np.ndarray, end: np.ndarray, command: int = 2) -> np.ndarray:
    """State map (n, states, command + 2) over [0, end] from the states before the command, the old and the new one:
    state `command`, that changes at `switch`."""
    first = expm(a * switch[:, None, None])
    second = expm(a * (end - switch)[:, None, None])
    state = np.concatenate([first[:, :, : command + 1], np.zeros((*a.shape[:2], 1))], axis=2)
    state[:, command] = 0.0
    state[:, command, -1] = 1.0
    return second @ state
