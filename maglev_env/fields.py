"""Fields of dataclasses that are read from TOML files: units, physical ranges, and messages that name the error."""

import re
import tomllib
from collections.abc import Iterable, Mapping
from dataclasses import MISSING, field, fields
from math import isfinite
from pathlib import Path
from typing import Any

MAX_FILE_BYTES = 1_000_000  # of a TOML file
_AT_LINE = re.compile(r"at line (\d+)")


def is_number(value: Any) -> bool:
    """Whether a value is a finite number and not a boolean."""
    try:
        return isinstance(value, int | float) and not isinstance(value, bool) and isfinite(value)
    except OverflowError:  # an integer too large for a float
        return False


def quantity(unit: str, low: float, high: float, default: Any = MISSING) -> Any:
    """A dataclass field with its unit and physical range; if low is an int, values must be whole numbers."""
    metadata = {"unit": unit, "low": low, "high": high}
    return field(metadata=metadata) if default is MISSING else field(default=default, metadata=metadata)


def check_range(name: str, value: Any, metadata: Mapping[str, Any]) -> None:
    """Check that a value is a number within a field's physical range; None is accepted.

    Args:
        name: of the field, for messages.
        value: to check.
        metadata: of the field, with unit, low and high.

    Raises:
        ValueError: It is not.
    """
    if value is None:
        return
    whole = isinstance(metadata["low"], int)
    if not is_number(value) or (whole and not isinstance(value, int)):
        raise ValueError(f"{name} = {value!r} is not {'a whole number' if whole else 'a finite number'}")
    if not metadata["low"] <= value <= metadata["high"]:
        raise ValueError(
            f"{name} = {value} {metadata['unit']} is outside the physical range "
            f"{metadata['low']:g} .. {metadata['high']:g} (SI units)"
        )


def toml_text(path: Path, kind: str) -> str:
    """The text of a TOML file, of a rig for example, as `kind` says in messages.

    Raises:
        ValueError: It is not a regular file (a pipe would never end), too large, or not UTF-8.
        OSError: It cannot be read.
    """
    if path.exists() and not path.is_file():
        raise ValueError(f"{path}: not a regular file; name a {kind} file")
    if path.stat().st_size > MAX_FILE_BYTES:
        raise ValueError(f"{path}: larger than {MAX_FILE_BYTES} bytes; that is not a {kind} file")
    try:
        return path.read_text(encoding="utf-8")
    except UnicodeDecodeError as error:
        raise ValueError(f"{path}: {error}") from error


SHOWN_OF_LINE = 80  # characters of a line in a message


def toml_tables(text: str) -> dict[str, Any]:
    """The tables of a TOML text.

    Raises:
        ValueError: It is not TOML; the message shows the line, which most often holds a number in another writing, such
            as 0,05 or .5.
    """
    try:
        return tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        lines, at = text.split("\n"), _AT_LINE.search(str(error))
        if at is None or not 0 < int(at[1]) <= len(lines):
            raise
        line = lines[int(at[1]) - 1].strip()[:SHOWN_OF_LINE]
        raise ValueError(
            f"{error}: {line!r}; numbers are written 0.05 or 5.0, with a point and a digit on either side of it, and "
            "texts in quotes"
        ) from error


def table_as(cls: type, data: Mapping[str, Any], name: str) -> Any:
    """The dataclass from table [name] of a file; without the table its defaults.

    Raises:
        ValueError: A key is unknown; the message names it.
    """
    table = data.get(name, {})
    check_known(table, [f.name for f in fields(cls)], f"[{name}]")
    return cls(**table)


def check_known(keys: Iterable[str], known: Iterable[str], where: str) -> None:
    """Raise ValueError for the first key that is unknown; the message lists the known ones."""
    for key in keys:
        if key not in known:
            raise ValueError(f"{where}: unknown key {key!r}; known keys: {', '.join(sorted(known))}")


def increasing_pair(value: Any, where: str) -> tuple[float, float]:
    """The value as two increasing numbers; ValueError if it is anything else."""
    if not (isinstance(value, list | tuple) and len(value) == 2 and all(map(is_number, value)) and value[0] < value[1]):
        raise ValueError(f"{where} = {value!r} must be two increasing numbers")
    return value[0], value[1]
