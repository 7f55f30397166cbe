"""Map of the lowest stable sampling rate over the estimator's PI gains."""

from typing import TYPE_CHECKING

import numpy as np

from maglev_workbench.commands.selfsense.rate_limit.rate_map import CLAIMED, REFUSED, RateMap, as_predicted
from maglev_workbench.page import COLOURS, INFEASIBLE, STAR, labelled_axis, styled

if TYPE_CHECKING:
    from plotly.graph_objects import Figure, Scatter

_DASHES = {CLAIMED: "solid", REFUSED: "dot"}
_SYMBOLS = ("star", "diamond", "square", "triangle-up")


def rate_map(m: RateMap) -> "Figure":
    """Colour: lowest stable rate in kHz; lines: limits of the dissertation's rates; marks: designs and checks."""
    from plotly.graph_objects import Figure, Heatmap, Scatter

    figure = styled(Figure(), 660)
    x, y = m.kp * m.gain, m.ki * m.gain
    where = "kp %{customdata[0]:.4g} m/A, ki %{customdata[1]:.4g} m/(A s)<br>"
    gains = np.stack(np.broadcast_arrays(m.kp[None], m.ki[:, None]), axis=-1)
    cell = {"x": x, "y": y, "customdata": gains, "hoverongaps": False}
    none = np.where(np.isnan(m.lowest), 0.0, np.nan).T
    flat = {"colorscale": [[0, INFEASIBLE], [1, INFEASIBLE]], "showscale": False}
    text = where + f"not stable at {m.rates[-1] / 1e3:g} kHz<extra></extra>"
    figure.add_trace(Heatmap(**cell, z=none, **flat, hovertemplate=text))
    bar = {"title": {"text": "lowest stable<br>rate, kHz"}, "thickness": 14}
    text = where + "stable from %{z:g} kHz on<extra></extra>"
    scale = {"colorscale": "cividis_r", "zmin": m.rates[0] / 1e3, "zmax": m.rates[-1] / 1e3, "colorbar": bar}
    figure.add_trace(Heatmap(**cell, z=m.lowest.T / 1e3, **scale, hovertemplate=text))
    for rate, limit in m.limits.items():
        line = {"color": STAR, "width": 2.5, "dash": _DASHES[rate]}
        name = f"stable at {rate / 1e3:g} kHz below this line"
        margin = np.stack([limit.kp, limit.ki, limit.margin], axis=-1)
        text = where + "margin %{customdata[2]:.1f}°<extra>" + f"limit of {rate / 1e3:g} kHz</extra>"
        at = {"x": limit.kp * m.gain, "y": limit.ki * m.gain, "customdata": margin, "hovertemplate": text}
        figure.add_trace(Scatter(**at, mode="lines", line=line, name=name))
    for symbol, g in zip(_SYMBOLS, m.designs, strict=False):
        marker = {"symbol": symbol, "size": 13, "color": "white", "line": {"color": "black", "width": 1.5}}
        text = where + f"stable from {g.lowest / 1e3:g} kHz on<extra>{g.name}</extra>"
        at = {"x": [g.kp * m.gain], "y": [g.ki * m.gain], "customdata": [[g.kp, g.ki]], "hovertemplate": text}
        figure.add_trace(Scatter(**at, mode="markers", marker=marker, name=g.name))
    for agrees, symbol, colour in ((True, "circle-open", "#222"), (False, "x", COLOURS[1])):
        figure.add_trace(_checks(m, agrees, symbol, colour))
    ends = [[np.log10(a[0]), np.log10(a[-1])] for a in (x, y)]
    figure.update_xaxes(**labelled_axis("kp times the path's gain", x, log=True), range=ends[0])
    figure.update_yaxes(**labelled_axis("ki times the path's gain, 1/s", y, log=True), range=ends[1])
    return figure.update_layout(legend={"orientation": "h", "y": -0.13})


def _checks(m: RateMap, agrees: bool, symbol: str, colour: str) -> "Scatter":
    from plotly.graph_objects import Scatter

    shown = [g for g in m.checks if as_predicted(g) == agrees]
    at = {"x": [g.kp * m.gain for g in shown], "y": [g.ki * m.gain for g in shown], "hoverinfo": "skip"}
    marker = {"symbol": symbol, "size": 8, "color": colour, "line": {"width": 1.3}}
    name = "simulated: agrees" if agrees else "simulated: does not agree"
    return Scatter(**at, mode="markers", marker=marker, name=name, showlegend=bool(shown) or agrees)
