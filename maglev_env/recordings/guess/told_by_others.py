"""What several files with the same column tell of it: the size of its scale, and in which direction it counts."""

from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace
from math import copysign

from maglev_env.recordings.guess.columns.column_guess import ColumnGuess, with_scale
from maglev_env.recordings.guess.columns.scaling import NO_UNIT
from maglev_env.recordings.guess.suspended import AT_THE_GAP, BUT_STATED, DIRECTION, OTHER_WAY


@dataclass(frozen=True)
class Told:
    """What the files with one column tell of it: the size of its scale, and which way it counts.

    Attributes:
        larger, size: The file that tells the size.
        turned, asks: The file that shows a distance from the magnet, and what it asks; "" where none does.
        faced: What shows that it is no such distance, a file or its controller; "" where none does.
    """

    larger: str
    size: float
    turned: str
    asks: str
    faced: str


def told_by(same: Sequence[tuple[str, ColumnGuess]], known_loops: Collection[str]) -> Told:
    """What is told of a column.

    Args:
        same: Name of each file that has it, and its guess there.
        known_loops: Files whose controller is known: their directions count before those of others. Those of files in
            which a set point counts against the displacement count first.
    """
    file, least = min(same, key=lambda one: abs(one[1].scale))
    beside = [(name, c) for name, c in same if OTHER_WAY in c.reason]
    sure = beside or [(name, c) for name, c in same if name in known_loops]
    turned, asks = next(((name, c.ask) for name, c in sure or same if c.scale < 0), ("", ""))
    shows = "" if turned or not sure else sure[0][0] if beside else f"the controller of {sure[0][0]}"
    return Told(file, abs(least.scale), turned, asks, shows)


def as_told(column: ColumnGuess, told: Told) -> ColumnGuess:
    """The guess of a column in one file with what is told of it; what the user states stands."""
    if NO_UNIT in column.reason and abs(column.scale) != told.size and not column.stated:
        reason = f"{column.reason}, but in the unit that the larger values of {told.larger} tell"
        column = replace(with_scale(column, copysign(told.size, column.scale)), reason=reason)
    if told.turned and column.scale > 0 and not column.stated:
        parts = [*column.ask.split("; "), *told.asks.split("; ")]
        asked = "; ".join(dict.fromkeys(part for part in parts if part and part != DIRECTION))
        reason = f"{column.reason}; a distance from the magnet, as {told.turned} shows"
        column = replace(with_scale(column, -column.scale), reason=reason, ask=asked)
    if told.faced:
        column = replace(column, ask="; ".join(p for p in column.ask.split("; ") if not p.startswith(BUT_STATED)))
    if told.faced and column.scale < 0 and not column.stated:
        asked = "; ".join(part for part in column.ask.split("; ") if part != AT_THE_GAP)
        reason = f"{column.reason}; but it counts as {told.faced} shows"
        column = replace(with_scale(column, -column.scale), reason=reason, ask=asked)
    return column
