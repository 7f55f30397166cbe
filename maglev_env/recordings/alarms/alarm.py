"""What is wrong with a recording, as its rules say it."""

import json
from collections.abc import Iterable
from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING, Literal

if TYPE_CHECKING:
    import xarray as xr

Code = Literal["lost levitation", "off centre", "stuck reading", "samples", "rail"]

READINGS = ("displacement", "current", "command", "force", "gap_estimate")
MOST_EVENTS = 10  # of one kind that are looked at and told one by one
# A reading counts as the same one after another when it lasts so long, in samples: longer than a sound one rests.
STUCK_SAMPLES = 10


@dataclass(frozen=True)
class Alarm:
    """What is wrong with a recording.

    Attributes:
        code: Which rule.
        channel: Whose.
        time: When it begins, s from the first sample used.
        sentence: What happened, when, and how to cut or mend it.
        severity: "refuse": nothing is identified from the recording as it is; "warning": it is used with care.
        stretch: First sample of the file, and number of samples, of the longest part without it, where one is left.
    """

    code: Code
    channel: str
    time: float
    sentence: str
    severity: Literal["refuse", "warning"]
    stretch: tuple[int, int] | None = None


def alarms_of(dataset: "xr.Dataset") -> tuple[Alarm, ...]:
    """The alarms that `read_recording` found."""
    return tuple(Alarm(**a) for a in json.loads(dataset.attrs.get("alarms", "[]")))


def alarms_text(alarms: Iterable[Alarm]) -> str:
    """Alarms as the attribute of a dataset."""
    return json.dumps([asdict(a) for a in alarms])


def cut_to(dataset: "xr.Dataset", start: int, part: tuple[int, int]) -> str:
    """What a campaign states to use a part of a recording alone: rows of the file."""
    first, last = part
    if "row" in dataset.coords:
        rows = dataset["row"].values
        first, last = int(rows[first]), int(rows[last - 1]) + 1
    return f"start = {start + first}, samples = {last - first}"


def stretches_between(spells: list[tuple[int, int]], size: int) -> list[tuple[int, int]]:
    """The stretches between spells."""
    ends = [0, *[b for _, b in spells]]
    starts = [*[a for a, _ in spells], size]
    return list(zip(ends, starts, strict=True))


def in_small_units(value: float, unit: str) -> str:
    """A value as text, in thousandths of its unit or millionths."""
    return f"{value * 1e3:.4g} m{unit}" if abs(value) >= 1e-4 else f"{value * 1e6:.4g} u{unit}"
