"""The units that a file may state of its columns, by all the names that they have there."""

import math
import unicodedata
from dataclasses import dataclass

from maglev_env.units import STANDARD_GRAVITY


@dataclass(frozen=True)
class Unit:
    """A unit as a header writes it.

    Args:
        text: as written.
        si: the SI unit that it is a multiple of.
        scale: SI value of one of it.
    """

    text: str
    si: str
    scale: float


_PREFIXES = {"": 1.0, "m": 1e-3, "u": 1e-6, "µ": 1e-6, "μ": 1e-6, "n": 1e-9, "k": 1e3}
UNITS = {
    **{f"{p}{si}": (si, factor) for si in ("m", "A", "V", "N", "s") for p, factor in _PREFIXES.items()},
    **{"sec": ("s", 1.0), "micron": ("m", 1e-6), "microns": ("m", 1e-6), "cm": ("m", 1e-2), "mils": ("m", 25.4e-6)},
    **{f"{p}sec": ("s", factor) for p, factor in (("m", 1e-3), ("u", 1e-6), ("µ", 1e-6), ("n", 1e-9))},
    **{f"{p}seconds": ("s", factor) for p, factor in (("", 1.0), ("milli", 1e-3), ("micro", 1e-6), ("nano", 1e-9))},
    **{"mil": ("m", 25.4e-6), "thou": ("m", 25.4e-6), "inch": ("m", 25.4e-3)},
    **{"daN": ("N", 10.0), "kgf": ("N", STANDARD_GRAVITY), "lbf": ("N", 0.45359237 * STANDARD_GRAVITY)},
    **{"rad/s": ("rad/s", 1.0), "rpm": ("rad/s", math.pi / 30), "1/min": ("rad/s", math.pi / 30)},
    **{"m/s": ("m/s", 1.0), "mm/s": ("m/s", 1e-3), "mm/s2": ("m/s2", 1e-3), "mm/s^2": ("m/s2", 1e-3)},
    **{text: ("m/s2", 1.0) for text in ("m/s2", "m/s^2", "m/s**2", "m/s/s", "m s-2", "m s^-2")},
    **{"millis": ("s", 1e-3), "micros": ("s", 1e-6)},  # what a microcontroller's clocks are called
    **{"g": ("m/s2", STANDARD_GRAVITY), "mg": ("m/s2", 1e-3 * STANDARD_GRAVITY)},
    **{f"{p}{s}/s": ("Hz", f) for s in ("S", "Sa") for p, f in (("", 1.0), ("k", 1e3), ("M", 1e6))},
    **{text: ("rad/s", math.pi / 30) for text in ("U/min", "r/min", "rev/min", "min-1", "min^-1")},
    **{"1/s": ("Hz", 1.0)},  # of a speed in it, it is open whether it counts turns or radians
    **{"Hz": ("Hz", 1.0), "kHz": ("Hz", 1e3), "C": ("C", 1.0), "°C": ("C", 1.0), "%": ("%", 0.01)},
}  # fmt: skip
# In other letters these are units of other quantities: newton metres, millisiemens, gauss.
AS_WRITTEN = ("nm", "ms", "g", "mg")
_FOLDED = {name.lower(): name for name in reversed(UNITS) if name.lower() not in ("mn", "ma", "mv", *AS_WRITTEN)}
_FOLDED |= {"ma": "mA", "mv": "mV", "mn": "mN"}


def known_unit(text: str) -> Unit | None:
    """The unit of this name; None where there is none such."""
    name = unicodedata.normalize("NFKC", text.strip()).replace("−", "-")  # "m/s²" is m/s2
    name = name if name in UNITS else _FOLDED.get(name.lower(), "")
    return Unit(text.strip(), *UNITS[name]) if name else None
