"""Rigs with two axes: the names of the axes and the coupling between them."""

from dataclasses import dataclass, fields

from maglev_env.fields import is_number

AXES = ("x", "y")


@dataclass(frozen=True)
class Cross:
    """Linear coupling between the axes; _xy is the influence of y on x, _yx that of x on y.

    Args:
        stiffness_xy, stiffness_yx: N/m; the force on x is -stiffness_xy times y.
        damping_xy, damping_yx: N s/m; the force on x is -damping_xy times the velocity in y.
        gain_xy, gain_yx: N/A; force on x per ampere in y.
        sensor_xy, sensor_yx: share of y in the reading of x.

    Raises:
        ValueError: A value is not finite.
    """

    stiffness_xy: float = 0.0
    stiffness_yx: float = 0.0
    damping_xy: float = 0.0
    damping_yx: float = 0.0
    gain_xy: float = 0.0
    gain_yx: float = 0.0
    sensor_xy: float = 0.0
    sensor_yx: float = 0.0

    def __post_init__(self) -> None:
        for f in fields(self):
            value = getattr(self, f.name)
            if not is_number(value):
                raise ValueError(f"[cross]: {f.name} = {value!r} is not a finite number")

    def onto(self, axis: int) -> tuple[float, float, float, float]:
        """Stiffness, damping, gain and sensor share by which the other axis acts on axis 0 (x) or 1 (y)."""
        pair = ("xy", "yx")[axis]
        return tuple(getattr(self, f"{name}_{pair}") for name in ("stiffness", "damping", "gain", "sensor"))


NO_CROSS = Cross()


def suffixes(axes: int) -> tuple[str, ...]:
    """Suffixes of the channel names: an empty one on a one-axis rig, else _x and _y."""
    return ("",) if axes == 1 else tuple(f"_{axis}" for axis in AXES)
