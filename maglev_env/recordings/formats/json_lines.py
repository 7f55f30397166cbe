"""JSON lines: one object a line, as scripts log them; values below an object go by "outer.inner"."""

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from maglev_env.recordings.formats.file_formats import MAX_SAMPLES, Reader, Refused, Steps, follow
from maglev_env.recordings.formats.stamps import time_of_day
from maglev_env.recordings.formats.text_files import past_midnight
from maglev_env.recordings.formats.unread_cells import UnreadCells

MOST_NAMES, _LONGEST = 200, 65536  # columns, and characters of a line


def open_json_lines(path: Path) -> tuple[tuple[str, ...], Reader, tuple[str, ...]]:
    """Names of the values, their reader, and what was told from the file; every line is a sample, see `open_objects`.

    Raises:
        Refused: No line is an object with a number in it, or too many are none.
    """
    found: list[tuple[int, Any]] = []
    with path.open(encoding="utf-8", errors="replace") as file:
        for number, line in enumerate(file, 1):
            if not line.strip():
                continue
            if len(found) == MAX_SAMPLES:
                raise Refused(f"it has more than {MAX_SAMPLES} lines; split the recording")
            try:
                value = json.loads(line[:_LONGEST])
            except (ValueError, RecursionError):
                value = None
            found.append((number, value))
    return open_objects(found)


def open_objects(samples: list[tuple[int, Any]]) -> tuple[tuple[str, ...], Reader, tuple[str, ...]]:
    """Names of the values, their reader, and what was told, of numbered objects with one for each sample.

    A value that one lacks, and every value of what is no object, is nan. Texts that are a time of day, also behind a
    date, are read in seconds.

    Raises:
        Refused: As `open_json_lines`.
    """
    unread = UnreadCells()
    rows: list[dict[str, Any]] = []
    for number, value in samples:
        if not isinstance(value, dict):
            unread.lines.append(f"line {number} (sample {len(rows)}) holds no object of JSON")
        rows.append(dict(_flat(value)) if isinstance(value, dict) else {})
    names = list(dict.fromkeys(name for row in rows for name in row))[:MOST_NAMES]
    if not names:
        raise Refused("none of its lines is an object of JSON with values in it")
    clocks: set[int] = set()
    table = np.full((len(rows), len(names)), np.nan)
    for i, row in enumerate(rows):
        for j, name in enumerate(names):
            table[i, j] = _number(row.get(name), i, j, unread, clocks)
    for j in clocks:
        table[:, j] = past_midnight(table[:, j])
    problems, notes = unread.judged(table, tuple(names))

    def read(root: str, steps: Steps) -> Any:
        j = names.index(root)
        if j in problems:
            raise Refused(problems[j])
        return follow(table[:, j].copy(), steps)

    return tuple(names), read, tuple(notes)


def _flat(value: dict[str, Any], above: str = "") -> Iterator[tuple[str, Any]]:
    for key, inner in value.items():
        if isinstance(inner, dict) and above.count(".") < 4:
            yield from _flat(inner, f"{above}{key}.")
        else:
            yield f"{above}{key}", inner


def _number(value: Any, sample: int, column: int, unread: UnreadCells, clocks: set[int]) -> float:
    if isinstance(value, (int, float)):  # also true and false
        return float(value)
    if isinstance(value, str) and (seconds := time_of_day(value)) is not None:
        clocks.add(column)
        return seconds
    unread.cell(column, "" if value is None else str(value)[:40], sample + 1, sample)
    return np.nan
