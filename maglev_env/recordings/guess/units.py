"""Units in column headers: `pos [mm]`, `i (A)`, `gap_um`, `Weg / mm`."""

import math
import re
import unicodedata
from dataclasses import dataclass

from maglev_env.recordings.guess.words import meaning
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
_UNITS = {
    **{f"{p}{si}": (si, factor) for si in ("m", "A", "V", "N", "s") for p, factor in _PREFIXES.items()},
    **{"sec": ("s", 1.0), "micron": ("m", 1e-6), "microns": ("m", 1e-6), "cm": ("m", 1e-2), "mils": ("m", 25.4e-6)},
    **{"rad/s": ("rad/s", 1.0), "rpm": ("rad/s", math.pi / 30), "1/min": ("rad/s", math.pi / 30)},
    **{"m/s": ("m/s", 1.0), "mm/s": ("m/s", 1e-3), "mm/s2": ("m/s2", 1e-3), "mm/s^2": ("m/s2", 1e-3)},
    **{text: ("m/s2", 1.0) for text in ("m/s2", "m/s^2", "m/s**2", "m/s/s", "m s-2", "m s^-2")},
    **{"millis": ("s", 1e-3), "micros": ("s", 1e-6)},  # what a microcontroller's clocks are called
    **{"g": ("m/s2", STANDARD_GRAVITY), "mg": ("m/s2", 1e-3 * STANDARD_GRAVITY)},
    **{f"{p}{s}/s": ("Hz", f) for s in ("S", "Sa") for p, f in (("", 1.0), ("k", 1e3), ("M", 1e6))},
    **{"Hz": ("Hz", 1.0), "kHz": ("Hz", 1e3), "C": ("C", 1.0), "°C": ("C", 1.0), "%": ("%", 0.01)},
}  # fmt: skip
_FOLDED = {name.lower(): name for name in reversed(_UNITS) if name.lower() not in ("mn", "ma", "mv", "ms")}
_FOLDED |= {"ma": "mA", "mv": "mV", "ms": "ms", "mn": "mN"}
_SINGLE = {"m": ("displacement", "reference", "gap_estimate"), "s": ("time",)}
_LONGEST = 200  # characters of a header that may hold a unit: the search takes the square of them
_WORD = 3  # letters from which a name is a word
_BRACKETS = re.compile(r"^(.*?)[\s_,]*[\[(<{]\s*(?:in\s+)?([^\])>}]+?)\s*[\])>}]\s*$")
_BEHIND = re.compile(r"^(.*\S)\s*(?:\s/\s*|/|\s+in\s+|,\s*)([^\s/]+(?:/[^\s/]+)?)$")
_RATIO_BEHIND = re.compile(r"^(.*?\S)\s*(?:\s/\s*|/|\s+in\s+|,\s*)([^\s/]+/[^\s/]+)$")  # "a / m/s2"
_RATIO = re.compile(r"^(.+?)[_\s]([a-zµμ]+_s2?)$")  # a name that a program made of m/s2
_LAST = re.compile(r"^(.+?)[_\s]([A-Za-zµμ]{1,7})$")


def known_unit(text: str) -> Unit | None:
    """The unit of this name; None where there is none such."""
    name = unicodedata.normalize("NFKC", text.strip())  # "m/s²" is m/s2
    name = name if name in _UNITS else _FOLDED.get(name.lower(), "")
    return Unit(text.strip(), *_UNITS[name]) if name else None


def header_unit(header: str) -> tuple[str, Unit | None]:
    """A header without its unit, and the unit.

    Args:
        header: as the file has it.

    Returns:
        The name, and the unit in brackets, behind a slash, "in" or a comma, or as the last word; None without one.
    """
    header = header.strip()
    if len(header) > _LONGEST:
        return header, None
    if len(header) > 1 and header in _UNITS:  # a column that is called by its unit alone
        return header, known_unit(header)
    for pattern in (_BRACKETS, _RATIO_BEHIND, _BEHIND):
        if (found := pattern.match(header)) and (unit := known_unit(found[2])):
            return found[1].strip(" _,"), unit
    if (found := _RATIO.match(header)) and (unit := known_unit(found[2].replace("_", "/"))):
        return found[1], unit
    if found := _LAST.match(header):
        # A single last letter may as well be an index or "measured": of those only the units' own capitals count, and
        # m and s behind a whole word for a length or a time.
        word = len(found[1]) >= _WORD and meaning(found[1]).channel in _SINGLE.get(found[2], ())
        unit = known_unit(found[2]) if len(found[2]) > 1 or found[2] in ("A", "V", "N") or word else None
        if unit:
            return found[1], unit
    return header, None
