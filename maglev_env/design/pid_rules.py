"""PID gains from wanted stiffness and damping, and the stability conditions of their loop (D eq 3.17-3.27)."""

from collections.abc import Sequence
from dataclasses import dataclass, fields

import numpy as np

from maglev_env.loop.gains import Gains
from selfsense.coil import is_number


@dataclass(frozen=True)
class ControlledAxis:
    """A rotor on magnets alone, SI: m y'' + k_yy y + k_yi i = f (D eq 3.16).

    Attributes:
        mass: m, kg.
        negative_stiffness: k_yy, N/m.
        actuator_gain: k_yi, N/A.
        amplifier_time_constant: T_a, s.
        loop_gain: A_s alpha_a, reading per displacement times current per command; 1 for gains in A/m.

    Raises:
        ValueError: A value is not a number of the right sign.
    """

    mass: float
    negative_stiffness: float
    actuator_gain: float
    amplifier_time_constant: float
    loop_gain: float = 1.0

    def __post_init__(self) -> None:
        for f in fields(self):
            value = getattr(self, f.name)
            sign = -1 if f.name == "negative_stiffness" else 1
            if not (is_number(value) and sign * value > 0):
                raise ValueError(f"axis: {f.name} = {value!r} must be a number {'below' if sign < 0 else 'above'} 0")

    @property
    def current_per_displacement(self) -> float:
        """|k_yy| / k_yi, A/m: control current per displacement that holds the rotor against its magnets."""
        return -self.negative_stiffness / self.actuator_gain


@dataclass(frozen=True)
class Condition:
    """One condition value > bound, both in `unit`."""

    name: str
    value: float
    bound: float
    unit: str

    @property
    def met(self) -> bool:
        return self.value > self.bound


def gains_for(stiffness: float, damping: float, axis: ControlledAxis) -> tuple[float, float]:
    """k_p = (k - k_yy) / k_yi in A/m and k_d = c / k_yi in A s/m, for k in N/m and c in N s/m (D eq 3.18, 3.19).

    These gains hold for a loop without lag; a lag of tau reduces the damping by about tau (k - k_yy).

    Raises:
        ValueError: A stiffness or damping that is not positive.
    """
    for name, value in (("stiffness", stiffness), ("damping", damping)):
        if not value > 0:
            raise ValueError(f"gains_for: {name} = {value!r} must be above 0")
    per_newton = 1 / (axis.actuator_gain * axis.loop_gain)
    return (stiffness - axis.negative_stiffness) * per_newton, damping * per_newton


def stability_conditions(
    axis: ControlledAxis, gains: Gains, current_per_displacement: float | None = None
) -> tuple[Condition, Condition, Condition, Condition]:
    """Positive coefficients of D's eq 3.24 as conditions on the gains (D eq 3.25), and k_i > 0, which D leaves out.

    Each coefficient must be positive for every root to lie in the left half plane, but for order five this is not
    sufficient; `is_stable` decides. The PID is the ideal one of eq 3.21 (without gains.ti), and the sensor has no lag.

    Args:
        axis: The rotor on its magnets.
        gains: The gains.
        current_per_displacement: A/m; None for |k_yy| / k_yi, which follows from eq 3.24 for any kind of bias. D prints
            I_0 / g_0, which is correct for electromagnets only and not for the bias of a permanent magnet.
    """
    needed = axis.current_per_displacement if current_per_displacement is None else current_per_displacement
    needed /= axis.loop_gain
    ta, td = axis.amplifier_time_constant, gains.td
    return (
        Condition("m / |k_yy| > T_a T_d", -axis.mass / axis.negative_stiffness, ta * td, "s2"),
        Condition("k_d + k_p T_d", gains.kd + gains.kp * td, needed * (ta + td), "A s/m"),
        Condition("k_p + k_i T_d", gains.kp + gains.ki * td, needed, "A/m"),
        Condition("k_i", gains.ki, 0.0, "A/(m s)"),
    )


def characteristic_polynomial(axis: ControlledAxis, gains: Gains, leaky: bool = False) -> np.ndarray:
    """Coefficients (6,) of s^5 ... s^0 whose roots (1/s) are the poles of the loop (D eq 3.24 times its denominators).

    leaky uses the integrator k_i / (1 + T_i s) of eq 3.27 instead of k_i / s of eq 3.21.
    """
    integrator = np.array([gains.ti, 1.0]) if leaky else np.array([1.0, 0.0])
    differentiator, lag = np.array([gains.td, 1.0]), np.array([axis.amplifier_time_constant, 1.0])
    controller = gains.kp * np.polymul(integrator, differentiator)
    controller = controller + gains.kd * np.polymul([1.0, 0.0], integrator)
    controller = np.polyadd(controller, gains.ki * differentiator)
    plant = np.array([axis.mass, 0.0, axis.negative_stiffness])
    open_loop = np.polymul(plant, np.polymul(integrator, np.polymul(differentiator, lag)))
    return np.polyadd(open_loop, axis.actuator_gain * axis.loop_gain * controller)


def rightmost_pole(axis: ControlledAxis, gains: Gains, leaky: bool = False) -> float:
    """Largest real part of the loop's poles, 1/s; the loop is stable below 0."""
    return float(np.roots(characteristic_polynomial(axis, gains, leaky)).real.max())


def is_stable(coefficients: Sequence[float] | np.ndarray) -> bool:
    """Whether every root of a real polynomial (highest power first) has a negative real part, by Routh's array.

    A root on the imaginary axis is not stable.

    Raises:
        ValueError: The leading coefficient is missing.
    """
    p = np.asarray(coefficients, dtype=float)
    if p.ndim != 1 or p.size < 2 or p[0] == 0 or not np.isfinite(p).all():
        raise ValueError("is_stable: give finite coefficients of a polynomial, the highest power first and not 0")
    p = p * np.sign(p[0])
    if not (p > 0).all():
        return False
    upper, lower = p[0::2], p[1::2]
    for _ in range(p.size - 2):
        below = np.zeros(upper.size - 1)
        below[: lower.size - 1] = lower[1:]
        upper, lower = lower, upper[1:] - upper[0] / lower[0] * below
        if lower[0] <= 0:
            return False
    return True
