"""Standard gravity, and units that fit the size of a quantity: 2.5 N/m, not 0.0025 kN/m; 75 µs, not 7.5e-05 s."""

from collections.abc import Iterable
from math import isfinite

import numpy as np

STANDARD_GRAVITY = 9.80665  # m/s2
PREFIXES = ((1e9, "G"), (1e6, "M"), (1e3, "k"), (1.0, ""), (1e-3, "m"), (1e-6, "µ"), (1e-9, "n"))
# Units that take a prefix. Quotients take a small one only below SMALL, because 0.93 N/A is read more easily than 930.
PREFIXED = ("s", "Hz", "m", "m/s", "N", "A", "V", "T", "N/m", "N s/m", "N/A")
QUOTIENTS, SMALL = ("N/m", "N s/m", "N/A"), 0.01
ROUNDED = 0.9995  # of a prefix, from which three digits round up to it


def prefixed(size: float, unit: str) -> tuple[float, str]:
    """Factor from SI to the unit in which a size is readable, and that unit; a unit without prefixes stays as it is.

    Args:
        size: in SI; its sign does not matter.
        unit: SI.
    """
    if unit == "kg m":
        return 1e6, "g mm"
    if unit not in PREFIXED or not size or not isfinite(size):
        return 1.0, unit
    if unit in QUOTIENTS and SMALL <= abs(size) < 1.0:
        return 1.0, unit
    factor, prefix = next((p for p in PREFIXES if abs(size) >= p[0] * ROUNDED), PREFIXES[-1])
    return 1 / factor, prefix + unit


def common_unit(sizes: Iterable[float], unit: str) -> tuple[float, str]:
    """As `prefixed`, for a column of sizes: the unit that fits their median; those that are not finite do not count."""
    known = np.abs([size for size in sizes if isfinite(size)])
    return prefixed(float(np.median(known)) if known.size else 0.0, unit)
