"""Plots for several items."""

from collections.abc import Sequence
from itertools import cycle
from typing import TYPE_CHECKING

import numpy as np

from maglev_workbench.page import COLOURS, labelled_axis, styled

if TYPE_CHECKING:
    from plotly.graph_objects import Figure

DASHES = ("solid", "dash", "dot", "dashdot")


def by_frequency(
    frequency: np.ndarray, curves: Sequence[tuple[str, np.ndarray]], unit: str, log: bool = False
) -> "Figure":
    """Named curves (n,) over frequency (n,) in Hz.

    Args:
        frequency: (n,), Hz.
        curves: names and values (n,).
        unit: title of the y axis; what is in m/N is shown in µm/N.
        log: both axes are logarithmic.
    """
    from plotly.graph_objects import Figure

    figure = Figure()
    if unit == "m/N":
        unit, curves = "µm/N", [(name, values * 1e6) for name, values in curves]
    for i, ((name, values), colour) in enumerate(zip(curves, cycle(COLOURS))):
        line = {"color": colour, "dash": DASHES[i // len(COLOURS) % len(DASHES)], "width": 1.6}
        figure.add_scatter(x=frequency, y=values, name=name, mode="lines", line=line)
    figure.update_xaxes(**labelled_axis("frequency in Hz", frequency, log))
    shown = np.concatenate([values[np.isfinite(values)] for _, values in curves])
    return styled(figure.update_yaxes(**labelled_axis(unit, shown, log)), 400)
