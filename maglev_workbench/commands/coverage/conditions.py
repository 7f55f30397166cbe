"""The conditions under which the intervals of `maglev estimate` are counted."""

from collections.abc import Mapping, Sequence
from typing import Any, Protocol

from maglev_env.fields import check_known
from maglev_workbench.commands.coverage.aperiodic import APERIODIC
from maglev_workbench.commands.coverage.counts import Coverage
from maglev_workbench.commands.coverage.crossed import CROSSED
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


REPEATING: Mapping[str, Condition] = {**PERIODIC, **CROSSED}
CONDITIONS: Mapping[str, Condition] = {**APERIODIC, **REPEATING}
# Names of several conditions, and what docs/coverage.md calls them.
GROUPS: Mapping[str, tuple[str, Mapping[str, Condition]]] = {
    "unrepeated": ("Recordings that do not repeat", APERIODIC),
    "repeating": ("Experiments that repeat", REPEATING),
}


def named(names: Sequence[str]) -> list[str]:
    """Conditions by their names and those of groups; all where there is no name.

    Raises:
        ValueError: A name is unknown.
    """
    check_known(list(names), {**CONDITIONS, **GROUPS}, "condition")
    return list(
        dict.fromkeys(one for name in names or GROUPS for one in (GROUPS[name][1] if name in GROUPS else [name]))
    )
