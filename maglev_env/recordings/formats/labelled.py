"""Lines whose every number has its name beside it, as serial monitors show them: "gap:8.001, ref:8.000, cur:1.105"."""

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

_CELL = re.compile(r"\s*([A-Za-z_][^:=,;\t]*?)\s*[:=]\s*([+-]?\.?\d[^\s:=]*)\s*")
_STAMP = re.compile(r"\s*(\d{1,2}:[0-5]\d:[0-5]\d(?:[.,]\d+)?)\s*->\s*(.*)", re.DOTALL)  # "14:55:33.123 -> gap:8.001"
_TIME = "time"  # what the stamp of a serial monitor is called
_SEPARATORS = "\t", ";", ",", " "
_LONGEST = 200  # characters of a cell; the search takes the square of them
_MOST = 0.5  # share of the last lines that are of this form, beside what else a program printed


@dataclass(frozen=True)
class Labels:
    """The names that stand beside the numbers of each line, in order, and what separates these pairs."""

    names: tuple[str, ...]
    separator: str


def labels_of(lines: Sequence[str]) -> Labels | None:
    """The labels that most of these lines have; None where they have none."""
    for separator in _SEPARATORS:
        found = [names for line in lines if (names := tuple(name for name, _ in _pairs(line, separator)))]
        if found and len(names := max(found, key=found.count)) > 1 and found.count(names) > _MOST * len(lines):
            return Labels(names, separator)
    return None


def without_labels(lines: Iterator[tuple[int, str]], labels: Labels) -> Iterator[tuple[int, str]]:
    """Numbered lines as those of a table: the names once, above the first of them, and then the numbers alone."""
    named = False
    for number, line in lines:
        pairs = _pairs(line, labels.separator)
        if tuple(name for name, _ in pairs) != labels.names:
            yield number, line
            continue
        if not named:
            yield number, labels.separator.join(labels.names) + "\n"
            named = True
        yield number, labels.separator.join(value for _, value in pairs) + ("\n" if line.endswith("\n") else "")


def _pairs(line: str, separator: str) -> list[tuple[str, str]]:
    """Name and number of every cell, behind the time of day before them; empty where one is of another form."""
    if stamp := _STAMP.fullmatch(line):
        rest = _pairs(stamp[2], separator)
        return [(_TIME, stamp[1]), *rest] if rest else []
    cells = line.strip().rstrip(separator).split(separator)
    if any(len(cell) > _LONGEST for cell in cells):
        return []
    found = [_CELL.fullmatch(cell) for cell in cells]
    return [(cell[1], cell[2]) for cell in found if cell] if all(found) else []
