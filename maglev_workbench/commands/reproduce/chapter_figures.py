"""Plots for several items."""

from collections.abc import Sequence
from itertools import cycle
from typing import TYPE_CHECKING

import numpy as np

from maglev_workbench.page import COLOURS, styled

if TYPE_CHECKING:
    from plotly.graph_objects import Figure

DASHES = ("solid", "dash", "dot", "dashdot")


def by_frequency(
    frequency: np.ndarray, curves: Sequence[tuple[str, np.ndarray]], unit: str, log: bool = False
) -> "Figure":
    """Named curves (n,) over frequency (n,) in Hz; unit: title of the y axis; log: both axes are logarithmic."""
    from plotly.graph_objects import Figure

    figure = Figure()
    for i, ((name, values), colour) in enumerate(zip(curves, cycle(COLOURS))):
        line = {"color": colour, "dash": DASHES[i // len(COLOURS) % len(DASHES)], "width": 1.6}
        figure.add_scatter(x=frequency, y=values, name=name, mode="lines", line=line)
    kind = "log" if log else "linear"
    figure.update_xaxes(title_text="frequency in Hz", type=kind).update_yaxes(title_text=unit, type=kind)
    return styled(figure, 400)
