"""Controllers of an axis: PID gains as the nominal rig's digital controller uses them, or any linear filter."""

from dataclasses import asdict, dataclass, replace
from math import exp

import numpy as np

from maglev_env.fields import is_number
from maglev_env.loop.axes import AXES


@dataclass(frozen=True)
class Gains:
    """Gains of command = kp e + kd (e - d) / td + ki x, where d and x are e after low-pass filters (D eq 3.27).

    Args:
        kp: A/m.
        ki: A/(m s); the filter of x has unit gain at zero frequency, so the integrator leaks.
        kd: A s/m.
        td: time constant of the filter of d, s.
        ti: time constant of the filter of x, s.

    Raises:
        ValueError: A gain is not a finite number, or a time constant is not positive.
    """

    kp: float
    ki: float
    kd: float
    td: float = 1e-4
    ti: float = 0.0318

    def __post_init__(self) -> None:
        for name, value in asdict(self).items():
            if not is_number(value):
                raise ValueError(f"gains: {name} = {value!r} is not a finite number")
        for name in ("td", "ti"):
            if getattr(self, name) <= 0:
                raise ValueError(f"gains: {name} = {getattr(self, name)} s must be positive")


@dataclass(frozen=True)
class LinearController:
    """Any linear controller: command / error = numerator / denominator in z (A/m), at the control rate.

    Args:
        numerator: coefficients, highest power of z first.
        denominator: likewise; it starts with 1.

    Raises:
        ValueError: A coefficient is not finite, the denominator does not start with 1, or the numerator is longer than
            the denominator.
    """

    numerator: tuple[float, ...]
    denominator: tuple[float, ...]

    def __post_init__(self) -> None:
        for name in ("numerator", "denominator"):
            values = getattr(self, name)
            if not isinstance(values, tuple) or not values or not all(map(is_number, values)):
                raise ValueError(f"controller: {name} = {values!r}; give finite numbers, the highest power of z first")
        if self.denominator[0] != 1:
            raise ValueError(
                f"controller: the denominator starts with {self.denominator[0]:g}, not 1; divide numerator and "
                f"denominator by it (and leave out leading zeros)"
            )
        if len(self.numerator) > len(self.denominator):
            raise ValueError(
                "controller: the numerator has a higher power of z than the denominator, so it would need the future"
            )

    @property
    def order(self) -> int:
        return len(self.denominator) - 1


Controller = Gains | LinearController
# One controller for every axis, or one for each of x and y.
Controllers = Controller | tuple[Controller, Controller]
NO_CONTROLLER = Gains(0.0, 0.0, 0.0)


def of_axis(controllers: Controllers, axis: int) -> Controller:
    """The controller of one axis (0: x or the only one, 1: y)."""
    return controllers[axis] if isinstance(controllers, tuple) else controllers


def with_gains(controllers: Controllers, **changes: float) -> Controllers:
    """The controllers with some gains replaced in every axis.

    Raises:
        ValueError: A controller is linear and therefore has no gains.
    """
    if isinstance(controllers, tuple):
        x, y = (_with_gains(one, **changes) for one in controllers)
        return x, y
    return _with_gains(controllers, **changes)


def _with_gains(controller: Controller, **changes: float) -> Controller:
    if changes and not isinstance(controller, Gains):
        raise ValueError(f"{', '.join(changes)}: the rig's controller is given by numerator and denominator, not gains")
    return replace(controller, **changes)


def as_table(controllers: Controllers) -> dict:
    """The controllers as the [gains] table of a rig or campaign TOML."""
    if isinstance(controllers, tuple):
        return {axis: asdict(one) for axis, one in zip(AXES, controllers, strict=True)}
    return asdict(controllers)


def state_space(controller: Controller, dt: float) -> tuple[np.ndarray, np.ndarray, np.ndarray, float]:
    """State-space matrices A (n, n), B (n,), C (n,) and D from error (m) to command (A), sampled every dt (s)."""
    if isinstance(controller, Gains):
        a_d, a_i = exp(-dt / controller.td), exp(-dt / controller.ti)
        slope = controller.kd / controller.td
        return (
            np.diag([a_d, a_i]),
            np.array([1 - a_d, 1 - a_i]),
            np.array([-slope, controller.ki]),
            controller.kp + slope,
        )
    n = controller.order
    b, a = numerator_of(controller), np.array(controller.denominator)
    matrix = np.eye(n, k=1)
    matrix[:, :1] -= a[1:, None]
    return matrix, b[1:] - a[1:] * b[0], np.eye(1, n)[0] if n else np.zeros(0), float(b[0])


def numerator_of(controller: LinearController) -> np.ndarray:
    """The numerator, padded with leading zeros to as many coefficients as the denominator, (order + 1,)."""
    return np.concatenate([np.zeros(controller.order + 1 - len(controller.numerator)), controller.numerator])


def controller_response(controller: Controller, z: np.ndarray, dt: float) -> np.ndarray:
    """Command / error, A/m, at points z (n,) of the unit circle."""
    a, b, c, d = state_space(controller, dt)
    return d + np.linalg.solve(z[:, None, None] * np.eye(len(a)) - a, b[:, None])[..., 0] @ c
