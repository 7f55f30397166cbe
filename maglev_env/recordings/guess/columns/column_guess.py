"""What one column of a file is taken for."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

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
        resting: the channel that it would be, but is not for the sole reason that it never changes in this file.
        offset: SI value at which the column reads 0.
        total: whether a current includes the bias of the rig.
        stated: whether its scale is stated by the user.
        less: of an opposed coil's current, the column of the other coil; half of the difference counts.
    """

    column: str
    label: str
    channel: str
    scale: float
    reason: str
    confidence: float
    ask: str = ""
    resting: str = ""
    offset: float = 0.0
    total: bool = False
    stated: bool = False
    less: str = ""

    @property
    def source(self) -> dict[str, Any]:
        """Its table in [recording.channels]."""
        stated = {"scale": (self.scale, 1.0), "offset": (self.offset, 0.0), "total": (self.total, False)}
        read = {"from": [self.column, self.less], "weights": [0.5, -0.5]} if self.less else {"from": self.column}
        return read | {key: value for key, (value, usual) in stated.items() if value != usual}

    def values(self, columns: Mapping[str, np.ndarray]) -> np.ndarray:
        """Its values (samples,) in SI, from those of a file's columns."""
        read = (columns[self.column] - columns[self.less]) / 2 if self.less else columns[self.column]
        return read * self.scale + self.offset


def with_scale(column: ColumnGuess, scale: float) -> ColumnGuess:
    """The column in another unit or direction: it is 0 at the same reading."""
    return replace(column, scale=scale, offset=column.offset * scale / column.scale)


def si_unit(channel: str) -> str:
    """The SI unit of a channel's values, "s" of the time."""
    return "s" if channel == "time" else unit_of(channel)
