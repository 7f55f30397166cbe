"""What is said of a recording that tells nothing."""

from collections.abc import Iterable
from dataclasses import asdict, dataclass

from maglev_env.recordings.alarms.alarm import Alarm


class TellsNothing(ValueError):
    """Nothing can be identified from a recording as it is, although its description is right.

    Args:
        reason: why.
        instead: what to record or to do instead.
        where: the file, for the message.
        alarm: what refuses the recording, where one does.
    """

    def __init__(self, reason: str, instead: str, where: object = "", alarm: Alarm | None = None) -> None:
        super().__init__("; ".join(filter(None, (f"{where}: {reason}" if where else reason, instead))))
        self.reason, self.instead, self.alarm = reason, instead, alarm


class NoneTells(ValueError):
    """Nothing can be identified from any recording of a campaign, each for its reason."""


@dataclass(frozen=True)
class LeftOut:
    """A recording that is not used.

    Args:
        recording: its file.
        reason: why.
        instead: what to record or to do instead.
    """

    recording: str
    reason: str
    instead: str

    def __str__(self) -> str:
        return "; ".join(filter(None, (f"{self.recording}: {self.reason}", self.instead)))


def left_out_data(left: Iterable[LeftOut]) -> list[dict[str, str]]:
    """`left_out` of a command's JSON."""
    return [asdict(one) for one in left]
