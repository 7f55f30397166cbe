"""An experiment of the dissertation and its outcome: rows of published and found figures, plots and notes."""

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from plotly.graph_objects import Figure


@dataclass(frozen=True)
class Row:
    """One figure beside the published one.

    Args:
        name: of the figure.
        published: number as printed, or the words instead of a number; None: nothing is published.
        found: our figure; nan: there is none.
        unit: of both, as displayed.
        within: relative difference that counts as agreement; None: the figure is only displayed.
        reason: why they differ, or why the published one is wrong, with the evidence.
    """

    name: str
    published: float | str | None
    found: float
    unit: str = ""
    within: float | None = None
    reason: str = ""

    @property
    def difference(self) -> float | None:
        """(found - published) / published, None if that has no meaning."""
        if isinstance(self.published, str) or not self.published:
            return None
        return (self.found - self.published) / self.published

    @property
    def agrees(self) -> bool | None:
        """Whether the difference is within the tolerance; None without a tolerance."""
        if self.within is None or self.difference is None:
            return None
        return bool(abs(self.difference) <= self.within)


@dataclass(frozen=True)
class Outcome:
    """Result of an item.

    Args:
        rows: its figures.
        plots: (heading, plotly figure).
        notes: sentences on the conclusions that the results support.
    """

    rows: tuple[Row, ...]
    plots: "tuple[tuple[str, Figure], ...]" = field(default=())
    notes: tuple[str, ...] = ()


@dataclass(frozen=True)
class Item:
    """One experiment.

    Args:
        name: on the command line.
        title: of its part of the page.
        source: section, table or figure of the dissertation.
        run: gives the outcome for a seed.
    """

    name: str
    title: str
    source: str
    run: Callable[[int], Outcome]
