"""Cells and lines of a text file that hold no number, where few do: a broken serial line, an empty cell, "n/a"."""

import re
from dataclasses import dataclass, field

import numpy as np

from maglev_env.recordings.formats.file_formats import Refused

MOST_BROKEN = 0.01  # of the lines, that may be broken; more, and the columns are told wrongly
_SAID_MISSING = frozenset(
    ["na", "n/a", "#n/a", "#nv", "null", "none", "-", "--", "---", "?", "1.#qnan", "-1.#ind", "1.#inf", "-1.#inf"]
) | {""}
_GROUPED = re.compile(r"[+-]?[1-9]\d{0,2}(\.\d{3})+")  # where other numbers have a decimal comma
_MOST_WORDS = 17  # one more than the channels of a file of which several lines make one sample
_LEAST_READ = 0.5  # of a column's cells that must be numbers where the others say that a value is missing


@dataclass
class UnreadCells:
    """What was no number while a file was read; its places hold nan.

    Attributes:
        lines: What is wrong with every broken line.
        blank: Numbers of the blank and comment lines among the numbers.
        words: By column how many cells hold something else, and the first of them.
        missing: By column how many cells say that the value is missing, and the first of them.
        distinct: By column the different words, the first _MOST_WORDS.
        grouped: By column the first cell whose points may stand between thousands, where a decimal sign is a comma.
        pointed: Columns whose points are decimal signs all the same.
    """

    lines: list[str] = field(default_factory=list)
    blank: list[str] = field(default_factory=list)
    words: dict[int, tuple[int, str]] = field(default_factory=dict)
    missing: dict[int, tuple[int, str]] = field(default_factory=dict)
    distinct: dict[int, dict[str, None]] = field(default_factory=dict)
    grouped: dict[int, str] = field(default_factory=dict)
    pointed: set[int] = field(default_factory=set)

    def point(self, column: int, cell: str, line: int, sample: int) -> None:
        """Take down a number with points in a file of decimal commas."""
        if _GROUPED.fullmatch(cell):
            self.grouped.setdefault(column, f"{cell!r} in line {line} (sample {sample})")
        else:
            self.pointed.add(column)

    def cell(self, column: int, cell: str, line: int, sample: int) -> None:
        """Take down a cell that is no number."""
        kind = self.missing if cell.lower() in _SAID_MISSING else self.words
        count, first = kind.get(column, (0, f"{cell!r} in line {line} (sample {sample}) is not a number"))
        kind[column] = count + 1, first
        words = self.distinct.setdefault(column, {})
        if kind is self.words and len(words) < _MOST_WORDS:
            words[cell] = None

    def judged(self, table: np.ndarray, names: tuple[str, ...]) -> tuple[dict[int, str], list[str]]:
        """What is to be said of a table (samples, columns).

        Returns:
            For each column that is not read, why; and notes.

        Raises:
            Refused: Too many lines are broken, blank lines leave open when the samples behind them were taken, or
                several lines make one sample.
        """
        samples = len(table)
        if len(self.lines) > MOST_BROKEN * samples:
            raise Refused(self.lines[0])
        notes = []
        if self.lines:
            notes.append(
                f"{len(self.lines)} broken line(s) are taken as missing samples: {self.lines[0].partition(';')[0]}"
            )
        if self.blank:
            if len(self.blank) > MOST_BROKEN * samples or not _has_clock(table):
                raise Refused(
                    f"{self.blank[0]} is blank or a comment among numbers, and no column of time says when the next "
                    "sample was taken; take the line out, or put what follows it in a file of its own"
                )
            notes.append(f"{len(self.blank)} blank or comment line(s) among the numbers are skipped: {self.blank[0]}")
        for column, (count, _) in self.words.items():
            words = list(self.distinct[column])
            if count == samples and 1 < len(words) < _MOST_WORDS and _times_over(table, len(words)):
                raise Refused(
                    f"column {names[column] or f'[{column}]'!r} says what each line holds ({', '.join(words)}): "
                    f"{len(words)} lines make one sample; write a column for each (pandas: pivot)"
                )
        problems = {
            column: f"{first} holds a thousands separator, which is not read: write the numbers without it"
            for column, first in self.grouped.items()
            if column not in self.pointed
        }
        for kind, most in ((self.words, MOST_BROKEN), (self.missing, 1 - _LEAST_READ)):
            for column, (count, first) in sorted(kind.items()):
                if count > most * samples:
                    problems.setdefault(column, first)
                else:
                    name = names[column] or f"[{column}]"
                    notes.append(f"column {name!r}: {count} value(s) are missing: {first}")
        return problems, notes


def _times_over(table: np.ndarray, times: int) -> bool:
    """Whether a column that is not constant has every value so many times: in a row, or in stretches that repeat."""
    if len(table) % times:
        return False
    several = [(column.reshape(-1, times).T, column.reshape(times, -1)) for column in table.T]
    return any(np.ptp(one[0]) > 0 and all((one == one[0]).all(axis=0)) for both in several for one in both)


def _has_clock(table: np.ndarray) -> bool:
    """Whether a column rises from each line to the next, where it is a number, as a time does."""
    for values in table.T:
        steps = np.diff(values[np.isfinite(values)])
        if steps.size >= (1 - MOST_BROKEN) * (len(table) - 1) > 0 and (steps > 0).all():
            return True
    return False
