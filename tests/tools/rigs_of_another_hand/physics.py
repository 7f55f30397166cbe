"""Laws and equations of levitated bodies from textbooks, with an integrator of their own; nothing is the product's.

Coordinates: y (m) is the motion toward the coil (or the upper one of a pair) from the operating point, i (A) the
current in the coil. A force law is a function (y, i) -> N without the weight. States are plain lists of floats: for a
few states Python is as fast as arrays, and each line is an equation of the text.
"""

from collections.abc import Callable
from dataclasses import dataclass
from math import exp, tanh

GRAVITY = 9.80665  # m/s2

Law = Callable[[float, float], float]
Derivative = Callable[[list[float], float], list[float]]


def inverse_square(constant: float, gap: float, offset: float) -> Law:
    """K i^2 / (gap - y + offset)^2: a thin iron core, its fringing and its path in iron as an offset of the gap."""
    return lambda y, i: constant * i * i / (gap - y + offset) ** 2


def exponential(inductance: float, gap: float, length: float) -> Law:
    """i^2 / 2 |dL/dx| of L(x) = L0 + L1 exp(-x / a), the usual fit to a measured inductance."""
    return lambda y, i: 0.5 * i * i * inductance / length * exp(-(gap - y) / length)


def dipole(constant: float, gap: float, exponent: float) -> Law:
    """C i / x^n: a permanent magnet on the axis of an air coil."""
    return lambda y, i: constant * i / (gap - y) ** exponent


def opposed_pair(constant: float, gap: float, bias: float) -> Law:
    """K ((I + i)^2 / (g - y)^2 - (I - i)^2 / (g + y)^2)."""
    return lambda y, i: constant * (((bias + i) / (gap - y)) ** 2 - ((bias - i) / (gap + y)) ** 2)


def slopes(law: Law, current: float) -> tuple[float, float]:
    """Actuator gain dF/di (N/A) and negative stiffness -dF/dy (N/m, negative) at y = 0, by central differences."""
    h, d = 1e-6, 1e-6 * max(1.0, abs(current))
    gain = (law(0.0, current + d) - law(0.0, current - d)) / (2 * d)
    return gain, -(law(h, current) - law(-h, current)) / (2 * h)


@dataclass(frozen=True)
class Body:
    """A body in a force law: mass kg, damping N s/m, Coulomb friction N, weight carried by the law or not.

    flexible: (mass kg, stiffness N/m, damping N s/m) of a second body on a spring, moving freely otherwise.
    """

    mass: float
    law: Law
    damping: float = 0.0
    friction: float = 0.0
    hangs: bool = True
    flexible: tuple[float, float, float] | None = None


@dataclass(frozen=True)
class CurrentDrive:
    """A current amplifier: first-order lag (s), gain (A/A)."""

    lag: float
    gain: float = 1.0


@dataclass(frozen=True)
class VoltageDrive:
    """A coil at a voltage: R (ohm), L(x) = base + top exp(-gap / length) (H), with motional EMF, rails (V)."""

    resistance: float
    base: float
    top: float
    gap: float
    length: float
    rails: tuple[float, float] = (0.0, 24.0)
    gain: float = 1.0


def equations(body: Body, drive: CurrentDrive | VoltageDrive, sensor_lag: float, meter_lag: float) -> Derivative:
    """States [y, v, i, sensed y, metered i, y2, v2]; the input is the command (A, or V of a voltage drive)."""
    m, c, law = body.mass, body.damping, body.law
    weight = m * GRAVITY if body.hangs else 0.0
    flexible, friction = body.flexible, body.friction
    voltage = isinstance(drive, VoltageDrive)

    def derivative(s: list[float], u: float) -> list[float]:
        y, v, i, sensed, metered, y2, v2 = s
        force = law(y, i * drive.gain) - weight - c * v
        if friction:
            force -= friction * tanh(v / 2e-4)
        a2 = 0.0
        if flexible:
            m2, k2, c2 = flexible
            spring = k2 * (y - y2) + c2 * (v - v2)
            force -= spring
            a2 = spring / m2
        if voltage:
            bulge = drive.top * exp(-(drive.gap - y) / drive.length)
            rate = (u - drive.resistance * i - bulge / drive.length * v * i) / (drive.base + bulge)
        else:
            rate = (u - i) / drive.lag if drive.lag else 0.0
        return [
            v,
            force / m,
            rate,
            (y - sensed) / sensor_lag if sensor_lag else 0.0,
            (i - metered) / meter_lag if meter_lag else 0.0,
            v2,
            a2,
        ]

    return derivative


def runge_kutta(f: Derivative, s: list[float], u: float, h: float) -> list[float]:
    """One classical step of fourth order with the input held."""
    k1 = f(s, u)
    k2 = f([a + 0.5 * h * b for a, b in zip(s, k1, strict=True)], u)
    k3 = f([a + 0.5 * h * b for a, b in zip(s, k2, strict=True)], u)
    k4 = f([a + h * b for a, b in zip(s, k3, strict=True)], u)
    return [a + h / 6 * (p + 2 * q + 2 * r + w) for a, p, q, r, w in zip(s, k1, k2, k3, k4, strict=True)]
