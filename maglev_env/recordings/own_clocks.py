"""Columns of one file that have a time of their own, which need not be that of the others in the same row."""

from collections.abc import Collection, Sequence

import numpy as np

_APART = 0.1  # of a step by which two clocks may differ and be one


def own_times(columns: Sequence[str], times: Collection[str]) -> dict[str, tuple[str, ...]]:
    """The times that each column of a file stands behind.

    Args:
        columns: expressions in the file's order; the groups of a name end in dots.
        times: those of them that are times.

    Returns:
        By column the times that stand next before it, in its own group or in the nearest one above; without those that
        have none. Times side by side, as one of the day beside one from the start, belong to the same columns.
    """
    found: dict[str, tuple[str, ...]] = {}
    before: dict[str, list[str]] = {}
    ended: set[str] = set()
    for name in columns:
        groups = name.split(".")
        above = [".".join(groups[:depth]) for depth in range(len(groups) - 1, -1, -1)]
        if name in times:
            before[above[0]] = [name] if above[0] in ended else [*before.get(above[0], []), name]
            ended.discard(above[0])
        elif (group := next((g for g in above if g in before), None)) is not None:
            found[name] = tuple(before[group])
            ended.add(group)
    return found


def apart(clock: np.ndarray, own: np.ndarray) -> tuple[float, bool]:
    """How far two clocks, each (samples,) in s, are apart.

    Returns:
        Of samples at which both were read: the median distance (s) of their times in a row, 0 where it is that of one
        clock; and whether they overlap: clocks that do not may count from other instants.
    """
    read = np.isfinite(clock) & np.isfinite(own)
    clock, own = clock[read], own[read]
    if clock.size < 2:
        return 0.0, False
    distance = float(np.median(np.abs(own - clock)))
    overlap = bool(own[0] < clock[-1] and clock[0] < own[-1])
    return (distance if distance > _APART * float(np.median(np.diff(clock))) else 0.0), overlap
