"""Gain and stiffness of the magnets that are off by the same share: one cause that has no name of its own here."""

from collections.abc import Mapping
from math import hypot

from sim2real.compared.whole_gain import GAIN, STIFFNESS
from sim2real.words import Fitted, percent

ALIKE, LARGE = 2.0, 0.03  # standard errors by which both may differ, and the share from which on it is worth a word


def weaker_pull(effects: tuple[str, ...], fitted: Mapping[str, Fitted]) -> str | None:
    """What makes both of these at once; None where something else is named, or where they differ.

    Args:
        effects: What is named.
        fitted: Its fitted parameters, by "effect.parameter".
    """
    if {*effects} != {GAIN, STIFFNESS}:
        return None
    gain, stiffness = (fitted[f"{name}.change"] for name in (GAIN, STIFFNESS))
    if gain["se"] is None or stiffness["se"] is None or abs(gain["value"]) < LARGE:
        return None
    if abs(gain["value"] - stiffness["value"]) > ALIKE * hypot(gain["se"], stiffness["se"]):
        return None
    way = "less" if gain["value"] < 0 else "more"
    return (
        f"gain and stiffness are off by the same share: magnets that pull {way} throughout, by "
        f"{percent(abs(gain['value']))}, have both; check the bias, the gap, and whether the iron is near saturation "
        "at rest"
    )
