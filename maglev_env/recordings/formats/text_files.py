"""Columns of text files as programs write them: .csv, .tsv, .txt, .dat and LabVIEW's .lvm."""

import codecs
import re
from collections import deque
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from functools import partial
from itertools import islice
from pathlib import Path
from typing import Any, TextIO

import numpy as np

from maglev_env.recordings.formats.file_formats import Reader, Refused, Steps, follow
from maglev_env.recordings.formats.labelled import labels_of, without_labels
from maglev_env.recordings.formats.labview import numbered_lines
from maglev_env.recordings.formats.matrix_text import is_matrix, without_brackets
from maglev_env.recordings.formats.stamps import duration, time_of_day, with_milliseconds
from maglev_env.recordings.formats.text_layout import (
    STATE_IT,
    Layout,
    TextLayout,
    cells_of,
    find_layout,
    is_left_out,
    is_number,
)
from maglev_env.recordings.formats.unread_cells import UnreadCells

MAX_PREAMBLE = 1000  # lines above the numbers
_TAIL = 200
DAY = 86400.0  # s
_SHOWN = 40  # characters of a line
_BLOCK = 65536
_FORTRAN = re.compile(r"(?<=[\d.])[dD](?=[+-]?\d)")  # the exponent of a double in Fortran's files
Rewritten = Callable[[Iterator[tuple[int, str]]], Iterator[tuple[int, str]]]  # numbered lines as those of a table
_GROUPS = re.compile(r"[+-]?[1-9]\d{0,2}([.,])\d{3}(\1\d{3})+")  # no decimal sign stands twice in a number
_MINUS = re.compile("\u2212(?=[\\d.])")  # what typography and some locales write before a negative number
_BOMS = {codecs.BOM_UTF8: "utf-8-sig", codecs.BOM_UTF16_LE: "utf-16", codecs.BOM_UTF16_BE: "utf-16"}


@dataclass(frozen=True)
class TextFile:
    """An open text file.

    Attributes:
        names: Of its columns.
        read: Their values.
        positions: Their names by position.
        notes: What was told from the file, in words.
        headers: By name what the file calls a column, with its unit in brackets, where it says more than the name.
        numbers: Numbers above the table by what the file calls them.
    """

    names: tuple[str, ...]
    read: Reader
    positions: tuple[str, ...]
    notes: tuple[str, ...]
    headers: Mapping[str, str]
    numbers: Mapping[str, float]


def open_text(path: Path, stated: TextLayout) -> TextFile:
    """Open a text file.

    A column is asked for by its name in the header, or by its position, "[j]" from 0. A column without a name, or whose
    name another one has too, goes by its position alone.

    Raises:
        Refused: The lines are no table of numbers, or can be read in two ways.
    """
    encoding, notes = _encoding(path)
    head, tail = _ends(path, encoding)
    rewritten: Rewritten | None = None
    if labels := labels_of(tail):
        rewritten = partial(without_labels, labels=labels)
        notes.append("every number of a line has its name beside it: the names are taken as those of columns")
    elif is_matrix(tail):
        rewritten = without_brackets
        notes.append("the numbers are a matrix of MATLAB: its brackets and the ends of its rows are left out")
    if rewritten is not None:
        head, tail = _ends(path, encoding, rewritten)
    layout = find_layout([line.rstrip("\n") for line in head], [line.rstrip("\n") for line in tail], stated)
    positions = {f"[{j}]": j for j in range(len(layout.names))}
    once = {name: j for j, name in enumerate(layout.names) if name and layout.names.count(name) == 1}
    names = tuple(n if n in once else f"[{j}]" for j, n in enumerate(layout.names))
    with path.open(encoding=encoding) as file:
        table, problems, end = _table(_lines(file, rewritten), layout)

    def read(root: str, steps: Steps) -> Any:
        j = once[root] if root in once else positions[root]
        if j in problems:
            raise Refused(problems[j])
        return follow(table[:, j].copy(), steps)

    twice = {name for name in layout.names if layout.names.count(name) > 1} - {""}
    notes += [f"several columns are called {name!r}: they go by position" for name in sorted(twice)]
    headers = {name: header for name, header in zip(names, layout.preamble.headers, strict=False) if header}
    return TextFile(names, read, tuple(positions), (*notes, *layout.notes, *end), headers, layout.preamble.numbers)


def _lines(file: TextIO, rewritten: Rewritten | None) -> Iterator[tuple[int, str]]:
    lines = ((number, _MINUS.sub("-", line) if "\u2212" in line else line) for number, line in numbered_lines(file))
    return lines if rewritten is None else rewritten(lines)


def _ends(path: Path, encoding: str, rewritten: Rewritten | None = None) -> tuple[list[str], list[str]]:
    """The first and the last lines of a file."""
    with path.open(encoding=encoding) as file:
        lines = _lines(file, rewritten)
        head = [line for _, line in islice(lines, MAX_PREAMBLE)]
        return head, [line for _, line in deque(lines, _TAIL)] or head[-_TAIL:]


def _encoding(path: Path) -> tuple[str, list[str]]:
    """The encoding of a file: by its byte order mark, UTF-8 where its bytes fit, else Latin-1."""
    decoder = codecs.getincrementaldecoder("utf-8")()
    with path.open("rb") as file:
        start = file.read(4)
        for mark, name in _BOMS.items():
            if start.startswith(mark):
                return name, ["the file is UTF-16"] if name == "utf-16" else []
        file.seek(0)
        latin = False
        while block := file.read(1 << 20):
            if b"\0" in block:
                raise Refused("it holds zero bytes: no text, or UTF-16 without a byte order mark; save it as UTF-8")
            try:
                latin or decoder.decode(block)
            except UnicodeDecodeError:
                latin = True
    return ("latin-1", ["the file is not UTF-8: read as Latin-1"]) if latin else ("utf-8", [])


def _table(lines: Iterator[tuple[int, str]], layout: Layout) -> tuple[np.ndarray, dict[int, str], list[str]]:
    """The numbers (samples, columns), for each column that does not hold numbers alone, where, and notes.

    The last line may be the beginning of one, where a program was stopped while it wrote.
    """
    columns = len(layout.names)
    parts: list[np.ndarray] = [np.empty((0, columns))]
    unread = UnreadCells()
    clocks: set[int] = set()
    blank: list[str] = []
    notes: list[str] = []
    for _ in range(layout.first):
        next(lines)
    sample = 0
    while block := list(islice(lines, _BLOCK)):
        rows = []
        for number, line in block:
            if is_left_out(line):
                blank.append(f"line {number} (before sample {sample + len(rows)})")
            else:  # blank lines at the end are left out without a word
                unread.blank, blank = unread.blank + blank, []
                rows.append((number, line))
        if len(block) < _BLOCK and len(rows) > 1 and (cut := _cut_off(rows[-1][1], layout)):
            notes.append(f"the last line is cut off ({cut}): it is left out")
            rows.pop()
        parts.append(_numbers(rows, layout, sample, unread, clocks))
        sample += len(rows)
    table = np.concatenate(parts)
    problems, missing = unread.judged(table, layout.names)
    notes += missing
    for j in sorted(clocks - problems.keys()):
        table[:, j] = with_milliseconds(past_midnight(table[:, j]), table[:, j + 1 : j + 2])
        notes.append(f"column {layout.names[j] or f'[{j}]'!r} holds times of day: it is read in seconds since midnight")
    return table, problems, notes


def _cut_off(line: str, layout: Layout) -> str:
    """What a last line holds that has no end and fewer cells than the others; "" where it is whole."""
    few = len(cells_of(line, layout.separator)) < len(layout.names)
    return repr(line.strip()[:_SHOWN]) if few and not line.endswith("\n") else ""


def _numbers(
    rows: list[tuple[int, str]], layout: Layout, sample: int, unread: UnreadCells, clocks: set[int]
) -> np.ndarray:
    separator, columns = layout.separator, len(layout.names)
    if not rows:
        return np.empty((0, columns))
    if layout.decimal == ",":  # the quick way below takes a point for a decimal sign, too
        _note_points(rows, layout, sample, unread)
    if columns == layout.width and separator != layout.decimal:
        try:
            text = (line.replace(",", ".") if layout.decimal == "," else line for _, line in rows)
            if _FORTRAN.search(rows[0][1]):
                text = (_FORTRAN.sub("e", line) for line in text)
            values = np.loadtxt(
                text, delimiter=None if separator == " " else separator, comments=None, quotechar='"', ndmin=2
            )
            if values.shape == (len(rows), columns):
                return values
        except ValueError:
            pass  # read cell by cell, so that the message can name the line and the column
    values = np.full((len(rows), columns), np.nan)
    for i, (number, line) in enumerate(rows):
        cells = cells_of(line, separator)
        if not columns <= len(cells) <= layout.width or any(cells[columns:]):
            unread.lines.append(
                f"line {number} (sample {sample + i}) has {len(cells)} values, the other lines {columns} columns; "
                f"thousands separators are not read; if the columns are told wrongly, {STATE_IT}"
            )
            continue
        for j, cell in enumerate(cells[:columns]):
            if is_number(cell, layout.decimal) or is_number(cell, "."):
                values[i, j] = _number(cell.replace(",", "."))
            elif (seconds := time_of_day(cell)) is not None:
                values[i, j] = seconds
                clocks.add(j)
            elif (seconds := duration(cell)) is not None:
                values[i, j] = seconds
            elif (grouped := _GROUPS.fullmatch(cell)) and grouped[1] == layout.decimal:
                # In other cells, 4,620 above 973, it would be taken for a decimal sign: one number a thousandth of it.
                raise Refused(
                    f"{cell!r} in line {number} (sample {sample + i}) holds thousands separators, which are not read: "
                    "write all numbers without them"
                )
            else:
                unread.cell(j, cell, number, sample + i)
    return values


def _note_points(rows: list[tuple[int, str]], layout: Layout, sample: int, unread: UnreadCells) -> None:
    """Take down which columns of a file with decimal commas hold points, as a decimal sign or between thousands."""
    for i, (number, line) in enumerate(rows):
        if "." in line:
            for j, cell in enumerate(cells_of(line, layout.separator)[: len(layout.names)]):
                if "." in cell and is_number(cell.replace(".", ""), "."):
                    unread.point(j, cell, number, sample + i)


def _number(text: str) -> float:
    """A number with a decimal point."""
    try:
        return float(text)
    except ValueError:
        return float(_FORTRAN.sub("e", text))


def past_midnight(times: np.ndarray) -> np.ndarray:
    """Times of day in s, (samples,), that go on rising where a day ends."""
    return times + DAY * np.cumsum(np.diff(times, prepend=times[:1]) < -DAY / 2)
