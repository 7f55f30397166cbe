"""What one column of a file is taken for."""

from dataclasses import dataclass, replace
from typing import Any

from maglev_env.channels import unit_of


@dataclass(frozen=True)
class ColumnGuess:
    """What one column is taken for.

    Args:
        column: expression, as `Columns.column` takes it.
        label: what the file calls it.
        channel: channel of a campaign; "" where the column is not used.
        scale: SI value of one of the file's units.
        reason: the evidence.
        confidence: from 0 to 1.
        ask: what the user should state; empty where nothing is open.
        resting: whether it is not used for the sole reason that it never changes in this file.
        offset: SI value at which the column reads 0.
        total: whether a current includes the bias of the rig.
        stated: whether its scale is stated by the user.
    """

    column: str
    label: str
    channel: str
    scale: float
    reason: str
    confidence: float
    ask: str = ""
    resting: bool = False
    offset: float = 0.0
    total: bool = False
    stated: bool = False

    @property
    def source(self) -> dict[str, Any]:
        """Its table in [recording.channels]."""
        stated = {"scale": (self.scale, 1.0), "offset": (self.offset, 0.0), "total": (self.total, False)}
        return {"from": self.column, **{key: value for key, (value, usual) in stated.items() if value != usual}}


def with_scale(column: ColumnGuess, scale: float) -> ColumnGuess:
    """The column in another unit or direction: it is 0 at the same reading."""
    return replace(column, scale=scale, offset=column.offset * scale / column.scale)


def si_unit(channel: str) -> str:
    """The SI unit of a channel's values, "s" of the time."""
    return "s" if channel == "time" else unit_of(channel)
