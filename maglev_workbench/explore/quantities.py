"""Two ways to write a quantity: as in the files (SI), or as on the bench."""

from typing import Literal

import numpy as np

UnitSystem = Literal["files", "bench"]
UNIT_SYSTEMS: tuple[UnitSystem, ...] = ("files", "bench")
# SI unit -> factor from SI and the unit on the bench. What is not listed is the same in both.
_BENCH: dict[str, tuple[float, str]] = {
    "A/m": (1e-3, "A/mm"),
    "A/(m s)": (1e-3, "A/(mm s)"),
    "s": (1e3, "ms"),
    "N/m": (1e-3, "N/mm"),
    "m": (1e6, "µm"),
    "m/N": (1e6, "µm/N"),
    "m/s": (1e3, "mm/s"),
    "kg m": (1e6, "g mm"),
    "rad": (180 / np.pi, "°"),
}


def shown(unit: str, system: UnitSystem) -> tuple[float, str]:
    """Factor from SI, and the unit, in which a quantity of this SI unit is shown."""
    return _BENCH.get(unit, (1.0, unit)) if system == "bench" else (1.0, unit)


def labelled(quantity: str, unit: str) -> str:
    """The label of an axis: "Stiffness, N/mm"."""
    return f"{quantity}, {unit}" if unit else quantity
