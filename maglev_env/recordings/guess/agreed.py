"""Guesses of several files of one rig: what a file cannot tell of a column, another file with the same column may."""

from collections.abc import Sequence
from dataclasses import replace
from math import copysign

from maglev_env.channels import MEASURED
from maglev_env.recordings.guess.columns import NO_UNIT, ColumnGuess
from maglev_env.recordings.guess.recording import RecordingGuess, other_way_round

AGREED = frozenset(MEASURED) | {"reference", "injection", "voltage"}  # the clock is each file's own, and so is its unit


def agreed(guesses: Sequence[RecordingGuess]) -> list[RecordingGuess]:
    """The guesses with one scale for each column that several files have as the same channel.

    Without a unit in its header the file with the largest values tells the unit, because the size of small ones may be
    that of a quiet rotor; the clock of each file is its own. A file in which the current shows that positions are
    distances from the magnet tells it of the others, too. What is asked stays asked.

    Args:
        guesses: one for each file.
    """
    columns: dict[tuple[str, str], list[tuple[str, ColumnGuess]]] = {}
    for guess in guesses:
        for column in guess.columns:
            if column.channel in AGREED:
                columns.setdefault((column.channel, column.column), []).append((guess.file, column))
    told = {key: _telling(same) for key, same in columns.items()}
    found = []
    for guess in guesses:
        own = tuple(_as_told(c, *told[c.channel, c.column]) if c.channel in AGREED else c for c in guess.columns)
        known = replace(guess, columns=own)
        turned = any(
            a.channel == "displacement" and a.scale * b.scale < 0 for a, b in zip(own, guess.columns, strict=True)
        )
        found.append(other_way_round(known) if turned else known)
    return found


def _telling(same: Sequence[tuple[str, ColumnGuess]]) -> tuple[str, float, str, str]:
    """File and size of the scale, and file of a reversed direction ("" where there is none) with what it asks."""
    file, least = min(same, key=lambda one: abs(one[1].scale))
    turned, asks = next(((name, c.ask) for name, c in same if c.scale < 0), ("", ""))
    return file, abs(least.scale), turned, asks


def _as_told(column: ColumnGuess, larger: str, size: float, turned: str, asks: str) -> ColumnGuess:
    if NO_UNIT in column.reason and abs(column.scale) != size:
        reason = f"{column.reason}, but in the unit that the larger values of {larger} tell"
        column = replace(column, scale=copysign(size, column.scale), reason=reason)
    if turned and column.scale > 0:
        asked = "; ".join(dict.fromkeys(filter(None, [*column.ask.split("; "), *asks.split("; ")])))
        reason = f"{column.reason}; a distance from the magnet, as {turned} shows"
        column = replace(column, scale=-column.scale, reason=reason, ask=asked)
    return column
