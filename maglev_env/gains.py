"""PID gains of one axis, as the digital controller of the nominal rig uses them."""

from dataclasses import asdict, dataclass
from math import isfinite


@dataclass(frozen=True)
class Gains:
    """Gains of command = kp e + kd (e - d) / td + ki x, where d and x low-pass e with td and ti (D eq 3.27).

    kp in A/m, ki in A/(m s) (x has unit gain at d.c., so the integrator leaks), kd in A s/m, td and ti in s.
    Raises ValueError when a gain is not a finite number or a time constant is not positive.
    """

    kp: float
    ki: float
    kd: float
    td: float = 1e-4
    ti: float = 0.0318

    def __post_init__(self) -> None:
        for name, value in asdict(self).items():
            if isinstance(value, bool) or not isinstance(value, int | float) or not isfinite(value):
                raise ValueError(f"gains: {name} = {value!r} is not a finite number")
        for name in ("td", "ti"):
            if getattr(self, name) <= 0:
                raise ValueError(f"gains: {name} = {getattr(self, name)} s must be positive")


NO_CONTROLLER = Gains(0.0, 0.0, 0.0)
