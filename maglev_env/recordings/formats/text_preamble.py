"""What the lines above a table say of its columns beside their names: labels, units, and numbers that have a name."""

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from maglev_env.recordings.formats.known_units import UNITS, known_unit
from maglev_env.recordings.formats.stamps import time_of_day

_NAMES = re.compile(r"(symbol|channel|signal|trace)?[ _]?(name|label)s?|bezeichnung", re.IGNORECASE)
_UNITS = re.compile(r"(y|v|vertical|signal|channel)?[ _]?(units?|einheit(en)?)([ _]label)?", re.IGNORECASE)
_NUMBERED = re.compile(r"[A-Za-z]{2,8}[ _]?\d+|\d+")  # "CH1", "Channel 2": says which input, not what was measured
# What may stand in a row of units beside the known ones: what is read as no unit must not be taken for a name either.
_UNIT = re.compile(
    r"[\[(].*[\])]||-|1|%|[kmuµμn]?(s|m|A|V|N|Hz|W|Nm|T|rad|g|Ohm|Ω|Pa|bar)|[muµμ]H|cm|[MGh]Pa|m?m/s(\^?2|²)?|rad/s2?|deg|°"
    r"|K|°C|degC|C|dB|ppm|VA|psi|lbf|mil|[1Ur]/min|min(\^?-1|⁻¹)|[1Ur]/s|(?i:(m|u|µ)?secs?|min|rpm|mbar|inch|microns?"
    r"|gauss|rev|(volt|amp|ampere|second|newton)s?|counts?|cts|ticks|digits?|lsb|inc|bits?|sequence)"
)
_RATIO = re.compile(r"[A-Za-zµμΩ°]{1,4}/[A-Za-zµμΩ°]{1,4}[23²³]?")  # "l/min", "mm/V"
_WORDS = {"volt": "V", "amp": "A", "ampere": "A", "second": "s", "newton": "N"}
_SHORTEST = 3  # letters from which a unit in other letters than its own is one and no name, as "Mils"
_NO_UNIT = ("", "-", "1", "None", "Sequence")
_LONGEST = 200  # characters of a line that may state a number
_SAID = re.compile(r"[#%/\s]*([^:=]*[^:=\s])\s*[:=]\s*(\S.*)")  # "# sample rate: 1 kHz"
_MEASURED = re.compile(r"(\S*\d\S*?)\s*([A-Za-zµμ%°]\S*)?")  # "1 ms", "1ms", "1000"


@dataclass(frozen=True)
class Preamble:
    """What stands above the numbers of a text file.

    Attributes:
        headers: Of every column what the file calls it, with its unit in brackets; "" where nothing is said.
        numbers: Numbers by what the file calls them, such as "Sample Interval"; a unit that stands behind the number
            is put behind the name, "Sample Interval [ms]".
    """

    headers: tuple[str, ...]
    numbers: Mapping[str, float]


def read_preamble(rows: Sequence[Sequence[str]], names: Sequence[str], decimal: str) -> Preamble:
    """Read the lines above the numbers.

    A row of labels or units begins with a word that says so. Where several columns have a time of their own, the word
    stands above each of these times again, as TwinCAT writes it.

    Args:
        rows: The cells of each line.
        names: Of the columns, "" where there is none.
        decimal: The decimal sign of the numbers.
    """
    columns = len(names)
    labels, units = [""] * columns, [""] * columns
    for cells in rows:
        key, own = (cells[0] if cells else ""), list(cells[:columns])
        if len(own) < columns or not any(own):
            continue
        if are_units(own):
            units = own
        elif _NAMES.fullmatch(key) and not any(labels):
            labels = ["" if cell == key else cell for cell in own]
        elif _says_units(key):
            units = ["" if cell == key else cell for cell in own]
    beside = [name for name in names if not _says_units(name)]
    if are_units(beside) or all(not name or time_of_day(name) is not None for name in names[1:]):
        names = [""] * columns  # what stands above the numbers are units, or when each channel began
    headers = [
        _with_unit(label if label and (not name or _NUMBERED.fullmatch(name)) else name, unit)
        for name, label, unit in zip(names, labels, units, strict=True)
    ]
    return Preamble(tuple(headers), _numbers(rows, decimal))


def are_units(cells: Sequence[str]) -> bool:
    """Whether the cells of a line are units, most of them known, and the others ratios such as "l/min"."""
    full = [cell for cell in cells if cell]
    known = sum(map(is_unit, full))
    return known == len(full) or (
        2 * known > len(full) and all(is_unit(cell) or _RATIO.fullmatch(cell) for cell in full)
    )


def is_row_of_units(cells: Sequence[str]) -> bool:
    """Whether the cells of a line are units, or such behind a first cell that says so: "Unit", "mm", "A"."""
    return are_units(cells) or (_says_units(cells[0]) and any(cells[1:]) and are_units(cells[1:]))


def is_unit(cell: str) -> bool:
    """Whether a cell between names and numbers is a unit, or says that there is none."""
    known = known_unit(cell)
    as_written = cell in UNITS or len(cell) >= _SHORTEST
    return _UNIT.fullmatch(cell) is not None or (known is not None and as_written)


def _says_units(cell: str) -> bool:
    return _UNITS.fullmatch(cell.rstrip(": ")) is not None


def _with_unit(name: str, unit: str) -> str:
    # "(ms)", "V (Voltage)" and "[mm]" hold the unit and more.
    unit = next(iter(re.split(r"[\s\[\]()]+", unit.strip("[]() "))), "")
    unit = _WORDS.get(unit.lower().removesuffix("s"), unit)
    return name if unit in _NO_UNIT else f"{name} [{unit}]".strip()


def _numbers(rows: Sequence[Sequence[str]], decimal: str) -> dict[str, float]:
    """The first number of each row by the row's first cell, or by the cell above it."""
    found: dict[str, float] = {}
    above: Sequence[str] = ()
    for cells in rows:
        for row in _stated(cells) or [list(cells)]:
            _note(row, decimal, found)
        values = [_number(cell, decimal) for cell in cells]
        for name, value in zip(above, values, strict=False):
            if value is not None and name and _number(name, decimal) is None:
                found.setdefault(name, value)
        above = cells
    return found


def _stated(cells: Sequence[str]) -> list[list[str]]:
    """Name and value of every "name = value" or "name: value" in a line; cells may be the words of a sentence."""
    if len(cells) != 1 and not any(cell.endswith(("=", ":")) for cell in cells):
        return []
    parts = re.split(r"[,;](?!\d)", " ".join(cells)[:_LONGEST])
    return [[said[1], said[2].strip()] for part in parts if (said := _SAID.match(part.strip()))]


def _note(row: Sequence[str], decimal: str, found: dict[str, float]) -> None:
    """Take down the first number of a row that begins with a name."""
    if not row or _measured(row[0], decimal) is not None:
        return
    stated = next(((i, one) for i, cell in enumerate(row) if (one := _measured(cell, decimal))), None)
    if stated:
        place, (value, unit) = stated
        behind = row[place + 1] if len(row) == place + 2 and is_unit(row[place + 1]) else ""
        found.setdefault(_with_unit(row[0].lstrip("#%/ "), unit or behind), value)


def _measured(cell: str, decimal: str) -> tuple[float, str] | None:
    """A number and the unit behind it, "" where there is none; None where the cell is something else."""
    parts = _MEASURED.fullmatch(cell[:_LONGEST].strip())
    value = _number(parts[1], decimal) if parts else None
    return None if parts is None or value is None else (value, parts[2] or "")


def _number(cell: str, decimal: str) -> float | None:
    try:
        return float(cell.replace(decimal, "."))
    except ValueError:
        return None
