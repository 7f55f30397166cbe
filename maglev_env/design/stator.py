"""Section of a hybrid bearing's stator, the coil that fits into it, and the force of its coils (D eq 3.1, 3.2)."""

from dataclasses import dataclass, fields
from math import floor

from selfsense.coil import MU_0, is_number

_ROUNDING = 1e-9  # a window of exactly n wires holds n of them


@dataclass(frozen=True)
class StatorSection:
    """Lamination stack of one pole, lengths in m (D Fig 3.23, eq 3.1).

    Attributes:
        inner_diameter: d1, the rotor's diameter plus two air gaps.
        outer_diameter: d2.
        core_thickness: t_l2, of the middle lamination set around which the coil is wound.
        wire_diameter: Of the coil's wire.
        coil_length: Axial room for layers of wire.
        hole_diameter: Of the bolts in the outer rim.

    Raises:
        ValueError: Unless all are positive and hole_diameter < t_l2 < (d5 - d1) / 2: a thinner core is cut by its bolt,
            a thicker one leaves the coil no window.
    """

    inner_diameter: float
    outer_diameter: float
    core_thickness: float
    wire_diameter: float
    coil_length: float
    hole_diameter: float = 2e-3

    def __post_init__(self) -> None:
        for f in fields(self):
            value = getattr(self, f.name)
            if not (is_number(value) and value > 0):
                raise ValueError(f"stator: {f.name} = {value!r} must be a length in m, above 0")
        room = (self.hole_circle - self.inner_diameter) / 2
        if not self.hole_diameter < self.core_thickness < room:
            raise ValueError(
                f"stator: core_thickness = {self.core_thickness:g} m must lie between the hole diameter "
                f"{self.hole_diameter:g} m and half of d5 - d1, {room:g} m; change the thickness or the diameters"
            )

    @property
    def hole_circle(self) -> float:
        """d5, between the innermost points of opposite bolt holes, m."""
        return self.outer_diameter - self.hole_diameter

    @property
    def core_inner_diameter(self) -> float:
        """d3, of the middle lamination set, m."""
        return (self.hole_circle + self.inner_diameter) / 2 - self.core_thickness

    @property
    def core_outer_diameter(self) -> float:
        """d4, of the middle lamination set, m."""
        return (self.hole_circle + self.inner_diameter) / 2 + self.core_thickness

    @property
    def window_height(self) -> float:
        """Radial room for the wires of one layer, m."""
        return (self.core_inner_diameter - self.inner_diameter) / 2

    @property
    def turns_per_layer(self) -> int:
        return floor(self.window_height / self.wire_diameter + _ROUNDING)

    @property
    def layers(self) -> int:
        return floor(self.coil_length / self.wire_diameter + _ROUNDING)

    @property
    def turns(self) -> int:
        """Turns that fit with square packing: the most that the window holds, more than a winder achieves."""
        return self.turns_per_layer * self.layers


def attraction(turns: float, current: float, gap: float, pole_area: float, bearings: int = 1) -> float:
    """Force (N) of the coils without magnets, on both faces of each magnet: mu_0 N^2 A_g I^2 / (4 g^2) (D eq 3.2).

    Args:
        turns: Of each coil.
        current: A.
        gap: m.
        pole_area: Of one face, m2.
        bearings: Number of magnets that pull together.

    Raises:
        ValueError: Unless gap and pole_area are positive.
    """
    for name, value in (("gap", gap), ("pole_area", pole_area)):
        if not value > 0:
            raise ValueError(f"attraction: {name} = {value!r} must be above 0")
    return bearings * MU_0 * turns**2 * pole_area * current**2 / (4 * gap**2)
