"""Units of the numbers in a goal: SI, with prefixes, and decibels and percent of ratios."""

import re

PREFIXES = {"": 1.0, "n": 1e-9, "u": 1e-6, "µ": 1e-6, "μ": 1e-6, "m": 1e-3, "k": 1e3, "M": 1e6}
KINDS = ("rms", "peak")  # of the value of an alternating quantity
_PREFIX = "([nuµμmkM]?)"


def in_si(value: float, unit: str | None, si: str, kind: str = "") -> float:
    """A value that is stated in a unit, in that of SI.

    Args:
        value: As stated.
        unit: Of the value; None: it is SI.
        si: "" for a ratio, "deg", or such as "N s/m".
        kind: A word that may stand behind the unit: "rms" or "peak".

    Raises:
        ValueError: The unit is another one; the message says which would be understood.
    """
    if unit is None:
        return value
    if si == "":
        if unit in ("dB", "%"):
            return _rounded(10 ** (value / 20) if unit == "dB" else value / 100)
        raise ValueError(f"{unit!r} is not a unit of a ratio, which are dB and %")
    if si == "deg":
        if unit in ("deg", "degrees", "°"):
            return value
        raise ValueError(f"{unit!r} is not deg, degrees or °")
    above, _, below = si.partition("/")
    tops, bottoms = above.split(), below.split()
    pattern = r"\s*[*·]?\s*".join(_PREFIX + one for one in tops)
    if bottoms:
        pattern += r"\s*/\s*" + r"\s*[*·]?\s*".join(_PREFIX + one for one in bottoms)
    plain = unit.removesuffix(f" {kind}").rstrip() if kind else unit
    found = re.fullmatch(pattern, plain)
    if found is None:
        stated, _, other = unit.rpartition(" ")
        if kind and other in KINDS and re.fullmatch(pattern, stated.rstrip()):
            raise ValueError(f"{unit!r} is not {stated.rstrip()} {kind}")
        raise ValueError(f"{unit!r} is not {si}, nor with n, u, m, k or M before its units")
    sizes = [PREFIXES[one] for one in found.groups()]
    for size in sizes[: len(tops)]:
        value *= size
    for size in sizes[len(tops) :]:
        value /= size
    return _rounded(value)


def _rounded(value: float) -> float:
    """As many digits as the text of a goal has, so that the goal that is read from it is the same."""
    return float(f"{value:g}")
