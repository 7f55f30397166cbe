"""Times that are no plain numbers: times of day, and durations with their unit."""

import re

# A time of day, behind a date or alone, with or without its zone, as ISO 8601 writes it.
_CLOCK = re.compile(r"(?:\S+[ T])?(\d{1,2}):([0-5]\d):([0-5]\d(?:[.,]\d+)?)(?: ?Z| ?[+-]\d{2}:?\d{2})?")
_SECONDS = re.compile(r"([+-]?\d+(?:[.,]\d+)?(?:[eE][+-]?\d+)?) sec")  # how MATLAB writes a duration


def time_of_day(cell: str) -> float | None:
    """Seconds since midnight of a time of day; None where a text is none."""
    clock = _CLOCK.fullmatch(cell)
    if clock is None:
        return None
    hours, minutes, seconds = (float(part.replace(",", ".")) for part in clock.groups())
    return 3600 * hours + 60 * minutes + seconds


def duration(cell: str) -> float | None:
    """Seconds of a duration; None where a text is none."""
    found = _SECONDS.fullmatch(cell)
    return None if found is None else float(found[1].replace(",", "."))
