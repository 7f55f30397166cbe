"""What the rules of redundancy say of a recording."""

from dataclasses import dataclass
from typing import Literal

# "contradiction": beyond doubt against physics or the design, nothing is identified. "wiring": what is recorded is not
# what is stated, and no effect of the library does that. "effect": an effect of the library may do it as well.
# "quality": poor data. "not checkable": nothing recorded tells.
Kind = Literal["contradiction", "wiring", "effect", "quality", "not checkable"]
ORDER: tuple[Kind, ...] = ("contradiction", "wiring", "effect", "quality", "not checkable")


@dataclass(frozen=True)
class Finding:
    """One finding.

    Attributes:
        code: Name of the rule.
        recording: File, with its axis where it has two.
        channel: Channel or parameter that is wrong or doubtful; several joined by " or ".
        value: Size, in the unit of its sentence; None where there is no number.
        interval: 95 % interval of the value.
        message: The sentence: channel, kind, size, and what to do.
        kind: See `Kind`.
    """

    code: str
    recording: str
    channel: str
    value: float | None
    interval: tuple[float, float] | None
    message: str
    kind: Kind
