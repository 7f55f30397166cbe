"""What a diagnosis asks to be recorded next."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any


@dataclass(frozen=True)
class Choice:
    """A recording of the menu.

    Attributes:
        what: What to record.
        effort: Relative: 1 for a change of software, 2 of wiring, 3 of hardware.
        expected_separation: Cost (-2 ln likelihood ratio) between the two candidates that it alone separates least;
            None where it is not computed.
        change: What differs from the recording that it repeats: "amplitude" (factor), "length" (factor on the number of
            periods, or how often what has no period is repeated), "offset" (m), "gains" (factors
            on kp and kd), "excitation" (at, lines and peak, N or A; these lines are no longer driven otherwise; or,
            beside what never repeats, frequencies in Hz in place of lines), "channels" (recorded in addition),
            "speed" (factor).
    """

    what: str
    effort: float
    expected_separation: float | None
    change: Mapping[str, Any]


@dataclass(frozen=True)
class Proposal:
    """A proposed recording.

    Attributes:
        what: What to record.
        why: The reason.
        effort: See `Choice`.
        expected_separation: Cost (-2 ln likelihood ratio) between the two candidates that it separates least, together
            with the proposals before it; None where it is not computed, as of an unknown cause.
        change: See `Choice`.
        of: Name of the recording that it repeats; empty where any will do.
    """

    what: str
    why: str
    effort: float
    expected_separation: float | None
    change: Mapping[str, Any]
    of: str = ""


@dataclass(frozen=True)
class Plan:
    """What to measure next.

    Attributes:
        proposals: In the order in which to record them, each with what it adds; the later ones are needed only where
            those before have not decided.
        menu: All that was weighed, that which separates most first.
        untold: Pairs of candidates, "a from b", that all of the menu together would not tell apart.
    """

    proposals: tuple[Proposal, ...]
    menu: tuple[Choice, ...] = ()
    untold: tuple[str, ...] = ()

    def to_json(self) -> dict[str, Any]:
        rows = {name: [dict(vars(one)) for one in getattr(self, name)] for name in ("proposals", "menu")}
        return {**rows, "untold": list(self.untold)}
