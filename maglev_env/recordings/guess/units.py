"""Units in column headers: `pos [mm]`, `i (A)`, `gap_um`, `Weg / mm`."""

import re
from collections.abc import Iterable

from maglev_env.recordings.formats.known_units import AS_WRITTEN, UNITS, Unit, known_unit
from maglev_env.recordings.guess.words import COUNTS, meaning

_READ = ("displacement", "gap_estimate", "current", "force", "velocity", "acceleration", "error")  # by a transducer
# Channels behind whose names a single letter is a unit: it may as well be a plane "A", a phase "V" or an index. A
# transducer's volts stand for any quantity, and what shakes the rotor often has a name of its own.
_SINGLE = {
    "m": ("displacement", "reference", "gap_estimate"),
    "s": ("time",),
    "A": ("current", "command", "injection", "reference"),
    "N": ("force", "injection", "reference", None),
    "V": ("voltage", "command", "injection", "reference", *_READ),
}
_WORD = 3  # letters from which a name is a word
_BRACKETS = re.compile(r"^(.*?)[\s_,]*[\[(<{]\s*(?:in\s+)?([^\])>}]+?)\s*[\])>}]\s*$")
_BEHIND = re.compile(r"^(.*\S)\s*(?:\s/\s*|/|\s+in\s+|,\s*)([^\s/]+(?:/[^\s/]+)?)$")
_RATIO_BEHIND = re.compile(r"^(.*?\S)\s*(?:\s/\s*|/|\s+in\s+|,\s*)([^\s/]+/[^\s/]+)$")  # "a / m/s2"
_RATIO_LAST = re.compile(r"^(.+?)[\s_]+([^\s/_]+/[^\s/_]+)$")  # "Drehzahl U/min"
_RATIO = re.compile(r"^(.+?)[_\s]([a-zµμ]+_s2?)$")  # a name that a program made of m/s2
_LAST = re.compile(r"^(.+?)[_\s]([A-Za-zµμ]{1,7})$")
_WITHIN = re.compile(r"^(.+?)_([A-Za-zµμ]{2,7})_([A-Za-z]\w*)$")  # "gap_um_filtered"
_LONGEST = 200  # characters of a header that may hold a unit: the search takes the square of them
# Of times alone: elsewhere a minimum, or an index.
_OF_TIMES = {"min": 60.0, "minutes": 60.0, "h": 3600.0, "hours": 3600.0, "d": 86400.0, "days": 86400.0}
_UNLIKE = "filt filtered mean avg rms abs rel left right top bottom upper lower"  # words in brackets that are no units
_LIKE = re.compile(r"[A-Za-zµμ°Ω][A-Za-zµμ°Ω/^.*-]{0,7}")


def header_unit(header: str, among: Iterable[str] = ()) -> tuple[str, Unit | None]:
    """A header without its unit, and the unit.

    Args:
        header: as the file has it.
        among: names of the file's other columns: beside a "gap_B", the letter of "gap_A" is no unit.

    Returns:
        The name, and the unit in brackets, behind a slash, "in" or a comma, or as the last word; None without one.
    """
    header = header.strip()
    if len(header) > _LONGEST:
        return header, None
    if (known := _of_its_place(header))[1]:
        return known
    if len(header) > 1 and header in UNITS:  # a column that is called by its unit alone
        return header, known_unit(header)
    for pattern in (_BRACKETS, _RATIO_BEHIND, _RATIO_LAST, _BEHIND):
        if (found := pattern.match(header)) and (unit := _unit_behind(found[1], found[2])):
            return found[1].strip(" _,"), unit
    if (found := _RATIO.match(header)) and (unit := known_unit(found[2].replace("_", "/"))):
        return found[1], unit
    found = _LAST.match(header)
    if found and (len(found[2]) > 1 or _is_single(*found.groups(), among)) and (unit := _unit_behind(*found.groups())):
        return found[1], unit
    return header, None


def _unit_behind(name: str, text: str) -> Unit | None:
    """The unit behind a name; of AS_WRITTEN also in capitals, where the name says that it is no other one."""
    small = text.lower()
    capitals = text in ("NM", "MS") and name.isupper()
    if small in AS_WRITTEN and (capitals or (small.endswith("g") and meaning(name).channel == "acceleration")):
        return Unit(text, *UNITS[small])
    return known_unit(text)


def _is_single(name: str, letter: str, among: Iterable[str]) -> bool:
    """Whether the last letter of a header is its unit: behind a quantity in it, of which no column has another letter.

    A small letter may be an index or "measured", too, and counts only behind a whole word.
    """
    if (letter.islower() and len(name) < _WORD) or meaning(name).channel not in _SINGLE.get(letter, ()):
        return False
    others = (_LAST.match(other.strip()) for other in among)
    letters = {other[2] for other in others if other and other[1] == name and len(other[2]) == 1}
    return letters <= _SINGLE.keys()


def unit_beside(name: str, text: str) -> Unit | None:
    """The unit that a text states beside a name: also one of times alone, and one that is counted from a date."""
    text = text.strip().partition(" since ")[0]
    if text in _OF_TIMES and meaning(name).channel == "time":
        return Unit(text, "s", _OF_TIMES[text])
    return known_unit(text)


def _of_its_place(header: str) -> tuple[str, Unit | None]:
    """A header without a unit that only its place tells: behind a time, from a date on, in brackets, within a name."""
    bracket, behind, within = _BRACKETS.match(header), _BEHIND.match(header), _WITHIN.match(header)
    if bracket and bracket[2] == "in":
        return bracket[1], Unit("in", "m", 25.4e-3)
    for found in filter(None, (bracket, behind)):
        if (found[2] in _OF_TIMES or " since " in found[2]) and (unit := unit_beside(found[1], found[2])):
            return found[1].strip(" _,"), unit
    if within and within[3] not in ("s", "s2") and not known_unit(within[3]) and (unit := known_unit(within[2])):
        return f"{within[1]}_{within[3]}", unit
    return header, None


def unknown_unit(header: str) -> str:
    """What stands in brackets behind a header as a unit does, but is none that is known; "" without such a text."""
    found = _BRACKETS.match(header[-_LONGEST:])
    text = found[2] if found else ""
    capitals = len(text) > 1 and text.isupper() and not header.isupper()  # a place, as "DE" for the driven end
    if not _LIKE.fullmatch(text) or capitals or text.lower() in _UNLIKE.split() or meaning(text).channel is not None:
        return ""
    return "" if known_unit(text) or text.lower() in COUNTS.split() else text
