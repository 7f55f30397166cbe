"""Time series of observer, Kalman filter and parameter estimator against the true position."""

from typing import TYPE_CHECKING

import numpy as np

from maglev_workbench.commands.selfsense.rivals.experiments import Result, Rivalry
from maglev_workbench.page import COLOURS, styled

if TYPE_CHECKING:
    from plotly.graph_objects import Figure

LABELS = {"observer": "state observer", "kalman": "extended Kalman filter", "estimator": "parameter estimator"}
SHOWN = ("nominal", "resistance +20 %", "force step")
_WINDOW = 50.0  # time scales of the magnet
_POINTS = 3000  # of a trace at most


def series(r: Rivalry) -> "Figure":
    """A piece of three cases, a panel each: position and the three readings in µm over time in ms."""
    from plotly.graph_objects import Scatter
    from plotly.subplots import make_subplots

    shown = [next(one for one in r.results if one.case.name == name) for name in SHOWN]
    titles = [f"{one.case.name}: from {_span(r, one)[0] * 1e3:.0f} ms on" for one in shown]
    figure = styled(make_subplots(3, 1, subplot_titles=titles, vertical_spacing=0.09), 900)
    styles = {"estimator": (COLOURS[2], 1.0), "observer": (COLOURS[0], 2.0), "kalman": (COLOURS[1], 1.5)}
    for row, one in enumerate(shown, 1):
        start, end = _span(r, one)
        traces = [("true position", one.time, one.position, "#222", 2.0)]
        for name, (colour, width) in styles.items():
            time = one.own_time if name == "estimator" else one.time
            traces.insert(len(traces) - (name == "estimator"), (LABELS[name], time, getattr(one, name), colour, width))
        for name, time, values, colour, width in traces:
            inside = np.flatnonzero((time >= start) & (time <= end))
            inside = inside[:: max(1, inside.size // _POINTS)]
            line = {"color": colour, "width": width}
            at = {"x": 1e3 * (time[inside] - start), "y": 1e6 * values[inside], "mode": "lines", "line": line}
            figure.add_trace(Scatter(**at, name=name, legendgroup=name, showlegend=row == 1), row=row, col=1)
    figure.update_yaxes(title_text="displacement in µm")
    figure.update_xaxes(title_text="time in ms", row=3, col=1)
    return figure.update_layout(legend={"orientation": "h", "y": -0.08})


def _span(r: Rivalry, one: Result) -> tuple[float, float]:
    """Begin and end (s) of the piece: the end of the record, or from shortly before a force step."""
    length = min(_WINDOW * one.case.magnet.time_scale, r.seconds / 3)
    start = r.seconds / 3 - 0.2 * length if one.case.step else one.time[-1] - length
    return start, start + length
