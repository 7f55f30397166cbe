"""Zones of ISO 14839: part 3 grades the peak sensitivity of a loop, part 2 its peak displacement."""


def iso_14839_3_zone(peak_sensitivity: float) -> str:
    """Zone of ISO 14839-3 by the peak of |S|: "A" below 3, "B" below 4, "C" below 5, otherwise "D".

    Raises:
        ValueError: The value is negative.
    """
    return _zone("peak_sensitivity", peak_sensitivity, (3.0, 4.0, 5.0))


def iso_14839_2_zone(peak_displacement: float, clearance: float) -> str:
    """Zone of ISO 14839-2 by peak displacement over minimum clearance: "A" below 0.3, "B" 0.4, "C" 0.5, otherwise "D".

    Args:
        peak_displacement: In the unit of clearance.
        clearance: Smallest clearance.

    Raises:
        ValueError: peak_displacement is negative or clearance is not positive.
    """
    if not clearance > 0:
        raise ValueError("clearance must be positive")
    return _zone("peak_displacement", peak_displacement / clearance, (0.3, 0.4, 0.5))


def _zone(name: str, value: float, limits: tuple[float, ...]) -> str:
    if not value >= 0:
        raise ValueError(f"{name} must be a number that is not negative")
    return "ABCD"[sum(value >= limit for limit in limits)]
