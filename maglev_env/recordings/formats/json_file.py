"""JSON: an object of columns, or a list with an object for each sample; values below an object go by "outer.inner"."""

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from maglev_env.recordings.formats.file_formats import Reader, Refused, bounded, follow
from maglev_env.recordings.formats.json_lines import MOST_NAMES, open_json_lines, open_objects

_EACH = 16  # bytes of memory for each one of a text: a list of numbers takes that much more
_DEEPEST = 8


def open_json(path: Path) -> tuple[tuple[str, ...], Reader, tuple[str, ...]]:
    """Names of the values, their reader, and what was told from the file; a file of JSON lines is one, too.

    Raises:
        Refused: It holds no object and no list of them.
    """
    bounded(_EACH * path.stat().st_size, "unpacked")
    try:
        whole = json.loads(path.read_text(encoding="utf-8-sig", errors="replace"))
    except json.JSONDecodeError as error:
        if error.msg == "Extra data":
            return open_json_lines(path)
        raise
    if _objects(whole):
        return open_objects(list(enumerate(whole, 1)))
    if not isinstance(whole, dict):
        raise Refused("it holds neither an object of columns nor a list of objects with one for each sample")
    found = dict(_leaves(whole, "", 0))
    return tuple(found), lambda root, steps: follow(found[root], steps), ()


def _leaves(value: dict[str, Any], above: str, depth: int) -> Iterator[tuple[str, Any]]:
    """Arrays, texts and lists of other things by their names."""
    for key, inner in value.items():
        own = _columns(inner) if isinstance(inner, dict) else inner
        if _objects(own):
            names = list(dict.fromkeys(k for row in own for k in row))[:MOST_NAMES]
            own = {name: [row.get(name) for row in own] for name in names}
        if isinstance(own, dict) and depth < _DEEPEST:
            yield from _leaves(own, f"{above}{key}.", depth + 1)
        else:
            yield f"{above}{key}", _array(own)


def _columns(value: dict[str, Any]) -> Any:
    """What pandas writes as an object of its index, {"0": 1.5, "1": 1.7, ...}, as a list; all else as it is."""
    return list(value.values()) if len(value) > 1 and all(map(str.isdecimal, value)) else value


def _objects(value: Any) -> bool:
    return isinstance(value, list) and len(value) > 1 and all(isinstance(row, dict) for row in value)


def _array(value: Any) -> Any:
    """Numbers and lists of them as arrays, with nan for null; texts and all else as they are."""
    if isinstance(value, str | dict):
        return value
    try:
        return np.array(value, dtype=float)
    except (TypeError, ValueError):
        texts = isinstance(value, list) and all(isinstance(v, str) for v in value)
        return np.array(value) if texts else value if isinstance(value, list) else ""
