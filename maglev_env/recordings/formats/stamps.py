"""Times that are no plain numbers: times of day, and durations with their unit."""

import re

import numpy as np

# A time of day, behind a date or alone, with or without its zone, as ISO 8601 writes it, or of twelve hours.
_CLOCK = re.compile(
    r"(?:\S+[ T])?(\d{1,2}):([0-5]\d):([0-5]\d(?:[.,]\d+)?)(?: ?Z| ?[+-]\d{2}:?\d{2}| ?([AaPp])\.?[Mm]\.?)?"
)
_SECONDS = re.compile(r"([+-]?\d+(?:[.,]\d+)?(?:[eE][+-]?\d+)?) sec")  # how MATLAB writes a duration

_DAYS = re.compile(r"(\d+) days? \+?(\d+):([0-5]\d):([0-5]\d(?:\.\d+)?)")  # how pandas does


def time_of_day(cell: str) -> float | None:
    """Seconds since midnight of a time of day; None where a text is none."""
    clock = _CLOCK.fullmatch(cell)
    if clock is None:
        return None
    hours, minutes, seconds = (float(part.replace(",", ".")) for part in clock.groups()[:3])
    if half := clock[4]:  # 12 AM is midnight, 12 PM noon
        hours = hours % 12 + 12 * (half.lower() == "p")
    return 3600 * hours + 60 * minutes + seconds


def duration(cell: str) -> float | None:
    """Seconds of a duration; None where a text is none."""
    if in_days := _DAYS.fullmatch(cell):
        days, hours, minutes, seconds = map(float, in_days.groups())
        return 86400 * days + 3600 * hours + 60 * minutes + seconds
    found = _SECONDS.fullmatch(cell)
    return None if found is None else float(found[1].replace(",", "."))


def with_milliseconds(times: np.ndarray, beside: np.ndarray) -> np.ndarray:
    """Times (samples,) in whole seconds with the milliseconds of the next column (samples, 1), where these are such.

    Python's logging writes "13:22:01,250", which commas between columns split.

    Args:
        times: s.
        beside: the next column; (samples, 0) where there is none.
    """
    if beside.shape[1] == 0 or (times % 1).any() or not np.isin(beside, np.arange(1000)).all():
        return times
    finer = times + beside[:, 0] / 1000
    return finer if (np.diff(finer) > 0).all() and not (np.diff(times) > 0).all() else times
