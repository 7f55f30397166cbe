"""Two axes that a file calls by other letters than x and y: "V13" and "W13" of a bearing's two probes."""

import re
from collections.abc import Mapping

from maglev_env.recordings.guess.units import Unit
from maglev_env.recordings.guess.words import unaccented

# What the two axes of one bearing are called. Numbers, a and b may as well be two planes or two coils of one axis.
_PAIRS = (("v", "w"), ("h", "v"), ("hor", "ver"), ("horizontal", "vertical"), ("horiz", "vert"))
_LEAST = 2  # quantities that stand along both axes, from which the letters are axes


def spelled_as_xy(labels: Mapping[str, tuple[str, Unit | None]]) -> dict[str, str]:
    """Names of columns with x and y in place of what the file calls its two axes.

    Args:
        labels: by column, what the file calls it, and its unit.

    Returns:
        By column, only of those that have a counterpart along the other axis; empty where fewer than two quantities of
        different units have one, since a V beside a W may be a voltage beside a set point.
    """
    for first, second in _PAIRS:
        found: dict[str, str] = {}
        units = set()
        for name, (label, unit) in labels.items():
            beside = _spelled(label, first, second)
            others = [n for n, (own, _) in labels.items() if n != name and unaccented(own).lower() == beside]
            if unit and len(others) == 1 and labels[others[0]][1] == unit:
                found |= {name: _spelled(label, first, "x"), others[0]: _spelled(labels[others[0]][0], second, "y")}
                units.add(unit.si)
        if len(units) >= _LEAST:
            return found
    return {}


def _spelled(label: str, axis: str, instead: str) -> str:
    """A name in small letters, with another word in place of an axis."""
    return re.sub(rf"(?<![a-z]){axis}(?![a-z])", instead, unaccented(label).lower())
