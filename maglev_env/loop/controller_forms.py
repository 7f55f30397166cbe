"""Controllers in the words of their engineer, each turned into a `LinearController` at the control rate.

The recursions are those of a loop in a control program: sums for integrals, and differences for derivatives and lags
(backward differences), so that every value depends on the newest reading. A program that does it otherwise is stated by
its transfer functions.
"""

from dataclasses import dataclass, field
from typing import Literal

import numpy as np

from maglev_env.fields import is_number
from maglev_env.loop.filtered_pid import FilteredPid
from maglev_env.loop.gain_card import KD, KI, KP, TIME_CONSTANT, GainCard, gain
from maglev_env.loop.linear_controller import ANTI_WINDUP, AntiWindup, Limit, LinearController, check_limit

DERIVATIVE_ON = ("error", "measurement")
_ONE = np.ones(1)
_INTEGRATOR = np.array([1.0, -1.0])
# Polynomials here are arrays of coefficients of z^0, z^-1, ...


@dataclass(frozen=True)
class Pid:
    """command = kp (setpoint_weight r - y) + ki integral(r - y) + kd derivative, counted from the operating point.

    Args:
        kp: A/m.
        ki: A/(m s); a pure integrator.
        kd: A s/m.
        td: time constant of the derivative's low-pass filter, s; 0: the plain difference of two samples.
        derivative_on: "error" (r - y) or "measurement" (-y).
        setpoint_filter: time constant of a low-pass filter of the reference, s; 0: none.
        setpoint_weight: share of the reference in the proportional part.
        limit: lowest and highest command, A; None: no limit.
        anti_windup: "tracking": the integral is set back to what gives the limited command; "none": it runs on.

    Raises:
        ValueError: A value is not valid; the message names it.
    """

    kp: float = gain(KP)
    ki: float = gain(KI, 0.0)
    kd: float = gain(KD, 0.0)
    td: float = gain(TIME_CONSTANT, 0.0)
    derivative_on: Literal["error", "measurement"] = "error"
    setpoint_filter: float = gain(TIME_CONSTANT, 0.0)
    setpoint_weight: float = gain(GainCard("", (0.0, 1.0), absolute=True, first=False), 1.0)
    limit: Limit | None = None
    anti_windup: AntiWindup = "tracking"

    def __post_init__(self) -> None:
        _check_form(self, ("kp", "ki", "kd", "setpoint_weight"), ("td", "setpoint_filter"))
        if self.derivative_on not in DERIVATIVE_ON:
            raise ValueError(
                f"controller: derivative_on = {self.derivative_on!r}; use one of {', '.join(DERIVATIVE_ON)}"
            )

    def filter(self, dt: float) -> LinearController:
        """The same at a control step of dt (s)."""
        parts = _pid(self, dt)
        return _controller(parts.reference, parts.reading, None, parts.rest, parts.integrator, self)


@dataclass(frozen=True)
class StateFeedback:
    """command = displacement (r - y) - velocity v - current i + integral(r - y), counted from the operating point.

    v is the difference of two readings over the control step, low-pass filtered.

    Args:
        displacement: A/m.
        velocity: A s/m.
        current: A/A.
        integral: A/(m s).
        velocity_filter: time constant of the velocity's low-pass filter, s; 0: none.
        setpoint_filter, limit, anti_windup: as in `Pid`.

    Raises:
        ValueError: A value is not valid; the message names it.
    """

    displacement: float = gain(KP)
    velocity: float = gain(KD)
    current: float = gain(GainCard("A/A", (0.3, 3.0)), 0.0)
    integral: float = gain(KI, 0.0)
    velocity_filter: float = gain(TIME_CONSTANT, 0.0)
    setpoint_filter: float = gain(TIME_CONSTANT, 0.0)
    limit: Limit | None = None
    anti_windup: AntiWindup = "tracking"

    def __post_init__(self) -> None:
        _check_form(self, ("displacement", "velocity", "current", "integral"), ("velocity_filter", "setpoint_filter"))

    def filter(self, dt: float) -> LinearController:
        """The same at a control step of dt (s)."""
        parts = _pid(Pid(self.displacement, self.integral, self.velocity, self.velocity_filter, "measurement",
                         self.setpoint_filter), dt)  # fmt: skip
        current = self.current * np.convolve(parts.rest, parts.integrator)
        return _controller(parts.reference, parts.reading, current, parts.rest, parts.integrator, self)


@dataclass(frozen=True)
class CurrentLoop:
    """The inner loop of a cascade: voltage = kp e + ki integral(e), e the wanted current minus the measured one.

    Args:
        kp: V/A.
        ki: V/(A s).

    Raises:
        ValueError: A value is not a finite number.
    """

    kp: float = gain(GainCard("V/A", (0.3, 3.0)))
    ki: float = gain(GainCard("V/(A s)", (0.1, 10.0)), 0.0)

    def __post_init__(self) -> None:
        _check(self, ("kp", "ki"))


@dataclass(frozen=True)
class Cascade:
    """An outer PID on the displacement asks for a current; an inner PI on the current asks for a voltage.

    The command is the voltage over the coil's resistance, the current at which the coil would settle. The rig's
    amplifier_time_constant is then the coil's L / R.

    Args:
        outer: its command is the wanted current; it has no limit of its own.
        inner: from the error of the current to the voltage.
        resistance: of the coil, ohm.
        limit: lowest and highest voltage over resistance, A; None: no limit.
        anti_windup: of the inner integral, as in `Pid`.

    Raises:
        ValueError: A value is not valid; the message names it.
    """

    outer: Pid
    inner: CurrentLoop
    resistance: float
    limit: Limit | None = None
    anti_windup: AntiWindup = "tracking"

    def __post_init__(self) -> None:
        _check_form(self, ("resistance",))
        if self.resistance <= 0:
            raise ValueError(f"controller: resistance = {self.resistance} ohm must be positive")
        if self.outer.limit is not None:
            raise ValueError("controller: outer.limit: only the voltage of a cascade is limited; give the limit (of "
                             "the voltage over resistance, A) to the cascade itself")  # fmt: skip

    def filter(self, dt: float) -> LinearController:
        """The same at a control step of dt (s)."""
        outer = _pid(self.outer, dt)
        own = _INTEGRATOR if self.inner.ki else _ONE
        inner = _sum(self.inner.kp * own, np.array([self.inner.ki * dt])) / self.resistance
        slow = np.convolve(outer.rest, outer.integrator)
        reference, reading = np.convolve(outer.reference, inner), np.convolve(outer.reading, inner)
        return _controller(reference, reading, np.convolve(slow, inner), slow, own, self)


_Limited = Pid | StateFeedback | Cascade
Form = _Limited | FilteredPid
# The names of forms in a file; without a form a table is one of `Gains` or a `LinearController`.
FORMS: dict[str, type] = {
    "pid": Pid,
    "state_feedback": StateFeedback,
    "cascade": Cascade,
    "filtered_pid": FilteredPid,
    "transfer_function": LinearController,
}


@dataclass(frozen=True)
class _Parts:
    """Numerators of reference and reading over rest * integrator; the integrator is 1 without an integral."""

    reference: np.ndarray
    reading: np.ndarray
    rest: np.ndarray
    integrator: np.ndarray = field(default_factory=lambda: _ONE)


def _pid(c: Pid, dt: float) -> _Parts:
    """A PID without its limit. Parts with a gain of 0 are left out: a pole that cancels would never decay."""
    integrator = _INTEGRATOR if c.ki else _ONE
    rough = np.array([1.0, -c.td / (c.td + dt)]) if c.kd else _ONE
    smooth = np.array([1.0, -c.setpoint_filter / (c.setpoint_filter + dt)]) if c.setpoint_filter else _ONE
    proportional = c.kp * np.convolve(rough, integrator)
    integral = c.ki * dt * rough
    derivative = c.kd / (c.td + dt) * np.convolve(_INTEGRATOR, integrator) if c.kd else np.zeros(1)
    of_reference = _sum(c.setpoint_weight * proportional, integral, derivative * (c.derivative_on == "error"))
    reading = np.convolve(_sum(proportional, integral, derivative), smooth)
    return _Parts(smooth.sum() * of_reference, reading, np.convolve(rough, smooth), integrator)


def _sum(*polynomials: np.ndarray) -> np.ndarray:
    longest = max(map(len, polynomials))
    return np.sum([np.pad(p, (0, longest - len(p))) for p in polynomials], axis=0)


def _controller(
    reference: np.ndarray,
    reading: np.ndarray,
    current: np.ndarray | None,
    rest: np.ndarray,
    integrator: np.ndarray,
    form: _Limited,
) -> LinearController:
    """The controller with the denominator rest * integrator, in which anti-windup acts on the integrator alone."""
    denominator = np.convolve(rest, integrator)

    def whole(polynomial: np.ndarray) -> tuple[float, ...]:
        return tuple(np.pad(polynomial, (0, len(denominator) - len(polynomial))).tolist())

    own, wanted = whole(reading), whole(reference)
    tracked = form.anti_windup == "tracking" and len(integrator) > 1
    return LinearController(
        own,
        tuple(denominator.tolist()),
        None if wanted == own else wanted,
        () if current is None or not current.any() else whole(current),
        form.limit,
        tuple((whole(rest) - denominator)[1:].tolist()) if tracked else "none",
    )


def _check(part: object, numbers: tuple[str, ...], times: tuple[str, ...] = ()) -> None:
    for name in (*numbers, *times):
        if not is_number(value := getattr(part, name)):
            raise ValueError(f"controller: {name} = {value!r} is not a finite number")
    for name in times:
        if (value := getattr(part, name)) < 0:
            raise ValueError(f"controller: {name} = {value} s must be at least 0")


def _check_form(form: _Limited, numbers: tuple[str, ...], times: tuple[str, ...] = ()) -> None:
    _check(form, numbers, times)
    check_limit(form.limit)
    if form.anti_windup not in ANTI_WINDUP:
        raise ValueError(f"controller: anti_windup = {form.anti_windup!r}; use one of {', '.join(ANTI_WINDUP)}")
