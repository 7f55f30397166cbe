"""The coil of one magnet: its current as a function of voltage and gap (D eq 6.6-6.14)."""

from dataclasses import dataclass, fields
from math import isfinite

import numpy as np

MU_0 = 4e-7 * np.pi


def is_number(value: object) -> bool:
    """Whether a value is a finite real number and not a truth value."""
    try:
        return (
            isinstance(value, int | float | np.integer | np.floating)
            and not isinstance(value, bool)
            and isfinite(value)
        )
    except OverflowError:  # an integer beyond the range of floats
        return False


@dataclass(frozen=True)
class Coil:
    """A coil whose flux crosses two air gaps and a core, SI.

    Attributes:
        turns: Number of turns.
        pole_area: m^2.
        resistance: ohm.
        core_length: Length of the core over its relative permeability, m: the air gap of equal reluctance.
        back_emf: Whether the current follows D eq 6.12, or eq 6.13 without the voltage of the motion.
        magnet_emf: Voltage per speed of the widening gap caused by a permanent magnet in the circuit, V s/m; positive
            where the flux drops.
        bias_field: Field of that magnet, T.
        saturation_field: Field at which the core's reluctance has doubled, T; it rises with the 8th power.
        lamination: Thickness of the core's sheets, m, whose eddy currents delay the flux; 0 for none.
        permeability: Relative permeability of the sheets.
        conductivity: Conductivity of the sheets, S/m.

    Raises:
        ValueError: A value is not a finite number in its physical range, or eddy currents or saturation are requested
            without a core or without the back-EMF.
    """

    turns: float
    pole_area: float
    resistance: float = 0.0
    core_length: float = 0.0
    back_emf: bool = True
    magnet_emf: float = 0.0
    bias_field: float = 0.0
    saturation_field: float | None = None
    lamination: float = 0.0
    permeability: float = 5000.0
    conductivity: float = 2e6

    def __post_init__(self) -> None:
        for f in fields(self):
            value = getattr(self, f.name)
            if f.name == "back_emf" or (f.name == "saturation_field" and value is None):
                continue
            if not is_number(value):
                raise ValueError(f"coil: {f.name} = {value!r} is not a finite number")
            if f.name in _POSITIVE and value <= 0:
                raise ValueError(f"coil: {f.name} = {value:g} must be positive")
            if f.name not in ("magnet_emf", "bias_field") and value < 0:
                raise ValueError(f"coil: {f.name} = {value:g} must be at least 0")
        if self.has_core_losses and not self.core_length:
            raise ValueError("coil: eddy currents and saturation need a core: give core_length")
        if self.has_core_losses and not self.back_emf:
            raise ValueError("coil: eddy currents and saturation are computed with the back-EMF: set back_emf")

    @property
    def has_core_losses(self) -> bool:
        """Whether the core is more than a constant reluctance."""
        return self.saturation_field is not None or self.lamination > 0

    @property
    def constant(self) -> float:
        """mu_0 N^2 A_g, H m: inductance times twice the gap."""
        return MU_0 * self.turns**2 * self.pole_area

    @property
    def diffusion_time(self) -> float:
        """Time constant (s) tau of the flux's diffusion into a sheet: reluctance grows by z coth z, z^2 = s tau."""
        return MU_0 * self.permeability * self.conductivity * (self.lamination / 2) ** 2

    def inductance(self, gap: np.ndarray | float) -> np.ndarray | float:
        """Inductance (H) at a gap (m), D eq 6.11; shape of gap."""
        return self.constant / (self.core_length + 2 * np.asarray(gap))


_POSITIVE = ("turns", "pole_area", "saturation_field", "permeability", "conductivity")


def coil_inductance(gap: np.ndarray | float, turns: float, pole_area: float) -> np.ndarray | float:
    """Inductance (H) of a coil on ideal iron whose flux crosses two air gaps of length gap (m): mu_0 N^2 A_g / (2 g).

    D eq 6.11. Shape of gap. At 0.35 mm, 90 turns and 39.27 mm2 it is the measured 0.57 mH."""
    return MU_0 * turns**2 * pole_area / (2 * gap)
