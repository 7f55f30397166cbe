"""The levitated rotor linearised about the centre: modes, poles, unbalance response and sensitivity, in closed form.

The complex notation of isotropic rotors (Genta 2005; Schweitzer and Maslen 2009, ch. 10) is written in real x and y.
"""

from dataclasses import dataclass

import numpy as np
import scipy

from maglev_env.loop.gains import Gains, controller_response, state_space
from maglev_env.loop.magnets.law import linearise
from maglev_env.loop.magnets.kinds import force_law
from maglev_env.rotor.rotor import CONTROLS, Rotor

# Coordinates q = (x, tilt of x, y, tilt of y); planes and directions in the order (a, x), (a, y), (b, x), (b, y).
MOTIONS = ("x", "tilt_x", "y", "tilt_y")
AXES = ("a_x", "a_y", "b_x", "b_y")
LEAST_LAG = 1e-9  # s; replaces a lag of zero


@dataclass(frozen=True)
class Mechanics:
    """M q'' + (D + speed G) q' + K q = B i + f in m and rad.

    Attributes:
        mass: M, (4, 4).
        damping: D, (4, 4).
        gyroscopic: G, (4, 4), per rad/s.
        stiffness: K, (4, 4), with the magnets' negative stiffness and the fluid.
        drive: B, (4, 4), N or N m per ampere of each plane's coils.
        probes: From q to the readings, (4, 4).
    """

    mass: np.ndarray
    damping: np.ndarray
    gyroscopic: np.ndarray
    stiffness: np.ndarray
    drive: np.ndarray
    probes: np.ndarray


def at_planes(first: float, second: float) -> np.ndarray:
    """Matrix (4, 4), ordered as `AXES`, from q to the displacements in x and y at two positions (m) along the axis."""
    rows = [[1.0, z, 0.0, 0.0] if d == 0 else [0.0, 0.0, 1.0, z] for z in (first, second) for d in range(2)]
    return np.array(rows)


def mechanics(rotor: Rotor) -> Mechanics:
    """The mechanics linearised at the centre and at zero current."""
    gain, stiffness = linearise(force_law(rotor.axis))
    at = at_planes(*rotor.planes.magnets)
    inertia, polar = rotor.moving_inertia, rotor.body.polar_inertia
    turn = np.zeros((4, 4))
    turn[1, 3], turn[3, 1] = polar, -polar
    return Mechanics(
        np.diag([rotor.moving_mass, inertia, rotor.moving_mass, inertia]),
        rotor.fluid.damping * at.T @ at,
        turn,
        (stiffness / 2 + rotor.fluid.stiffness) * at.T @ at,
        gain / 2 * at.T,
        at_planes(*rotor.planes.probes),
    )


def undamped_frequencies(rotor: Rotor, stiffness: float, speed: float = 0.0) -> np.ndarray:
    """Natural frequencies (Hz) of the rotor on an undamped spring (N/m) in each direction at each magnet plane.

    They are the whirl modes at speed (rad/s), sorted; backward modes are negative.
    """
    # For x + i y and the tilts: M z'' - i speed G z' + K z = 0, whose solutions exp(i w t) rotate forward where w > 0.
    at = at_planes(*rotor.planes.magnets)[::2, :2]
    inverse = np.diag([1 / rotor.moving_mass, 1 / rotor.moving_inertia])
    turn = 1j * speed * inverse @ np.diag([0.0, rotor.body.polar_inertia])
    values = np.linalg.eigvals(np.block([[np.zeros((2, 2)), np.eye(2)], [-stiffness * inverse @ at.T @ at, turn]]))
    return np.sort(values.imag) / (2 * np.pi)


def control_matrices(rotor: Rotor) -> tuple[np.ndarray, np.ndarray]:
    """Matrices (4, 4) from readings to the controllers' inputs, and from their outputs to commands.

    Readings and commands are ordered as `AXES`; controllers as (first, x), (first, y), (second, x), (second, y).
    """
    if tuple(rotor.gains) == CONTROLS[0]:
        into, out = np.array([[0.5, 0.5], [-0.5, 0.5]]), np.array([[1.0, -1.0], [1.0, 1.0]])
    else:
        into = out = np.eye(2)
    return np.kron(into, np.eye(2)), np.kron(out, np.eye(2))


def controllers(rotor: Rotor) -> list[Gains]:
    """Gains of the four controllers: the first one in x and y, then the second one."""
    return [g for g in rotor.gains.values() for _ in range(2)]


def control_response(rotor: Rotor, frequency: np.ndarray) -> np.ndarray:
    """Responses of the four controllers to their errors (n, 4), A/m, at frequency (n,) Hz."""
    dt = 1 / rotor.axis.control_rate
    z = np.exp(2j * np.pi * np.asarray(frequency) * dt)
    return np.stack([controller_response(g, z, dt) for g in controllers(rotor)], axis=-1)


def held_current(rotor: Rotor, frequency: np.ndarray) -> np.ndarray:
    """Current per command (n,) at frequency (n,) Hz > 0: held over a control sample and delayed by the amplifier."""
    s, dt = 2j * np.pi * np.asarray(frequency), 1 / rotor.axis.control_rate
    return (1 - np.exp(-s * dt)) / (s * dt) / (1 + s * rotor.axis.amplifier_time_constant)


def continuous(rotor: Rotor, speed: float) -> np.ndarray:
    """Rate matrix (16, 24) of q, q', and the states of probes and amplifiers.

    Its columns are these states, the held commands (4) and the generalised forces (4) at the centre of mass.
    """
    m, axis = mechanics(rotor), rotor.axis
    n = len(MOTIONS)
    inverse = np.linalg.inv(m.mass)
    zero, one = np.zeros((n, n)), np.eye(n)
    probe = 1 / max(axis.sensor_time_constant, LEAST_LAG)
    amplifier = 1 / max(axis.amplifier_time_constant, LEAST_LAG)
    damping = -inverse @ (m.damping + speed * m.gyroscopic)
    return np.block(
        [
            [zero, one, zero, zero, zero, zero],
            [-inverse @ m.stiffness, damping, zero, inverse @ m.drive, zero, inverse],
            [probe * m.probes, zero, -probe * one, zero, zero, zero],
            [zero, zero, zero, -amplifier * one, amplifier * one, zero],
        ]
    )


def sampled(rotor: Rotor, speed: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """A (16, 16), B (16, 4) from held commands, C (4, 16) to readings, over one control sample at speed (rad/s)."""
    rates = continuous(rotor, speed)
    whole = scipy.linalg.expm(np.vstack([rates, np.zeros((8, 24))]) / rotor.axis.control_rate)
    return whole[:16, :16], whole[:16, 16:20], np.eye(16)[8:12]


def closed_loop_poles(rotor: Rotor, speed: float = 0.0) -> np.ndarray:
    """Poles (24,) of the sampled loop in the z-plane at speed (rad/s); stable when all lie inside the unit circle."""
    a, b, c = sampled(rotor, speed)
    into, out = control_matrices(rotor)
    parts = [state_space(g, 1 / rotor.axis.control_rate) for g in controllers(rotor)]
    ka, kb = scipy.linalg.block_diag(*(p[0] for p in parts)), scipy.linalg.block_diag(*(p[1][:, None] for p in parts))
    kc, kd = scipy.linalg.block_diag(*(p[2][None] for p in parts)), np.diag([p[3] for p in parts])
    read = into @ c
    return np.linalg.eigvals(np.block([[a - b @ out @ kd @ read, b @ out @ kc], [-kb @ read, ka]]))


def sensitivity(rotor: Rotor, frequency: np.ndarray, speed: float = 0.0) -> np.ndarray:
    """Response (n, 4, 4) of the controllers' outputs to an injection at these outputs, at frequency (Hz)."""
    a, b, c = sampled(rotor, speed)
    into, out = control_matrices(rotor)
    dt = 1 / rotor.axis.control_rate
    z = np.exp(2j * np.pi * np.asarray(frequency) * dt)
    plant = into @ c @ np.linalg.solve(z[:, None, None] * np.eye(16) - a, b @ out)
    return np.linalg.inv(np.eye(4) + control_response(rotor, frequency)[:, :, None] * plant)


def unbalance_response(rotor: Rotor, speeds: np.ndarray) -> np.ndarray:
    """Complex amplitudes (n, 4) of q against exp(i speed t) at speeds (n,) rad/s > 0, in the sampled loop.

    The response is to the unbalance and to the runout, which the probes feed back.
    """
    found = np.empty((len(speeds), 4), complex)
    into, out = control_matrices(rotor)
    dt = 1 / rotor.axis.control_rate
    for i, speed in enumerate(np.asarray(speeds, float)):
        rates = continuous(rotor, speed)
        force, runout = rotating(rotor, speed)
        # What rotates drives the states at exp(i w t): its own response, and in addition that of the held commands.
        driven = rates[:, 20:] @ force
        driven[8:12] += runout / max(rotor.axis.sensor_time_constant, LEAST_LAG)
        steady = np.linalg.solve(1j * speed * np.eye(16) - rates[:, :16], driven)
        a, b, c = sampled(rotor, speed)
        z = np.exp(1j * speed * dt)
        control = out @ np.diag(control_response(rotor, np.array([speed / (2 * np.pi)]))[0]) @ into
        # The states at the samples: steady + (z - A)^-1 B u, with u = -control C states.
        held = np.linalg.solve(z * np.eye(16) - a, b)
        states = np.linalg.solve(np.eye(16) + held @ control @ c, steady)
        found[i] = states[:4]
    return found


def rotating(rotor: Rotor, speed: float) -> tuple[np.ndarray, np.ndarray]:
    """Complex amplitudes against exp(i speed t): forces (4,) of the unbalance, and readings (4,) of the runout.

    A forward rotation is (1, -i) in x and y.
    """
    u, r = rotor.unbalance, rotor.runout
    couple = u.couple * np.exp(1j * np.radians(u.angle))
    force = speed**2 * np.array([u.static, couple, -1j * u.static, -1j * couple])
    phasor = np.array(r.amplitude) * np.exp(1j * np.radians(r.phase))
    return force, np.array([p * turn for p in phasor for turn in (1.0, -1j)])


def probe_readings(rotor: Rotor, q: np.ndarray, speeds: np.ndarray) -> np.ndarray:
    """Readings (n, 4) of the probes for motion q (n, 4) and the runout, against exp(i speed t) at speeds (n,) rad/s."""
    w = np.asarray(speeds)[:, None]
    seen = q @ mechanics(rotor).probes.T + rotating(rotor, 1.0)[1]
    return seen / (1 + 1j * w * rotor.axis.sensor_time_constant)
