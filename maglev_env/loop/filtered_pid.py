"""PID gains with filters in series: notches, a lead-lag and a low-pass.

Each filter is stated by its transfer function in s and made digital by the bilinear transform, prewarped so that at the
filter's own frequency the response is exactly that in s (Franklin, Powell, Workman: Digital Control of Dynamic Systems,
ch. 6).
"""

from dataclasses import dataclass, fields
from functools import reduce
from math import exp, pi, sqrt, tan
from typing import ClassVar

import numpy as np

from maglev_env.loop.gain_card import KD, KP, LEAK, TIME_CONSTANT, GainCard, check_gains, gain
from maglev_env.loop.linear_controller import LinearController

# A rig's resonance is usually known to some ten percent; a corner is free within a decade.
_CENTRE = GainCard("Hz", (0.7, 1.4), low=1e-3, high=1e6)
_CORNER = GainCard("Hz", (0.3, 3.0), low=1e-3, high=1e6)
# Powers of s, times (1 + q)^n, of a filter of order n as polynomials in q = 1 / z, without the factor of the transform.
_POWERS = {
    1: np.array([[1.0, 1.0], [1.0, -1.0]]),
    2: np.array([[1.0, 2.0, 1.0], [1.0, 0.0, -1.0], [1.0, -2.0, 1.0]]),
}
LOST = 0.01  # relative error of the response at rest at which digits count as lost
Digital = tuple[np.ndarray, np.ndarray]  # numerator and denominator, coefficients of z^0, z^-1, ...


@dataclass(frozen=True)
class Notch:
    """(s^2 + depth width w s + w^2) / (s^2 + width w s + w^2) with w = 2 pi frequency.

    Args:
        frequency: Hz.
        depth: gain at the frequency: 0.1 is -20 dB, 1 no notch at all; above 1 it is a peak.
        width: of the dip where half of the power passes, over the frequency (of a deep notch).

    Raises:
        ValueError: A value is not valid; the message names it.
    """

    frequency: float = gain(_CENTRE)
    depth: float = gain(GainCard("", (0.02, 1.0), absolute=True, low=0.0, high=100.0), 0.1)
    width: float = gain(GainCard("", (0.05, 2.0), absolute=True, low=1e-3, high=10.0), 0.5)

    word: ClassVar = "notch"

    def __post_init__(self) -> None:
        check_gains(self, f"controller: {self.word}")

    def filter(self, dt: float) -> Digital:
        """The filter at a control step of dt (s)."""
        return _digital([1.0, self.depth * self.width, 1.0], [1.0, self.width, 1.0], self, dt)


@dataclass(frozen=True)
class LeadLag:
    """(1 + sqrt(ratio) s / w) / (1 + s / (sqrt(ratio) w)) with w = 2 pi frequency.

    Args:
        frequency: Hz, where the phase is farthest from 0; the gain there is sqrt(ratio).
        ratio: of the corner of the pole to that of the zero: above 1 leads by asin((ratio - 1) / (ratio + 1)), below 1
            lags, 1 is no filter at all.

    Raises:
        ValueError: A value is not valid; the message names it.
    """

    frequency: float = gain(_CORNER)
    ratio: float = gain(GainCard("", (0.2, 5.0), absolute=True, low=1e-3, high=1e3), 2.0)

    word: ClassVar = "lead-lag"

    def __post_init__(self) -> None:
        check_gains(self, f"controller: {self.word}")

    def filter(self, dt: float) -> Digital:
        """The filter at a control step of dt (s)."""
        root = sqrt(self.ratio)
        return _digital([1.0, root], [1.0, 1 / root], self, dt)


@dataclass(frozen=True)
class LowPass:
    """w^2 / (s^2 + 2 damping w s + w^2) with w = 2 pi frequency.

    Args:
        frequency: Hz.
        damping: ratio; 0.707 is Butterworth's.

    Raises:
        ValueError: A value is not valid; the message names it.
    """

    frequency: float = gain(_CORNER)
    damping: float = gain(GainCard("", (0.3, 1.2), absolute=True, low=0.01, high=10.0), 0.707)

    word: ClassVar = "low-pass"

    def __post_init__(self) -> None:
        check_gains(self, f"controller: {self.word}")

    def filter(self, dt: float) -> Digital:
        """The filter at a control step of dt (s)."""
        return _digital([1.0, 0.0, 0.0], [1.0, 2 * self.damping, 1.0], self, dt)


Filter = Notch | LeadLag | LowPass


@dataclass(frozen=True)
class FilteredPid:
    """The PID of `Gains`, whose command passes through filters.

    Args:
        kp, ki, kd, td, ti: as in `Gains`: A/m, A/m, A s/m, s, s.
        notch, notch2, lead_lag, low_pass: filters; None: absent.

    Raises:
        ValueError: A value is not valid; the message names it.
    """

    kp: float = gain(KP)
    ki: float = gain(LEAK)
    kd: float = gain(KD)
    td: float = gain(TIME_CONSTANT, 1e-4)
    ti: float = gain(TIME_CONSTANT, 0.0318)
    notch: Notch | None = None
    notch2: Notch | None = None
    lead_lag: LeadLag | None = None
    low_pass: LowPass | None = None

    def __post_init__(self) -> None:
        check_gains(self, "controller")
        for name in ("td", "ti"):
            if getattr(self, name) <= 0:
                raise ValueError(f"controller: {name} = {getattr(self, name)} s must be positive")

    @property
    def filters(self) -> dict[str, Filter]:
        """The filters that are there, by name."""
        named = {f.name: getattr(self, f.name) for f in fields(self)}
        return {name: value for name, value in named.items() if isinstance(value, Filter)}

    def filter(self, dt: float) -> LinearController:
        """The same at a control step of dt (s).

        Raises:
            ValueError: A filter's frequency does not lie below half of the control rate, or all lie so far below it
                that the coefficients of one recursion do not hold them.
        """
        passed, kept = exp(-dt / self.td), exp(-dt / self.ti)
        derivative, integral = np.array([1.0, -passed]), np.array([1.0, -kept])
        numerator = (
            self.kp * np.convolve(derivative, integral)
            + self.kd / self.td * np.convolve([1.0, -1.0], integral)
            + self.ki * (1 - kept) * np.convolve([0.0, 1.0], derivative)
        )
        parts = [(numerator, np.convolve(derivative, integral)), *(f.filter(dt) for f in self.filters.values())]
        b, a = (reduce(np.convolve, side) for side in zip(*parts, strict=True))
        # Poles that crowd around z = 1 cancel digits of the sums. The response at rest is known, and suffers first.
        at_rest = self.kp + self.ki
        if at_rest and abs(b.sum() - at_rest * a.sum()) > LOST * abs(at_rest * a.sum()):
            raise ValueError(
                f"controller: the filters lie too far below the control rate of {1 / dt:g} Hz for a recursion of order "
                f"{len(a) - 1}; leave some out, or raise their frequencies"
            )
        return LinearController(tuple(b.tolist()), tuple(a.tolist()))


def _digital(numerator: list[float], denominator: list[float], of: Filter, dt: float) -> Digital:
    """A filter in s over 2 pi frequency, the lowest power first, by the bilinear transform."""
    if of.frequency * dt >= 0.5:
        raise ValueError(
            f"controller: a {of.word} at {of.frequency:g} Hz does not lie below half of the control rate of "
            f"{1 / dt:g} Hz; give a lower frequency, or leave it out"
        )
    # s / w = (1 - q) / (1 + q) / tan(w dt / 2): at q = exp(-i w dt) this is i.
    stretched = (1 / tan(pi * of.frequency * dt)) ** np.arange(len(denominator))
    powers = _POWERS[len(denominator) - 1]
    b, a = ((np.array(side) * stretched) @ powers for side in (numerator, denominator))
    return b / a[0], a / a[0]
