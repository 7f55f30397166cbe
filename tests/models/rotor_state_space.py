"""A rotor under digital control as one real state space, from its equations of motion in x and y, by scipy alone."""

from dataclasses import dataclass

import numpy as np
from scipy.linalg import block_diag
from scipy.signal import cont2discrete

from maglev_env.rotor.rotor import Rotor


@dataclass(frozen=True)
class RealLoop:
    """Readings and currents are ordered (a, x), (b, x), (a, y), (b, y); `gain` and `stiffness` are the actuator's."""

    plant: tuple[np.ndarray, np.ndarray, np.ndarray]  # A, B from 4 commands and 4 forces (x, tilt, y, tilt), C
    control: tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]  # from readings to commands, sign included

    def closed(self, probes: np.ndarray | None = None) -> tuple[np.ndarray, np.ndarray]:
        """State matrix, and the input of errors of the readings; with a matrix (4, 4) in the readings."""
        (a, b, c), (ka, kb, kc, kd) = self.plant, self.control
        b, c = b[:, :4], (np.eye(4) if probes is None else probes) @ c
        return np.block([[a + b @ kd @ c, b @ kc], [kb @ c, ka]]), np.vstack([b @ kd, kb])

    def sensitivity(self, z: np.ndarray) -> np.ndarray:
        """Response (n, 4, 4) of what the controllers read to an error of the readings, at points z."""
        a, b = self.closed()
        c = np.hstack([self.plant[2], np.zeros((4, len(a) - len(self.plant[0])))])
        return np.array([np.eye(4) + c @ np.linalg.solve(one * np.eye(len(a)) - a, b) for one in z])

    def answer(self, force: np.ndarray) -> np.ndarray:
        """Readings (4, n) after held forces (4, n) on x, tilt, y, tilt."""
        a, _ = self.closed()
        b, state, found = self.plant[1][:, 4:], np.zeros(len(a)), []
        for now in force.T:
            found.append(self.plant[2] @ state[:16])
            state = a @ state
            state[:16] += b @ now
        return np.array(found).T

    def compliance(self, z: np.ndarray) -> np.ndarray:
        """Response (n, 4, 4) of x, tilt, y, tilt to the held forces on them, at points z."""
        a, _ = self.closed()
        b = np.vstack([self.plant[1][:, 4:], np.zeros((len(a) - len(self.plant[0]), 4))])
        return np.array([np.linalg.solve(one * np.eye(len(a)) - a, b)[:4] for one in z])


def real_loop(
    rotor: Rotor, rpm: float, gain: float | tuple[float, float], stiffness: float | tuple[float, float]
) -> RealLoop:
    """The loop at a speed; `gain` (N/A) and `stiffness` (N/m) of one axis, or of x and y, of both bearings together."""
    axis, speed, dt = rotor.axis, rpm * np.pi / 30, 1 / rotor.axis.control_rate
    (ma, mb), (pa, pb) = rotor.planes.magnets, rotor.planes.probes
    m, inertia, polar = rotor.body.mass, rotor.body.transverse_inertia, rotor.body.polar_inertia
    # Of each direction: m x'' = sum f, I t'' = sum z f, with f = -stiffness / 2 (x + z t) + gain / 2 i at each plane.
    k = [one / 2 * np.array([[2, ma + mb], [ma + mb, ma**2 + mb**2]]) for one in np.broadcast_to(stiffness, 2)]
    drive = [one / 2 * np.array([[1, 1], [ma, mb]]) for one in np.broadcast_to(gain, 2)]
    probes = np.array([[1, pa], [1, pb]])
    inverse = np.diag([1 / m, 1 / inertia] * 2)
    turning = np.zeros((4, 4))
    turning[1, 3], turning[3, 1] = -polar * speed, polar * speed  # I tx'' = -I_p w ty', I ty'' = I_p w tx'
    o, e = np.zeros((4, 4)), np.eye(4)
    a = np.block(
        [
            [o, e, o, o],
            [-inverse @ block_diag(*k), inverse @ turning, o, inverse @ block_diag(*drive)],
            [block_diag(probes, probes) / axis.sensor_time_constant, o, -e / axis.sensor_time_constant, o],
            [o, o, o, -e / axis.amplifier_time_constant],
        ]
    )
    b = np.block([[o, o], [o, inverse], [o, o], [e / axis.amplifier_time_constant, o]])
    ad, bd, c, _, _ = cont2discrete((a, b, np.hstack([o, o, e, o]), np.zeros((4, 8))), dt)
    into, out = np.array([[0.5, 0.5], [-0.5, 0.5]]), np.array([[1.0, -1.0], [1.0, 1.0]])  # of equal arms
    into, out = block_diag(into, into), block_diag(out, out)
    gains = list(rotor.gains.values()) * 2
    decays = [np.exp([-dt / g.td, -dt / g.ti]) for g in gains]
    ka = np.diag(np.concatenate(decays))
    kb = block_diag(*(1 - d[:, None] for d in decays))
    kc = block_diag(*(np.array([[-g.kd / g.td, g.ki]]) for g in gains))
    kd = np.diag([g.kp + g.kd / g.td for g in gains])
    found = RealLoop((ad, bd, c), (ka, -kb @ into, out @ kc, -out @ kd @ into))
    if rotor.rejection is None:
        return found
    # Ahead of the controllers, in x + i y: e - v, v+ = turn (v + r (e - v)), with r = rate dt / sensitivity.
    z = np.exp(1j * speed * dt)
    plant = c @ np.linalg.solve(z * np.eye(16) - ad, bd[:, :4])
    law = kc @ np.linalg.solve(z * np.eye(8) - ka, kb) + kd
    whole = np.eye(4) + into @ plant @ out @ law  # of x, x, y, y
    r = rotor.rejection.rate * dt * (whole[:2, :2] - 1j * whole[:2, 2:])  # acts on (1, -i) x, a forward rotation

    def real(matrix: np.ndarray) -> np.ndarray:
        return np.block([[matrix.real, -matrix.imag], [matrix.imag, matrix.real]])

    r, turn = real(r), real(z * np.eye(2))
    before = (turn @ (e - r), -turn @ r @ into, -e, -into)  # from readings to the controllers' inputs
    va, vb, vc, vd = before
    return RealLoop(
        (ad, bd, c),
        (
            np.block([[va, np.zeros((4, 8))], [kb @ vc, ka]]),
            np.vstack([vb, kb @ vd]),
            out @ np.hstack([kd @ vc, kc]),
            out @ kd @ vd,
        ),
    )
