"""Rigs of two axes: their names, and what couples them."""

from dataclasses import dataclass, fields

from maglev_env.fields import is_number

AXES = ("x", "y")


@dataclass(frozen=True)
class Cross:
    """What one axis does to the other; _xy is y's share in x.

    stiffness (N/m): force on x of -stiffness_xy times y; damping (N s/m) likewise; gain (N/A): force on x per ampere
    in y; sensor: share of y in the reading of x. Raises ValueError when a value is not finite.
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
        """Stiffness, damping, gain and sensor share that the other axis has in axis 0 (x) or 1 (y)."""
        pair = ("xy", "yx")[axis]
        return tuple(getattr(self, f"{name}_{pair}") for name in ("stiffness", "damping", "gain", "sensor"))


NO_CROSS = Cross()


def suffixes(axes: int) -> tuple[str, ...]:
    """What channels of each axis end with: nothing on a one-axis rig, else _x and _y."""
    return ("",) if axes == 1 else tuple(f"_{axis}" for axis in AXES)
