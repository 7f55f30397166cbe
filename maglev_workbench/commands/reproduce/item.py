"""An experiment of the dissertation and its outcome: rows of published and found figures, tables, plots and notes."""

from collections.abc import Callable
from dataclasses import dataclass, field
from math import inf, isfinite
from typing import TYPE_CHECKING, Literal

if TYPE_CHECKING:
    from plotly.graph_objects import Figure

Kind = Literal["prediction", "consequence", "fit"]
KINDS: tuple[Kind, ...] = ("prediction", "consequence", "fit")


@dataclass(frozen=True)
class Row:
    """One figure beside the published one.

    Args:
        name: of the figure.
        published: number as printed, or the words instead of a number; None: nothing is published.
        found: our figure; nan: there is none.
        unit: of both, as displayed.
        within: relative difference from a published number that counts as agreement.
        reason: why they differ, why they cannot be compared, or why the published one is wrong, with the evidence.
        means: least and greatest figure that the published words allow.
        kind: what an agreement would be worth. "prediction": the published figure is in nothing that ours is made of.
            "consequence": ours follows from the text's own figures or printed equations, or from a rig built with the
            published figure. "fit": something that the text leaves open was chosen so that they agree. Every row with a
            verdict has one.
        again: name of the item that counts this published figure, if this row is another way to it.

    Raises:
        ValueError: The row has a verdict without a kind, or a kind without a verdict.
    """

    name: str
    published: float | str | None
    found: float
    unit: str = ""
    within: float | None = None
    reason: str = ""
    means: tuple[float, float] | None = None
    kind: Kind | None = None
    again: str = ""

    def __post_init__(self) -> None:
        if (self.agrees is None) != (self.kind is None):
            raise ValueError(f"row {self.name!r}: a verdict and its kind belong together")

    @property
    def difference(self) -> float | None:
        """(found - published) / published, None if that has no meaning."""
        if isinstance(self.published, str) or not self.published:
            return None
        return (self.found - self.published) / self.published

    @property
    def agrees(self) -> bool | None:
        """Whether the difference is within the tolerance, or the figure what the words mean; None: not compared."""
        if self.means is not None:
            return bool(self.means[0] <= self.found <= self.means[1])
        if self.within is None or self.difference is None:
            return None
        return bool(abs(self.difference) <= self.within)

    @property
    def tolerance(self) -> str:
        """The tolerance in words, "" without a verdict."""
        if self.means is not None:
            low, high = self.means
            if isfinite(low) and isfinite(high):
                return f"{low:g} to {high:g}" if low < high else f"{low:g}"
            return f"above {low:g}" if high == inf else f"below {high:g}"
        return "" if self.agrees is None else f"± {100 * self.within:g} %"  # type: ignore[operator]

    @property
    def counts(self) -> bool:
        """Whether the headline counts the row: a verdict on a figure that no other row counts."""
        return self.agrees is not None and not self.again


@dataclass(frozen=True)
class Table:
    """A table beside the rows: heading, columns and rows of text."""

    heading: str
    head: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]


@dataclass(frozen=True)
class Outcome:
    """Result of an item.

    Args:
        rows: its figures.
        plots: (heading, plotly figure).
        notes: sentences on the conclusions that the results support.
        tables: further tables.
    """

    rows: tuple[Row, ...]
    plots: "tuple[tuple[str, Figure], ...]" = field(default=())
    notes: tuple[str, ...] = ()
    tables: tuple[Table, ...] = ()


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
