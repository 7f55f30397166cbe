"""All that a data file holds: every column, number and text below its top-level names."""

import re
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from maglev_env.recordings.files import Columns
from maglev_env.recordings.formats.file_formats import Refused, bounded, columns_of, fields_of
from maglev_env.recordings.formats.time_stamps import unwrapped
from maglev_env.recordings.masking import bridged
from maglev_env.recordings.missing_readings import garbled_stamps

_FIELD = re.compile(r"[A-Za-z_]\w*")  # what a column expression can name
_MOST_PARTS, _MOST_COLUMNS = 200, 64  # of one struct or cell array, of one matrix
_DEEPEST = 8
_MOST_READ = 10_000  # parts of a file, each by each of its paths
_LEAST = 8  # samples of a column
_COMPONENT = re.compile(r"\.?[A-Za-z_]\w*|\[\d+\]")  # of an expression: a name with its dot, or an index
_OF_ONE_RUN = (
    "axis axes achse eje axe asse bearing lager ch channel channels kanal signal signals probe sensor coil x y z"
)
_DEEPEST_RUN = 3  # components of an expression that may say which run it is of
_MOST_MISSING = 0.2  # share of a column's values that may be no numbers where its meaning is guessed from the others
_MOST_GARBLED = 0.02  # share of the steps of a time that may not rise


@dataclass(frozen=True)
class Contents:
    """What is in a file.

    Args:
        columns: expression, as `Columns.column` takes it, -> values (samples,) in the file's own unit; all equally
            long.
        numbers: expression -> single number.
        texts: expression -> text.
        unused: what was left out and why, in words.
        headers: expression -> what the file calls the column, where that is more than its name.
        missing: expression -> how many of its values are no numbers, and are bridged by straight lines.
        bridged: samples at which one of them is, (samples,) bool; None: none is.
    """

    columns: dict[str, np.ndarray]
    numbers: dict[str, float]
    texts: dict[str, str]
    unused: tuple[str, ...]
    headers: Mapping[str, str] = field(default_factory=dict)
    missing: Mapping[str, int] = field(default_factory=dict)
    bridged: np.ndarray | None = None


@dataclass
class _Taken:
    """What was read of a file so far: how many parts, of how many bytes, and what was left out and why."""

    parts: int = 0
    size: int = 0
    unused: list[str] = field(default_factory=list)


def contents(columns: Columns) -> Contents:
    """Everything in an open file.

    Args:
        columns: the file.

    Returns:
        Columns of the most common length, single numbers, texts.

    Raises:
        ValueError: the file holds no column of at least 8 numbers, too many numbers, or is damaged.
    """
    found, numbers, texts, unused = _everything(columns)
    lengths = [values.size for values in found.values() if values.size >= _LEAST]
    if not lengths:
        if len(columns.positions) > 10 * _LEAST:
            longest = max((values.size for values in found.values()), default=0)
            raise ValueError(
                f"{columns.path}: {len(columns.positions)} columns of at most {longest} numbers: if each of its lines "
                "is a channel, transpose it, so that each column is one"
            )
        raise ValueError(
            f"{columns.path}: no column of at least 8 numbers in it; names: {', '.join(columns.names[:30])}"
        )
    # The longest of the most common lengths: a struct may hold several rasters.
    common = max(set(lengths), key=lambda n: (lengths.count(n), n))
    others = [f"{n} has {v.size} values, not {common} as the others" for n, v in found.items() if v.size != common]
    return _of_length(columns, common, found, numbers, texts, (*unused, *others))


def rasters(columns: Columns) -> list[Contents]:
    """What an open file holds at each of its rasters: columns of equal length, the longest first."""
    found, numbers, texts, unused = _everything(columns)
    lengths = sorted({values.size for values in found.values() if values.size >= _LEAST}, reverse=True)
    return [_of_length(columns, length, found, numbers, texts, tuple(unused)) for length in lengths]


def runs(columns: Columns) -> dict[str, Contents]:
    """The runs that an open file holds in structs or groups with columns of the same names, by what they are called.

    Empty where it holds one alone, or only axes or bearings are called apart.
    """
    found, numbers, texts, unused = _everything(columns)
    split = {name: _COMPONENT.findall(name) for name, values in found.items() if values.size >= _LEAST}
    for depth in range(1, _DEEPEST_RUN + 1):
        groups: dict[str, dict[str, np.ndarray]] = {}
        for name, parts in split.items():
            if len(parts) > depth:
                groups.setdefault("".join(parts[:depth]), {})["".join(parts[depth:])] = found[name]
        alike = [set(below) for below in groups.values()]
        even = all(len({v.size for v in below.values()}) == 1 for below in groups.values())
        same = all(below == alike[0] for below in alike) and len(alike[0]) > 1 if alike else False
        if len(groups) > 1 and even and same and _numbered(groups):
            return {
                group: _of_length(
                    columns, next(iter(below.values())).size, {f"{group}{n}": v for n, v in below.items()},
                    numbers, texts, tuple(unused),
                )
                for group, below in groups.items()
            }  # fmt: skip
    return {}


def _numbered(groups: Iterable[str]) -> bool:
    """Whether names are one word with other numbers, and not one for the axes, bearings or channels of one run."""
    words = {re.sub(r"[\W\d_]+$", "", group).rpartition(".")[2].lower() for group in groups}
    word = words.pop().rpartition("_")[2] if len(words) == 1 else ""
    return bool(word) and word not in _OF_ONE_RUN.split()


def _everything(
    columns: Columns,
) -> tuple[dict[str, np.ndarray], dict[str, float], dict[str, str], list[str]]:
    """Columns of any length, single numbers, texts, and what was left out."""
    found: dict[str, np.ndarray] = {}
    numbers: dict[str, float] = dict(columns.numbers)
    texts: dict[str, str] = {}
    taken = _Taken()
    for name in columns.names:
        for expression, value in _below(columns, name, 0, taken):
            if isinstance(value, str):
                texts[expression] = value
            elif value.size == 1:
                numbers[expression] = float(value[0])
            else:
                found[expression] = value
    return found, numbers, texts, taken.unused


def _of_length(
    columns: Columns,
    length: int,
    found: Mapping[str, np.ndarray],
    numbers: dict[str, float],
    texts: dict[str, str],
    unused: tuple[str, ...],
) -> Contents:
    """The columns of one length, with straight lines over few gaps."""
    kept = {n: unwrapped(v) for n, v in found.items() if v.size == length}
    # Of a column that has few gaps the rest says what it is; without_missing alarms where they are too many.
    bad = {n: garbled_stamps(v) if _rises(v) else ~np.isfinite(v) for n, v in kept.items()}
    missing = {n: int(at.sum()) for n, at in bad.items() if 0 < at.sum() <= _MOST_MISSING * length}
    kept |= {n: bridged(kept[n], bad[n]) for n in missing}
    gone = np.any([bad[n] for n in missing], axis=0) if missing else None
    return Contents(kept, numbers, texts, unused, columns.headers, missing, gone)


def _rises(values: np.ndarray) -> bool:
    """Whether nearly every value is larger than the one before, as those of a time are."""
    steps = np.diff(values[np.isfinite(values)])
    return bool(steps.size and (steps > 0).mean() > 1 - _MOST_GARBLED)


def _below(columns: Columns, expression: str, depth: int, taken: _Taken) -> Iterator[tuple[str, np.ndarray | str]]:
    """Columns, numbers and texts at and below an expression; what cannot be read goes to `unused`."""
    taken.parts += 1
    if taken.parts > _MOST_READ:
        if taken.parts == _MOST_READ + 1:
            taken.unused.append(f"it has more than {_MOST_READ} parts: {expression} and all others are not read")
        return
    try:
        value = columns.value(expression)
    except ValueError as error:  # a text among the numbers of a column, a link that leads out of the file
        taken.unused.append(str(error).removeprefix(f"{columns.path}: "))
        return
    if isinstance(value, np.ndarray):
        _count(columns, value, taken)
    if isinstance(value, np.ndarray) and value.dtype.names:
        value = fields_of(value)
    if isinstance(value, str):
        yield expression, value
    elif isinstance(value, np.ndarray) and value.dtype.kind in "US" and value.size <= _MOST_COLUMNS:
        for i, text in enumerate(value.reshape(-1)):  # names beside a matrix
            yield f"{expression}[{i}]", text.decode(errors="replace") if isinstance(text, bytes) else str(text)
    elif isinstance(value, np.ndarray) and value.dtype.kind in "fiub" and value.size:
        yield from _vectors(expression, value)
    elif depth < _DEEPEST:
        for part in _parts(expression, value):
            yield from _below(columns, part, depth + 1, taken)


def _count(columns: Columns, value: np.ndarray, taken: _Taken) -> None:
    """Count the bytes of a value that was read; ValueError where all together are beyond the limit of a file."""
    taken.size += max(value.nbytes, 8 * value.size)
    try:
        bounded(taken.size, "the file, unpacked,")
    except Refused as problem:
        raise ValueError(f"{columns.path}: {problem}") from None


def _parts(expression: str, value: Any) -> list[str]:
    if isinstance(value, dict):
        return [f"{expression}.{key}" for key in value if _FIELD.fullmatch(key)]
    return [f"{expression}[{i}]" for i in range(min(len(value), _MOST_PARTS))] if isinstance(value, list) else []


def _vectors(expression: str, value: np.ndarray) -> Iterator[tuple[str, np.ndarray]]:
    """The columns of an array, along its longer side; of one that is no matrix, itself."""
    if value.size == max(value.shape, default=1):
        yield expression, np.array(value.reshape(-1), dtype=float)
    elif value.ndim == 2 and min(value.shape) <= _MOST_COLUMNS:
        for j, column in enumerate(columns_of(value).T):
            yield f"{expression}[{j}]", np.array(column, dtype=float)
