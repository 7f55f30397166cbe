"""The levitated rotor linearised about the centre: modes, poles, unbalance response and sensitivity, in closed form.

In isotropic bearings x + i y is one complex coordinate (Genta 2005; Schweitzer and Maslen 2009, ch. 10): the loop has
half of the states, with complex coefficients, and its response at a negative frequency is that to a backward rotation.
"""

from dataclasses import dataclass, replace

import numpy as np
import scipy

from maglev_env.loop.gains import Gains, controller_response, state_space
from maglev_env.loop.magnets.law import linearise
from maglev_env.loop.magnets.kinds import force_law
from maglev_env.rotor.rotor import CONTROLS, Rotor
from selfsense.baseband import baseband, growth_rate

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
        probes: From q to the displacements that the controllers read, (4, 4).
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
        at_planes(*rotor.read_planes),
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
    Translation reads the motion of the centre of mass, and its currents push there without turning the rotor; tilt
    reads half the difference of both planes, and its currents turn the rotor without pushing it, wherever the planes
    are. About the middle between equal arms that is the mean of both planes and equal currents.
    """
    if tuple(rotor.gains) == CONTROLS[0]:
        (a, b), (c, d) = rotor.read_planes, rotor.planes.magnets
        into = np.array([[b / (b - a), -a / (b - a)], [-0.5, 0.5]])
        out = np.array([[2 * d / (d - c), -1.0], [-2 * c / (d - c), 1.0]])
    else:
        into = out = np.eye(2)
    return np.kron(into, np.eye(2)), np.kron(out, np.eye(2))


def controllers(rotor: Rotor) -> list[Gains]:
    """Gains of the four controllers: the first one in x and y, then the second one."""
    return [g for g in rotor.gains.values() for _ in range(2)]


def held_current(rotor: Rotor, frequency: np.ndarray) -> np.ndarray:
    """Current per command (n,) at frequency (n,) Hz, not 0: held over a control sample and delayed by the amplifier."""
    s, dt = 2j * np.pi * np.asarray(frequency), 1 / rotor.axis.control_rate
    return (1 - np.exp(-s * dt)) / (s * dt) / (1 + s * rotor.axis.amplifier_time_constant)


def reading(rotor: Rotor) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """A (n, n), B (n,), C (n,) in continuous time from a displacement (m) to its reading (m).

    A probe has one state. A self-sensor is that of the one-axis loop, whose model holds up to about 4 kHz; see
    `selfsense.baseband`.
    """
    if rotor.self_sensor is not None:
        return baseband(rotor.self_sensor)
    rate = 1 / max(rotor.axis.sensor_time_constant, LEAST_LAG)
    return np.array([[-rate]]), np.array([rate]), np.ones(1)


def reading_response(rotor: Rotor, frequency: np.ndarray) -> np.ndarray:
    """Response (n,) of a reading to its displacement at frequency (n,) Hz."""
    a, b, c = reading(rotor)
    s = 2j * np.pi * np.asarray(frequency)
    return np.linalg.solve(s[:, None, None] * np.eye(len(a)) - a, b[:, None])[..., 0] @ c


def continuous(rotor: Rotor, speed: float) -> np.ndarray:
    """Complex rate matrix (s, s + 4) of q, q' (translation and tilt), and states of sensors and amplifiers (a and b).

    Its columns are these states (8 on probes), the held commands (2) and the generalised forces (2) at the centre of
    mass.
    """
    m, axis = mechanics(rotor), rotor.axis
    inverse = np.linalg.inv(m.mass[:2, :2])
    own, driven, _ = reading(rotor)
    zero, one, wide = np.zeros((2, 2)), np.eye(2), np.zeros((2, 2 * len(own)))
    amplifier = 1 / max(axis.amplifier_time_constant, LEAST_LAG)
    damping = -inverse @ (m.damping[:2, :2] - 1j * speed * m.gyroscopic[:2, 2:])
    return np.block(
        [
            [zero, one, wide, zero, zero, zero],
            [-inverse @ m.stiffness[:2, :2], damping, wide, inverse @ m.drive[:2, ::2], zero, inverse],
            [np.kron(m.probes[::2, :2], driven[:, None]), wide.T, np.kron(one, own), wide.T, wide.T, wide.T],
            [zero, zero, wide, -amplifier * one, amplifier * one, zero],
        ]
    )


def sampled(rotor: Rotor, speed: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """A (s, s), B (s, 4) and C (2, s) over one control sample at speed (rad/s), complex; s: 8 on probes.

    The inputs are the held commands at a and b and held forces on translation and tilt; the outputs are the readings.
    """
    rates = continuous(rotor, speed)
    n = len(rates)
    whole = scipy.linalg.expm(np.vstack([rates, np.zeros((4, n + 4))]) / rotor.axis.control_rate)
    seen = np.zeros((2, n))
    seen[:, 4:-2] = np.kron(np.eye(2), reading(rotor)[2])
    return whole[:n, :n], whole[:n, n:], seen


def plant_response(rotor: Rotor, frequency: np.ndarray, speed: float) -> np.ndarray:
    """Response (n, 2, 2) of the readings to the commands at a and b, at frequency (n,) Hz of either sign."""
    a, b, c = sampled(rotor, speed)
    z = np.exp(2j * np.pi * np.asarray(frequency) / rotor.axis.control_rate)
    return c @ np.linalg.solve(z[:, None, None] * np.eye(len(a)) - a, b[:, :2])


def rejection_gain(rotor: Rotor, speed: float) -> np.ndarray | None:
    """Gain (2, 2) per control sample of the force rejection at speed (rad/s); None where it is off.

    It is the rate times the inverse sensitivity at the speed of rotation, so that every synchronous amplitude decays at
    the rate whatever the loop is (Herzog et al. 1996, with its matrix T the inverse of the sensitivity).
    """
    rejection = rotor.rejection
    if rejection is None or not speed or abs(speed) < rejection.from_speed * np.pi / 30:
        return None
    dt = 1 / rotor.axis.control_rate
    known = rotor if rotor.known is None else replace(rotor.known, sensor=rotor.sensor)
    into, out = _planes(control_matrices(rotor))
    once = np.array([speed / (2 * np.pi)])
    control = _pid_response(rotor, once)[0]
    inverse = np.eye(2) + into @ plant_response(known, once, speed)[0] @ out @ np.diag(control)
    return rejection.rate * dt * inverse


def rejection_response(rotor: Rotor, frequency: np.ndarray, speed: float) -> np.ndarray:
    """Response (n, 2, 2) of the controllers' inputs behind the force rejection to those ahead of it."""
    gain = rejection_gain(rotor, speed)
    if gain is None:
        return np.broadcast_to(np.eye(2), (np.size(frequency), 2, 2))
    dt = 1 / rotor.axis.control_rate
    turn, z = np.exp(1j * speed * dt), np.exp(2j * np.pi * np.asarray(frequency) * dt)
    return np.eye(2) - np.linalg.solve(z[:, None, None] * np.eye(2) - turn * (np.eye(2) - gain), turn * gain)


def control_response(rotor: Rotor, frequency: np.ndarray, speed: float = 0.0) -> np.ndarray:
    """Response (n, 2, 2) of the commands at a and b to the negative readings, A/m, at frequency (n,) Hz."""
    into, out = _planes(control_matrices(rotor))
    return out @ (_pid_response(rotor, frequency)[..., None] * rejection_response(rotor, frequency, speed)) @ into


def closed_loop(rotor: Rotor, speed: float) -> tuple[np.ndarray, np.ndarray]:
    """State matrix (s, s) of the sampled loop at speed (rad/s), and the input (s, 2) of errors of the readings.

    The states are those of `sampled`, those of the controllers, and with force rejection its two.
    """
    a, b, c = sampled(rotor, speed)
    dt = 1 / rotor.axis.control_rate
    into, out = _planes(control_matrices(rotor))
    parts = [state_space(g, dt) for g in rotor.gains.values()]
    ka, kb = scipy.linalg.block_diag(*(p[0] for p in parts)), scipy.linalg.block_diag(*(p[1][:, None] for p in parts))
    kc, kd = scipy.linalg.block_diag(*(p[2][None] for p in parts)), np.diag([p[3] for p in parts])
    b, n = b[:, :2] @ out, len(ka)
    whole = np.block([[a - b @ kd @ into @ c, b @ kc], [-kb @ into @ c, ka]])
    error = np.vstack([-b @ kd @ into, -kb @ into])
    gain = rejection_gain(rotor, speed)
    if gain is None:
        return whole, error
    turn = np.exp(1j * speed * dt)
    whole = np.block(
        [
            [whole, np.vstack([-b @ kd, -kb])],
            [-turn * gain @ into @ c, np.zeros((2, n)), turn * (np.eye(2) - gain)],
        ]
    )
    return whole, np.vstack([error, -turn * gain @ into])


def closed_loop_poles(rotor: Rotor, speed: float = 0.0) -> np.ndarray:
    """Poles of the sampled loop in the z-plane at speed (rad/s): 24 on probes, with force rejection 4 more.

    The loop is stable when all lie inside the unit circle. The growth of a self-sensing estimator that is unstable by
    itself is added as a pole.
    """
    poles = np.linalg.eigvals(closed_loop(rotor, speed)[0])
    own = [] if rotor.self_sensor is None else [growth_rate(rotor.self_sensor)]
    growing = [np.exp(rate / rotor.axis.control_rate) for rate in own if rate >= 0]
    return np.concatenate([poles, poles.conj(), growing])


def sensitivity(rotor: Rotor, frequency: np.ndarray, speed: float = 0.0) -> np.ndarray:
    """Response (n, 2, 2) of the controllers' outputs to an injection at these outputs, at frequency (n,) Hz."""
    into, out = _planes(control_matrices(rotor))
    plant = into @ plant_response(rotor, frequency, speed) @ out
    control = _pid_response(rotor, frequency)[..., None] * rejection_response(rotor, frequency, speed)
    return np.linalg.inv(np.eye(2) + control @ plant)


def unbalance_response(rotor: Rotor, speeds: np.ndarray) -> np.ndarray:
    """Complex amplitudes (n, 4) of q against exp(i speed t) at speeds (n,) rad/s, not 0, in the sampled loop.

    The response is to the unbalance and to the runout, which the probes feed back and self-sensors do not see.
    """
    found = np.empty((len(speeds), 4), complex)
    for i, speed in enumerate(np.asarray(speeds, float)):
        rates = continuous(rotor, speed)
        force, runout = rotating(rotor, speed)
        # What rotates drives the states at exp(i w t): its own response, and in addition that of the held commands.
        n = len(rates)
        driven = rates[:, n + 2 :] @ force[:2]
        if rotor.sensor == "probe":
            driven[4:6] += runout[::2] / max(rotor.axis.sensor_time_constant, LEAST_LAG)
        steady = np.linalg.solve(1j * speed * np.eye(n) - rates[:, :n], driven)
        a, b, c = sampled(rotor, speed)
        control = control_response(rotor, np.array([speed / (2 * np.pi)]), speed)[0]
        # The states at the samples: steady + (z - A)^-1 B u, with u = -control C states.
        held = np.linalg.solve(np.exp(1j * speed / rotor.axis.control_rate) * np.eye(n) - a, b[:, :2])
        states = np.linalg.solve(np.eye(n) + held @ control @ c, steady)
        found[i] = np.concatenate([states[:2], -1j * states[:2]])
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
    seen = q @ at_planes(*rotor.planes.probes).T + rotating(rotor, 1.0)[1]
    return seen / (1 + 1j * w * rotor.axis.sensor_time_constant)


def controller_readings(rotor: Rotor, q: np.ndarray, speeds: np.ndarray) -> np.ndarray:
    """As `probe_readings`, what the controllers read, on self-sensing from the coils."""
    if rotor.sensor == "probe":
        return probe_readings(rotor, q, speeds)
    return q @ mechanics(rotor).probes.T * reading_response(rotor, np.asarray(speeds) / (2 * np.pi))[:, None]


def _planes(matrices: tuple[np.ndarray, ...]) -> tuple[np.ndarray, ...]:
    """Matrices of `control_matrices` between planes and controllers, (2, 2): those of x + i y."""
    return tuple(matrix[::2, ::2] for matrix in matrices)


def _pid_response(rotor: Rotor, frequency: np.ndarray) -> np.ndarray:
    """Responses (n, 2) of the two controllers to their errors, A/m, at frequency (n,) Hz of either sign."""
    dt = 1 / rotor.axis.control_rate
    z = np.exp(2j * np.pi * np.asarray(frequency) * dt)
    return np.stack([controller_response(g, z, dt) for g in rotor.gains.values()], axis=-1)
