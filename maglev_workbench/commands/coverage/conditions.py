"""The conditions under which the intervals of `maglev estimate` are counted."""

from collections.abc import Mapping, Sequence
from typing import Any, Protocol

from maglev_workbench.commands.coverage.aperiodic import APERIODIC
from maglev_workbench.commands.coverage.counts import Coverage
from maglev_workbench.commands.coverage.periodic import PERIODIC


class Condition(Protocol):
    """One kind of experiment, which is drawn again and again."""

    @property
    def title(self) -> str:
        """In words."""
        ...

    def drawn(self, seed: int, draw: int) -> Any:
        """What the estimate says of one draw; the seed of a study and the number of the draw decide it."""
        ...

    def counted(self, drawn: Sequence[Any]) -> tuple[Coverage, ...]:
        """How often the intervals of each quantity hold the truth."""
        ...


CONDITIONS: Mapping[str, Condition] = {**PERIODIC, **APERIODIC}
