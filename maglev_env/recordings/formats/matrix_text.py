"""Numbers as a matrix of MATLAB or Octave: between brackets, and a semicolon ends each row."""

import re
from collections.abc import Iterator, Sequence

_ROW = re.compile(r"[^;]*\d\s*(;|\]\s*;?)\s*")  # a semicolon between columns would not be the only one
_SIGNS = re.compile(r"^\s*(\w+\s*=\s*)?\[|(;|\]\s*;?)\s*$")
_END = re.compile(r"\s*\]\s*;?\s*")
_MOST = 0.9  # share of the last lines that are rows of a matrix


def is_matrix(lines: Sequence[str]) -> bool:
    """Whether most of these lines, the last ones of a file, are rows of a matrix, but for what stands above them."""
    rows = [_ROW.fullmatch(line) is not None for line in lines if line.strip() and not _END.fullmatch(line)]
    return True in rows and (found := rows[rows.index(True) :]).count(True) > max(1.0, _MOST * len(found))


def without_brackets(lines: Iterator[tuple[int, str]]) -> Iterator[tuple[int, str]]:
    """Numbered lines without what belongs to the matrix and not to its numbers; `]` alone becomes a blank line."""
    for number, line in lines:
        yield number, _SIGNS.sub("", line.rstrip("\n")) + ("\n" if line.endswith("\n") else "")
