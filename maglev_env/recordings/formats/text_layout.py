"""How a text file writes its table: separator, decimal sign, header and units, told from its lines or stated."""

import csv
import re
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

from maglev_env.fields import check_known
from maglev_env.recordings.formats.file_formats import Refused
from maglev_env.recordings.formats.stamps import duration
from maglev_env.recordings.formats.text_preamble import Preamble, are_units, is_row_of_units, read_preamble

SEPARATORS = {";": "semicolons", "\t": "tabs", ",": "commas", " ": "blanks"}
DECIMALS = (".", ",")
_SCALES = "line {} holds units; the scales of a campaign are those that its channels state"
STATE_IT = 'state it in campaign.toml, e.g. format = { separator = ";", decimal = ",", header = 1 }'
_SAYS = re.compile(r"[A-Za-z ]{1,24}:")  # what a comment begins with that says what it holds: "columns:"
_COMMENTS = ("#", "%", "//")
_NUMBER = re.compile(r"[+-]?((\d+(\.\d*)?|\.\d+)([ed][+-]?\d+)?|nan|inf|infinity)", re.IGNORECASE)
_ROWS = 4  # of numbers that follow each other, where the first holds a word, too
_GROUPED = re.compile(r"[+-]?[1-9]\d{0,2},\d{3}")
_THOUSANDS = re.compile(r"[+-]?\d{1,3}(\.\d{3})+,\d+|[+-]?\d{1,3}(,\d{3})+\.\d+")


@dataclass(frozen=True)
class TextLayout:
    """What campaign.toml states of a text file under `format`; None: told from the file.

    Attributes:
        separator: Between columns: ";", ",", a tab or a blank (any number of blanks).
        decimal: Decimal sign, "." or ",".
        header: Line of the column names, counted from 1 as editors count; 0: there is none, columns go by position.
    """

    separator: str | None = None
    decimal: str | None = None
    header: int | None = None


@dataclass(frozen=True)
class Layout:
    """The layout of one file.

    Attributes:
        separator: Between columns.
        decimal: Decimal sign.
        names: Of the columns that are read, "" where there is none.
        first: First line of numbers, from 0.
        width: Cells of a line of numbers, trailing empty ones included.
        notes: What was told from the file, in words.
        preamble: What else the lines above the numbers say.
    """

    separator: str
    decimal: str
    names: tuple[str, ...]
    first: int
    width: int
    notes: tuple[str, ...]
    preamble: Preamble


def layout_table(value: Any) -> TextLayout:
    """The checked `format` table of a recording.

    Raises:
        ValueError: It does not fit.
    """
    if not isinstance(value, Mapping):
        raise ValueError(f"format = {value!r} must be a table; {STATE_IT}")
    check_known(value, ("separator", "decimal", "header"), "format")
    separator, decimal, header = (value.get(key) for key in ("separator", "decimal", "header"))
    if separator is not None and separator not in SEPARATORS:
        raise ValueError(f'format: separator = {separator!r}; use ";", ",", "\\t" or " "')
    if decimal is not None and decimal not in DECIMALS:
        raise ValueError(f'format: decimal = {decimal!r}; use "." or ","')
    if header is not None and (type(header) is not int or header < 0):
        raise ValueError(f"format: header = {header!r} must be the line of the column names, from 1; 0: there is none")
    return TextLayout(separator, decimal, header)


def cells_of(line: str, separator: str) -> list[str]:
    """The cells of one line without blanks around them, and without their quotes."""
    if separator == " ":
        return line.split()
    if '"' in line:
        return [cell.strip() for cell in next(csv.reader([line], delimiter=separator, skipinitialspace=True))]
    return [cell.strip() for cell in line.split(separator)]


def is_number(cell: str, decimal: str) -> bool:
    """Whether a cell is a number; a decimal comma needs digits behind it, and allows no point beside it."""
    if decimal == ",":
        if "." in cell or cell.endswith(","):
            return False
        cell = cell.replace(",", ".", 1)
    return _NUMBER.fullmatch(cell) is not None


def is_left_out(line: str) -> bool:
    """Whether a line is blank or a comment."""
    return not line.strip() or line.lstrip().startswith(_COMMENTS)


def find_layout(head: Sequence[str], tail: Sequence[str], stated: TextLayout) -> Layout:
    """Tell the layout of a text file, as far as it is not stated.

    Args:
        head: Its first lines; the numbers must begin in them.
        tail: Its last lines, from which separator and decimal sign are told.
        stated: What is known already.

    Raises:
        Refused: Two readings of the lines are possible, or none is; the message says what to state.
    """
    rows = [line for line in tail if not is_left_out(line) and re.search(r"\d", line)]
    # A short file's header stands among the last lines, and its names may hold digits.
    rows = [row for row in rows if re.search(r"(^|[\s;,\"])[+-]?[.\d]", row)] or rows
    separator, decimal, signs = _signs(rows, head, stated)
    split = [cells_of(row, separator) for row in rows]
    count = [sum(is_number(cell, decimal) for cell in cells) for cells in split]
    numeric = [cells for cells, n in zip(split, count, strict=True) if 2 * n >= len(cells)]
    # Where most columns are empty, as those of a preamble beside the first numbers, the full cells count.
    numeric = numeric or [cells for cells, n in zip(split, count, strict=True) if 2 * n >= sum(map(bool, cells)) > 0]
    if not numeric:
        return _names_alone(head, separator, decimal, stated)
    lengths = Counter(map(len, numeric))
    width = max(lengths, key=lambda n: (lengths[n], n))
    full = [cells for cells in numeric if len(cells) == width]
    empty = next((i for i in range(width) if any(cells[-1 - i] for cells in full)), width)
    expected = [2 * sum(is_number(cells[j], decimal) for cells in full) >= len(full) for j in range(width - empty)]
    first = _first_row(head, separator, decimal, expected, stated.header or 0)
    names, last, notes = _names(head[:first], separator, decimal, width, width - empty, stated)
    names = names[: max(last, width - empty)]
    preamble = read_preamble([_above(line, separator) for line in head[:first]], names, decimal)
    return Layout(separator, decimal, names, first, width, (*signs, *notes), preamble)


def _signs(rows: list[str], head: Sequence[str], stated: TextLayout) -> tuple[str, str, list[str]]:
    """The separator and decimal sign under which the most cells are numbers, and a note on what was told."""
    readings: dict[tuple[str, str], float] = {}
    for separator in [stated.separator] if stated.separator else SEPARATORS:
        if separator not in (" ", stated.separator) and 2 * sum(separator in row for row in rows) < len(rows):
            continue
        cells = [cell for row in rows for cell in cells_of(row, separator) if cell]
        if separator != " " and (grouped := next(filter(_THOUSANDS.fullmatch, cells), None)):
            raise Refused(f"{grouped!r} holds a thousands separator, which is not read: write the numbers without it")
        for decimal in [stated.decimal] if stated.decimal else DECIMALS:
            # A file of whole numbers has no decimal sign; it is read with a point.
            possible = decimal == "." or stated.decimal or any("," in cell for cell in cells)
            apart = separator != decimal or any('"' in row for row in rows)  # between commas a decimal comma is quoted
            if possible and cells and apart:
                told = (is_number(cell, decimal) or duration(cell) is not None for cell in cells)
                readings[separator, decimal] = sum(told) / len(cells)
    if not readings or not max(readings.values()):
        line = next((line for line in head if not is_left_out(line)), "")
        found = next((s for s in SEPARATORS if s != " " and s in line), ",")
        return stated.separator or found, stated.decimal or ".", []
    best = [reading for reading, share in readings.items() if share == max(readings.values())]
    if any(separator == "\t" for separator, _ in best):  # tabs are blanks, too
        best = [reading for reading in best if reading[0] != " "]
    if len(best) > 1 and (",", ".") in best and _comma_names(rows, head):
        best = [(",", ".")]
    if len(best) > 1:
        raise Refused(
            f"{rows[-1].strip()[:40]!r} in the last lines can be a comma between columns or a decimal comma; {STATE_IT}"
        )
    separator, decimal = best[0]
    commas = [cell for row in rows for cell in cells_of(row, separator) if "," in cell]
    if commas and not stated.decimal and all(map(_GROUPED.fullmatch, commas)):
        raise Refused(
            f"{commas[-1]!r} in the last lines can hold a decimal comma or a thousands separator; the latter is not "
            f"read: write numbers without it, or {STATE_IT}"
        )
    if (separator, decimal) == (",", ".") or (stated.separator and stated.decimal):
        return separator, decimal, []
    sign = "a decimal comma" if decimal == "," else "a decimal point"
    return separator, decimal, [f"the file is read with {SEPARATORS[separator]} between columns and {sign}"]


def _comma_names(rows: list[str], head: Sequence[str]) -> bool:
    """Whether the line above the numbers holds as many names, with commas between them, as the numbers would."""
    lines = [line for line in head if not is_left_out(line)]

    def numeric(line: str) -> bool:
        return all(is_number(cell, ".") for cell in cells_of(line, ","))

    names = cells_of(next((above for above, line in pairwise(lines) if numeric(line)), ""), ",")
    width = max(len(cells_of(row, ",")) for row in rows)
    return len(names) == width and not any(is_number(name, ".") for name in names)


def _first_row(head: Sequence[str], separator: str, decimal: str, expected: list[bool], least: int) -> int:
    """The first line, from `least` on, with a number in every column where the last lines have one."""

    def numeric(line: str) -> list[str]:
        cells = [] if is_left_out(line) else cells_of(line, separator)
        fits = len(cells) >= len(expected) and all(
            is_number(c, decimal) for c, e in zip(cells, expected, strict=False) if e
        )
        return cells if fits else []

    for i, line in enumerate(head[least:], least):
        cells = numeric(line)
        # A line of the preamble may hold as many numbers behind its word: numbers follow the first row of a table.
        words = any(c for c, e in zip(cells, expected, strict=False) if not e)
        if cells and (not words or all(is_left_out(n) or numeric(n) for n in head[i + 1 : i + _ROWS])):
            return i
    raise Refused(f"no line of numbers in columns follows in the first {len(head)} lines; {STATE_IT}")


def _above(line: str, separator: str) -> list[str]:
    """The cells of a line above the numbers; units in a comment without its sign."""
    texts = (_uncommented(line), _held(_uncommented(line))) if is_left_out(line) else ()
    units = (cells for text in texts if any(cells := cells_of(text, separator)) and are_units(cells))
    return next(units, cells_of(line, separator))


def _held(comment: str) -> str:
    """What stands behind the word with which a comment says what it holds; all of it where it has more colons."""
    said = _SAYS.match(comment)
    return comment[said.end() :].strip() if said and comment.count(":") == 1 else comment


def _uncommented(line: str) -> str:
    return line.strip().lstrip("#%/ ")


def _names(
    above: Sequence[str], separator: str, decimal: str, width: int, least: int, stated: TextLayout
) -> tuple[tuple[str, ...], int, list[str]]:
    """Names (width,), "" for none, from the lines above the numbers; how many are names; what was told."""

    def named(line: str, comment: bool = False) -> list[str] | None:
        text = _uncommented(line) if comment else line
        cells = cells_of(text, separator)
        if comment and len(held := cells_of(_held(text), separator)) == least:
            cells = held
        if separator == " " and len(cells) != least and len(apart := re.split(r"\s{2,}", text.strip())) == least:
            cells = apart  # names of several words, in columns as wide as their numbers
        if comment and len(cells) != least:
            cells = cells_of(text.rpartition(":")[2], " ") if least > 1 else []
        if len(cells) == least + 1 and cells[-1].lower() == "comment":  # LabVIEW's last column, empty in every row
            cells = cells[:-1]
        while len(cells) > width and not cells[-1]:  # a separator at the end of the line of names alone
            cells = cells[:-1]
        # Behind the columns an oscilloscope may state where they begin and their steps.
        fits = least <= len(cells) <= width and not any(is_number(c, decimal) for c in cells[:least]) and any(cells)
        return cells if fits else None

    def done(cells: list[str], *notes: str) -> tuple[tuple[str, ...], int, list[str]]:
        last = max((i + 1 for i, c in enumerate(cells) if c), default=0)
        return (*cells, *[""] * (width - len(cells))), last, list(notes)

    if stated.header == 0:
        return done([])
    if stated.header:
        cells = named(above[stated.header - 1], is_left_out(above[stated.header - 1]))
        if cells is None:
            raise Refused(f"line {stated.header} does not hold the names of {least} columns; {STATE_IT}")
        return done(cells)
    lines = [i for i, line in enumerate(above) if not is_left_out(line)]
    if lines:
        names, units = named(above[lines[-1]]), []
        if names and len(lines) > 1 and is_row_of_units(names[:least]) and (upper := named(above[lines[-2]])):
            beside = any(is_number(cell, decimal) for cell in names[least:])  # numbers, not names of empty columns
            names = upper[:least] if beside else upper
            units = [_SCALES.format(lines[-1] + 1)]
            lines.pop()
        if names:
            where = [f"the columns are named by line {lines[-1] + 1}"] if lines[-1] else []
            return done(names, *where, *units)
        cells = cells_of(above[lines[-1]], separator)
        if separator != " " and len(cells) > 1 and lines[-1] == len(above) - 1:
            raise Refused(
                f"line {lines[-1] + 1} has {len(cells)} names, the numbers below it {least} columns; mend it, or "
                "state the line of the names, format = { header = 1 }, or that there is none, header = 0"
            )
    comments = [i for i, line in enumerate(above) if line.strip() and is_left_out(line)]
    fitting = [(i, cells) for i in reversed(comments) if (cells := named(above[i], comment=True))]
    if len(fitting) > 1 and is_row_of_units(fitting[0][1][:least]) and not is_row_of_units(fitting[1][1][:least]):
        (of_units, _), (i, cells) = fitting[:2]
        return done(cells, f"the columns are named by the comment in line {i + 1}", _SCALES.format(of_units + 1))
    for i, cells in fitting[:1]:
        return done(cells, f"the columns are named by the comment in line {i + 1}")
    return done([], f'the columns have no names: they go by position, "[0]" to "[{least - 1}]"')


def _names_alone(head: Sequence[str], separator: str, decimal: str, stated: TextLayout) -> Layout:
    """A file without numbers: its header only."""
    at = next((i for i, line in enumerate(head) if not is_left_out(line)), None)
    if at is None:
        raise Refused("the file holds no line of numbers: it is empty")
    at = stated.header - 1 if stated.header else at
    names = cells_of(head[at], separator)
    return Layout(separator, decimal, tuple(names), at + 1, len(names), (), Preamble(tuple(names), {}))
