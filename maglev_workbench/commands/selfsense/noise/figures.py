"""Figures of gap noise: error and its ratio to the bound against current noise, and a record at the rig's own."""

from typing import TYPE_CHECKING

from maglev_workbench.commands.selfsense.noise.study import NoiseStudy
from maglev_workbench.page import COLOURS, STAR, styled

if TYPE_CHECKING:
    from plotly.graph_objects import Figure

LIMIT = 2.0  # of the ratio
_LEFT = 3.0  # times below the least noise: where a logarithmic axis shows none
_SHADES = ("#440154", "#46327E", "#365C8D", "#277F8E", "#1FA187", "#4AC16D", "#A0DA39", "#D0B500", "#B07000")


def sweep(s: NoiseStudy) -> "Figure":
    """Rms error in µm and its bound (dashed) over noise in mA, a curve per converter; below, their ratio."""
    from plotly.graph_objects import Scatter
    from plotly.subplots import make_subplots

    figure = styled(make_subplots(2, 1, shared_xaxes=True, vertical_spacing=0.05, row_heights=[0.6, 0.4]), 700)
    least = min(n for n in s.noises if n)
    for bits, colour in zip(s.bits, _SHADES, strict=False):
        points = [p for p in s.points if p.bits == bits]
        name = converter(bits)
        x = [1e3 * (p.noise or least / _LEFT) for p in points]
        shown = {"x": x, "customdata": [1e3 * p.noise for p in points], "legendgroup": name, "name": name}
        hover = "%{customdata:.3g} mA: "
        own = {**shown, "mode": "lines+markers", "line": {"color": colour}, "marker": {"size": 5}}
        text = {"hovertemplate": hover + f"%{{y:.3g}} µm<extra>{name}</extra>"}
        figure.add_trace(Scatter(y=[1e6 * p.rms for p in points], **own, **text), row=1, col=1)
        dashed = {**shown, "mode": "lines", "line": {"color": colour, "dash": "dash", "width": 1}, "showlegend": False}
        figure.add_trace(Scatter(y=[1e6 * p.bound for p in points], **dashed, hoverinfo="skip"), row=1, col=1)
        text = {"hovertemplate": hover + f"%{{y:.2f}}<extra>{name}</extra>"}
        figure.add_trace(Scatter(y=[p.ratio for p in points], **own, **text, showlegend=False), row=2, col=1)
    if s.own:
        marker = {"symbol": "star", "size": 14, "color": STAR, "line": {"color": "black", "width": 1}}
        for row, y in ((1, 1e6 * s.own.rms), (2, s.own.ratio)):
            at = {"x": [1e3 * (s.own.noise or least / _LEFT)], "y": [y], "mode": "markers", "marker": marker}
            figure.add_trace(Scatter(**at, name="the rig's own", hoverinfo="skip", showlegend=row == 1), row=row, col=1)
    dashed = {"mode": "lines", "line": {"color": "#666", "dash": "dash", "width": 1}, "name": "bound (in its colour)"}
    figure.add_trace(Scatter(x=[None], y=[None], **dashed), row=1, col=1)
    for level, text in ((LIMIT, f"{LIMIT:g}"), (s.cost, f"{s.cost:.3g}: the forward path")):
        figure.add_hline(level, row=2, col=1, line={"color": "#666", "width": 1, "dash": "dot"})
        label = {"text": text, "xref": "x2 domain", "x": 0.995, "xanchor": "right", "yanchor": "bottom"}
        figure.add_annotation(**label, y=level, row=2, col=1, showarrow=False, font={"size": 10, "color": "#666"})
    ticks = [1e3 * least / _LEFT, *(1e3 * n for n in s.noises if n)]
    figure.update_xaxes(type="log", tickvals=ticks, ticktext=["0", *(f"{t:g}" for t in ticks[1:])])
    figure.update_xaxes(title_text="noise of the current reading in mA rms", row=2, col=1)
    figure.update_yaxes(type="log", title_text="gap error in µm rms", dtick=1, row=1, col=1)
    figure.update_yaxes(title_text="error over bound", rangemode="tozero", row=2, col=1)
    return figure.update_layout(legend={"orientation": "h", "y": -0.12})


def record(s: NoiseStudy) -> "Figure":
    """Error of the estimate in µm over a period of the moving gap, with and without noise and converter."""
    from plotly.graph_objects import Figure, Scatter

    figure = styled(Figure(), 360)
    r = s.record
    for y, name, colour, width in (
        (r.error, "estimated less true gap", COLOURS[0], 0.8),
        (r.quiet, "the same read without noise and converter", "#222", 1.5),
    ):
        figure.add_trace(Scatter(x=1e3 * r.time, y=1e6 * y, name=name, line={"color": colour, "width": width}))
    if s.own:
        for sign in (-1, 1):
            line = {"color": STAR, "width": 1, "dash": "dash"}
            band = {"x": 1e3 * r.time, "y": 1e6 * (r.quiet + 2 * sign * s.own.bound), "line": line}
            figure.add_trace(Scatter(**band, name="± twice the bound", showlegend=sign > 0, hoverinfo="skip"))
    figure.update_xaxes(title_text="time in ms", range=[0, 1e3 * r.time[-1]])
    figure.update_yaxes(title_text="gap error in µm")
    return figure.update_layout(legend={"orientation": "h", "y": -0.22})


def converter(bits: int) -> str:
    """A converter in a legend or a table."""
    return f"{bits} bits" if bits else "ideal"
