"""What a result shows of itself in a terminal, in a notebook, and to other libraries."""

from abc import ABC, abstractmethod
from collections.abc import Iterable
from html import escape
from typing import TYPE_CHECKING, ClassVar

if TYPE_CHECKING:
    import pandas as pd
    import xarray as xr
    from matplotlib.figure import Figure

SHOWN = 10  # rows of a table in a notebook


def matplotlib_figure() -> "type[Figure]":
    """The class of matplotlib's figures, which draw without a window.

    Raises:
        ModuleNotFoundError: It is not installed; the message says what to install.
    """
    try:
        from matplotlib.figure import Figure
    except ModuleNotFoundError:
        message = 'matplotlib is not installed: pip install "maglev-workbench[plot]"'
        raise ModuleNotFoundError(message, name="matplotlib") from None
    return Figure


def shown_as_table(one: object, rows: Iterable[tuple[str, object]]) -> str:
    """HTML of an object in a notebook: its one line, and names and values below; everything is escaped."""
    cells = "".join(f"<tr><th>{escape(name)}</th><td>{escape(str(value))}</td></tr>" for name, value in rows)
    return f"<p>{escape(repr(one))}</p><table>{cells}</table>"


class Presented(ABC):
    """A result with one line for a terminal, a small table for a notebook, and its numbers as xarray and pandas."""

    rows: ClassVar[str]  # the dimension that makes the rows of its table

    @abstractmethod
    def __str__(self) -> str:
        """One line."""

    @abstractmethod
    def to_xarray(self) -> "xr.Dataset":
        """All numbers with named coordinates; the attribute `units` of each variable is its SI unit."""

    def to_pandas(self) -> "pd.DataFrame":
        """The numbers that belong to whole rows, in SI; columns are named as in `to_xarray`."""
        dataset = self.to_xarray()
        return dataset[[name for name, of in dataset.data_vars.items() if of.dims == (self.rows,)]].to_dataframe()

    def __repr__(self) -> str:
        return f"<{self}>"

    def _repr_html_(self) -> str:
        table = self.to_pandas()
        more = f"<p>{len(table) - SHOWN} more rows</p>" if len(table) > SHOWN else ""
        return f"<p>{escape(str(self))}</p>{table.head(SHOWN).to_html(float_format='{:.4g}'.format)}{more}"
