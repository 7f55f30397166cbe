"""Readings that are no numbers, and time stamps that are garbled, in a recording that is sound otherwise."""

from collections.abc import Mapping

import numpy as np

from maglev_env.recordings.alarms.alarm import Alarm
from maglev_env.recordings.masking import MOST_MASKED, bridged


def garbled_stamps(time: np.ndarray) -> np.ndarray:
    """Time stamps that are no number, or lie beyond the stamps on both sides while those go on, (samples,) bool."""
    bad = ~np.isfinite(time)
    if time.size < 3 or bad.all():
        return bad
    known = bridged(time, bad)
    before, here, after = known[:-2], known[1:-1], known[2:]
    bad[1:-1] |= (after > before) & ((here < before) | (here > after))
    return bad


def without_missing(
    raw: Mapping[str, np.ndarray], kept: slice, rate: float
) -> tuple[dict[str, np.ndarray], np.ndarray, list[Alarm]]:
    """Columns with straight lines in place of values that are no finite numbers.

    Args:
        raw: column -> values (samples,), as the file has them.
        kept: the samples that the recording uses.
        rate: Hz.

    Returns:
        The columns; which of the samples used are bridged in one of them, (samples,) bool; and an alarm for the
        columns that lack the same. It refuses the recording where they are more than MOST_MASKED of all.
    """
    masked, found = np.zeros(kept.stop - kept.start, bool), dict(raw)
    together: dict[bytes, list[str]] = {}
    for name, values in raw.items():
        bad = ~np.isfinite(values)
        if not bad[kept].any():
            continue
        masked |= bad[kept]
        found[name] = np.zeros(values.size) if bad.all() else bridged(values, bad)
        together.setdefault(bad[kept].tobytes(), []).append(name)
    alarms = [_alarm(names, np.frombuffer(bad, bool), kept.start, rate) for bad, names in together.items()]
    return found, masked, alarms


def _alarm(columns: list[str], bad: np.ndarray, start: int, rate: float) -> Alarm:
    first = int(np.argmax(bad))
    text = (
        f"column {', '.join(map(repr, columns))}: {bad.sum()} of {bad.size} values are no numbers, the first at "
        f"{first / rate:.4g} s "
        f"(sample {start + first})"
    )
    if bad.mean() <= MOST_MASKED:
        return Alarm("samples", columns[0], first / rate, f"{text}; they are bridged and masked", "warning")
    edges = np.concatenate([[-1], np.flatnonzero(bad), [bad.size]])
    longest = int(np.argmax(np.diff(edges)))
    begin, length = int(edges[longest]) + 1, int(edges[longest + 1] - edges[longest]) - 1
    cut = f"use the longest part without: start = {start + begin}, samples = {length}" if length > 1 else "mend it"
    stretch = (start + begin, length) if length > 1 else None
    return Alarm("samples", columns[0], first / rate, f"{text}; {cut}", "refuse", stretch)
