"""The ripple-free current and voltage of a magnet, which reveal the rotor through the back-EMF alone (D 2.6.2).

Observer and Kalman filter, the competitors of the parameter estimator, use this averaged model and see no ripple.
"""

from collections.abc import Sequence
from dataclasses import dataclass, fields
from functools import partial
from math import isfinite, sqrt
from types import SimpleNamespace
from typing import Any

import numpy as np
import scipy
from numpy.typing import ArrayLike

from selfsense.coil import is_number

Value = float | np.ndarray
CLOSEST = 0.95  # share of the gap; a larger displacement counts as contact


@dataclass(frozen=True)
class AveragedMagnet:
    """A rotor before a magnet with one equivalent coil, averaged over the PWM period, SI.

    The coil's own flux crosses the gap on ideal iron, L(y) = L gap / (gap - y); the flux linkage of the permanent
    magnet grows by k_e per displacement. The linkage is lambda = L(y) i + k_e y; with the co-energy
    W = L(y) i^2 / 2 + k_i y i - k y^2 / 2 the force is dW/dy. The EMF per speed d lambda / dy = L' i + k_e and the
    force per current L' i + k_i are equal (reciprocity) where k_e = k_i.

    Attributes:
        mass: kg.
        actuator_gain: k_i, N/A.
        stiffness: k, N/m; negative for a magnet.
        inductance: At rest, H.
        resistance: ohm.
        emf: k_e, V s/m. Equal to actuator_gain without losses, and to its n-th part for one of n equal coils that
            have an amplifier each.
        gap: At rest, m; a displacement y narrows it.
        damping: N s/m.

    Raises:
        ValueError: A value is not a finite number in its physical range.
    """

    mass: float
    actuator_gain: float
    stiffness: float
    inductance: float
    resistance: float
    emf: float
    gap: float
    damping: float = 0.0

    def __post_init__(self) -> None:
        for f in fields(self):
            value = getattr(self, f.name)
            if not is_number(value):
                raise ValueError(f"averaged magnet: {f.name} = {value!r} is not a finite number")
            if f.name in ("mass", "actuator_gain", "inductance", "gap") and value <= 0:
                raise ValueError(f"averaged magnet: {f.name} = {value:g} must be positive")
            if f.name in ("resistance", "emf", "damping") and value < 0:
                raise ValueError(f"averaged magnet: {f.name} = {value:g} must be at least 0")

    @property
    def time_scale(self) -> float:
        """Time (s) in which rotor and coil without resistance exchange their energy: sqrt(m L) / k_i."""
        return sqrt(self.mass * self.inductance) / self.actuator_gain

    @property
    def units(self) -> np.ndarray:
        """Natural units (3,) of displacement, velocity and current.

        They are the gap, the gap per `time_scale`, and the current k_i gap / L that holds the flux over one gap.
        """
        return self.gap * np.array([1.0, 1 / self.time_scale, self.actuator_gain / self.inductance])

    def flux_linkage(self, y: ArrayLike, i: ArrayLike) -> np.ndarray:
        """Flux linkage (V s) beyond the linkage at rest, at displacement y (m) and current i (A)."""
        y, i = np.asarray(y), np.asarray(i)
        return self.inductance * self.gap / (self.gap - y) * i + self.emf * y

    def force(self, y: ArrayLike, i: ArrayLike) -> np.ndarray:
        """Force (N) toward the magnet at displacement y (m) and current i (A)."""
        y, i = np.asarray(y), np.asarray(i)
        slope = self.inductance * self.gap / (self.gap - y) ** 2
        return slope * i**2 / 2 + self.actuator_gain * i - self.stiffness * y


def slopes(
    m: AveragedMagnet, y: Value, v: Value, i: Value, voltage: Value, force: Value = 0.0
) -> tuple[Value, Value, Value]:
    """Rates of displacement, velocity and current of the nonlinear model, under voltage (V) and external force (N)."""
    width = m.gap - y
    inductance = m.inductance * m.gap / width
    slope = inductance / width
    pull = (0.5 * slope * i + m.actuator_gain) * i - m.stiffness * y - m.damping * v + force
    return v, pull / m.mass, (voltage - m.resistance * i - (m.emf + slope * i) * v) / inductance


def jacobian(m: AveragedMagnet, y: float, v: float, i: float, voltage: float) -> np.ndarray:
    """Derivative (3, 3) of `slopes` by displacement, velocity and current."""
    width = m.gap - y
    inductance = m.inductance * m.gap / width
    slope = inductance / width
    rate = (voltage - m.resistance * i - (m.emf + slope * i) * v) / inductance
    return np.array(
        [
            [0.0, 1.0, 0.0],
            [
                (slope / width * i * i - m.stiffness) / m.mass,
                -m.damping / m.mass,
                (slope * i + m.actuator_gain) / m.mass,
            ],
            [
                -2 * i * v / width**2 - rate / width,
                -(m.emf + slope * i) / inductance,
                -(m.resistance + slope * v) / inductance,
            ],
        ]
    )


def linear_model(m: AveragedMagnet) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """A (3, 3), B (3, 1), C (1, 3) at rest: states displacement, velocity, current; input voltage, output current."""
    return jacobian(m, 0.0, 0.0, 0.0, 0.0), np.array([[0.0], [0.0], [1 / m.inductance]]), np.array([[0.0, 0.0, 1.0]])


def observability(m: AveragedMagnet) -> tuple[int, float]:
    """Rank and condition number of the linear model's observability matrix [C; C A; C A^2] in natural units.

    A displacement is seen through the force that the stiffness makes of it and the EMF of the resulting speed. Without
    emf the rank is 1, without stiffness 2; below 3 the condition number is inf.
    """
    a, _, c = linear_model(m)
    a, c = a * m.units * m.time_scale / m.units[:, None], c * m.units / m.units[2]
    matrix = np.vstack([c, c @ a, c @ a @ a])
    rank = int(np.linalg.matrix_rank(matrix))
    return rank, float(np.linalg.cond(matrix)) if rank == 3 else np.inf


def sampled(a: np.ndarray, b: np.ndarray, rate: float) -> tuple[np.ndarray, np.ndarray]:
    """Transition (n, n) and input matrix (n, inputs) over one sample of held inputs, exact; rate in Hz."""
    n, inputs = b.shape
    both = np.zeros((n + inputs, n + inputs))
    both[:n, :n], both[:n, n:] = a, b
    step = scipy.linalg.expm(both / rate)
    return step[:n, :n], step[:n, n:]


@dataclass(frozen=True)
class Levitation:
    """Samples (..., n) of a levitated rotor at the times n / rate.

    Attributes:
        displacement: m.
        velocity: m/s.
        current: A.
        voltage: Voltage held until the next sample, V.
        force: External force held until the next sample, N.
    """

    displacement: np.ndarray
    velocity: np.ndarray
    current: np.ndarray
    voltage: np.ndarray
    force: np.ndarray


def levitate(
    magnet: AveragedMagnet | Sequence[AveragedMagnet],
    force: ArrayLike,
    rate: float,
    supply: float = 24.0,
    start: ArrayLike = (0.0, 0.0, 0.0),
) -> Levitation:
    """Levitate the nonlinear model by feedback of its true state, integrated with scipy's DOP853 to 1e-9.

    Args:
        magnet: One magnet, or one for each lane of force (lanes, n); the feedback is designed for the first.
        force: External force (..., n), N, held over each sample; the leading dimensions are lanes.
        rate: Sampling rate, Hz.
        supply: Limit of the voltage, V, which is held over each sample.
        start: Displacement, velocity and current at the start, (3,) or (..., 3).

    Raises:
        ValueError: An input does not fit, or the rotor comes within 5 % of the gap of a contact.
    """
    magnets = [magnet] if isinstance(magnet, AveragedMagnet) else list(magnet)
    force = np.asarray(force, dtype=float)
    if force.ndim == 0 or force.shape[-1] == 0 or not np.all(np.isfinite(force)):
        raise ValueError(f"levitate: force must be finite, of the shape (..., samples), not {force.shape}")
    if not magnets or (len(magnets) != 1 and force.shape[:-1] != (len(magnets),)):
        raise ValueError(f"levitate: {len(magnets)} magnets need a force of ({len(magnets)}, n), not {force.shape}")
    if not (isfinite(rate) and rate > 0 and supply > 0):
        raise ValueError(f"levitate: rate = {rate} Hz and supply = {supply} V must be positive")
    lanes = force.shape[:-1]
    first = magnets[0]
    rig: Any = first if len(magnets) == 1 else SimpleNamespace(**_columns(magnets))
    a, b, _ = linear_model(first)
    t = first.time_scale
    poles = np.array([-0.5 / t, -0.75 / t, -1 / t - first.resistance / first.inductance])
    feedback = scipy.signal.place_poles(*sampled(a, b, rate), np.exp(poles / rate)).gain_matrix[0]  # pyright: ignore[reportAttributeAccessIssue]
    x = np.moveaxis(np.broadcast_to(np.asarray(start, dtype=float), (*lanes, 3)), -1, 0).copy()
    atol = np.repeat(1e-9 * first.units, x[0].size)
    states, voltage = np.empty((3, *force.shape)), np.empty(force.shape)

    def slope(_: float, flat: np.ndarray, volts: np.ndarray, newtons: np.ndarray) -> np.ndarray:
        y, v, i = flat.reshape(3, *lanes)
        return np.concatenate([np.ravel(s) for s in slopes(rig, y, v, i, volts, newtons)])

    for n in range(force.shape[-1]):
        reach = np.abs(x[0]).max() / np.min(rig.gap)
        if not reach < CLOSEST:
            raise ValueError(
                f"levitate: at sample {n} the rotor is out by {100 * reach:.0f} % of the gap, a contact; "
                "give less force or a higher supply"
            )
        states[..., n] = x
        voltage[..., n] = np.clip(-np.tensordot(feedback, x, 1), -supply, supply)
        solver = scipy.integrate.DOP853(
            partial(slope, volts=voltage[..., n], newtons=force[..., n]),
            0.0,
            x.ravel(),
            1 / rate,
            rtol=1e-9,
            atol=atol,  # pyright: ignore[reportArgumentType]  # one per state
            first_step=1 / rate,
        )
        while solver.status == "running":
            solver.step()
        x = solver.y.reshape(x.shape)
    return Levitation(states[0], states[1], states[2], voltage, force)


def _columns(magnets: Sequence[AveragedMagnet]) -> dict[str, np.ndarray]:
    # `slopes` works on arrays of parameters in the same way as on arrays of states.
    return {f.name: np.array([getattr(m, f.name) for m in magnets]) for f in fields(AveragedMagnet)}
