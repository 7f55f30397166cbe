"""Figures of estimator designs: frequency response of the estimated gap, and lag over phase margin."""

from typing import TYPE_CHECKING

import numpy as np

from maglev_workbench.commands.selfsense.design.study import MARGINS, Study, ideal_low_pass
from maglev_workbench.page import COLOURS, labelled_axis, styled

if TYPE_CHECKING:
    from plotly.graph_objects import Figure

LAG_IN_D, MARGIN_IN_D, AT_IN_D = 18.0, 83.0, 4000.0  # degrees, degrees, Hz (D Fig. 6.14 and 6.32)
_DECIBELS = (-15.0, 15.0)
_STYLES = ({"color": "#222", "width": 2.5}, *({"color": c, "width": 1.5} for c in COLOURS))
_GREY = {"color": "#666", "width": 1, "dash": "dot"}


def responses(s: Study) -> "Figure":
    """Magnitude in dB and phase of every candidate: lines by the linear model, dots by the simulation."""
    from plotly.graph_objects import Scatter
    from plotly.subplots import make_subplots

    figure = styled(make_subplots(2, 1, shared_xaxes=True, vertical_spacing=0.06), 620)
    for i, c in enumerate(s.candidates):
        line = _STYLES[i % len(_STYLES)] | ({"dash": "dash"} if i >= len(_STYLES) else {})
        marker = {"color": line["color"], "size": 7, "symbol": "circle-open", "line": {"width": 1.5}}
        for row, of, text in ((1, _decibels, "%{y:.2f} dB"), (2, _degrees, "%{y:.1f}°")):
            group = {"legendgroup": c.name, "hovertemplate": f"%{{x:.4g}} Hz: {text}<extra>{c.name}</extra>"}
            curve = {"x": c.frequency, "y": of(c.response), "mode": "lines", "line": line, "name": c.name}
            figure.add_trace(Scatter(**curve, **group, showlegend=row == 1), row=row, col=1)
            dots = {"x": c.simulated_frequency, "y": of(c.simulated), "mode": "markers", "marker": marker}
            figure.add_trace(Scatter(**dots, **group, showlegend=False), row=row, col=1)
    dot = {"mode": "markers", "marker": {"color": "#888", "size": 7, "symbol": "circle-open"}}
    figure.add_trace(Scatter(x=[None], y=[None], **dot, name="simulated"), row=1, col=1)
    figure.add_vline(s.at, line=_GREY)
    figure.add_hline(-s.lag, row=2, col=1, line=_GREY)
    label = {"text": f"{s.lag:g}° asked for", "xref": "x2 domain", "x": 0.01, "xanchor": "left", "yanchor": "bottom"}
    figure.add_annotation(**label, y=-s.lag, row=2, col=1, showarrow=False, font={"size": 11, "color": "#666"})
    figure.update_xaxes(**_frequency_axis(s.candidates[0].frequency))
    figure.update_xaxes(title_text="", row=1, col=1)
    figure.update_yaxes(title_text="|estimated / true gap| in dB", range=_DECIBELS, row=1, col=1)
    figure.update_yaxes(title_text="phase in degrees", range=[-225, 15], dtick=45, row=2, col=1)
    return figure.update_layout(legend={"orientation": "h", "y": -0.12})


def trade(s: Study) -> "Figure":
    """Lag over phase margin, with the hand calculation and the dissertation's figures; below it the noise."""
    from plotly.graph_objects import Scatter
    from plotly.subplots import make_subplots

    figure = styled(make_subplots(2, 1, shared_xaxes=True, vertical_spacing=0.06, row_heights=[0.62, 0.38]), 720)
    quiet = not np.isfinite(s.noise_density)
    unit = "kHz" if quiet else "µm"
    for colour, (droop, found) in zip((*COLOURS, "#222"), s.trade.items(), strict=False):
        cost = 1e-3 * found.noise_bandwidth if quiet else 1e6 * s.noise_density * np.sqrt(found.noise_bandwidth)
        for row, y, what in ((1, found.lag, "lag %{y:.1f}°"), (2, cost, f"%{{y:.3g}} {unit}")):
            name = f"sampled forward path, droop up to {droop:g} dB"
            hover = f"margin %{{x:.0f}}°, {what}<extra>{name}</extra>"
            trace = {"x": found.phase_margin, "y": y, "mode": "lines", "line": {"color": colour}, "name": name}
            trace |= {"hovertemplate": hover, "legendgroup": name, "showlegend": row == 1}
            figure.add_trace(Scatter(**trace), row=row, col=1)
    by_hand = ideal_low_pass(s.sensor.estimator.path.low_pass, s.at, MARGINS)
    name = f"by hand: ideal {s.sensor.estimator.path.low_pass / 1e3:g} kHz low-pass alone, P controller"
    line = {"color": "#888", "dash": "dash"}
    figure.add_trace(Scatter(x=MARGINS, y=by_hand, mode="lines", line=line, name=name, hoverinfo="skip"), row=1, col=1)
    for c in s.candidates:
        cost = 1e-3 * c.design.noise_bandwidth if quiet else 1e6 * c.simulated_noise
        for row, y in ((1, c.design.lag), (2, cost)):
            marker = {"color": "#222", "size": 9, "symbol": "circle" if c is s.candidates[0] else "circle-open"}
            trace = {"x": [c.design.phase_margin], "y": [y], "mode": "markers", "marker": marker}
            trace |= {"name": "designs in the table", "legendgroup": "designs", "hovertext": c.name}
            trace |= {"hovertemplate": "%{hovertext}: margin %{x:.1f}°, %{y:.3g}<extra></extra>"}
            figure.add_trace(Scatter(**trace, showlegend=row == 1 and c is s.candidates[0]), row=row, col=1)
    if s.at == AT_IN_D:
        _dissertation(figure)
    top = max(75.0, *(1.1 * np.nanmax(found.lag, initial=0) for found in s.trade.values()))
    figure.update_yaxes(title_text=f"lag at {s.at / 1e3:g} kHz in degrees", range=[0, min(top, 180)], row=1, col=1)
    figure.update_yaxes(
        title_text="noise bandwidth in kHz" if quiet else "gap error in µm rms", rangemode="tozero", row=2, col=1
    )
    figure.update_xaxes(range=[0, 92], dtick=10)
    figure.update_xaxes(title_text="phase margin in degrees", row=2, col=1)
    return figure.update_layout(legend={"orientation": "h", "y": -0.1})


def _dissertation(figure: "Figure") -> None:
    from plotly.graph_objects import Scatter

    line = {"color": COLOURS[1], "width": 1.2, "dash": "dot"}
    figure.add_hline(LAG_IN_D, row=1, col=1, line=line)
    figure.add_vline(MARGIN_IN_D, row=1, col=1, line=line)
    font = {"size": 11, "color": COLOURS[1]}
    texts = (
        {"text": f"dissertation: {LAG_IN_D:g}° of lag", "x": 76, "y": LAG_IN_D},
        {"text": f"dissertation: {MARGIN_IN_D:g}°<br>of margin", "x": MARGIN_IN_D, "y": 1, "yref": "y domain"},
    )
    for text in texts:
        style = {"showarrow": False, "font": font, "align": "right", "xanchor": "right", "yanchor": "top"}
        figure.add_annotation(**text, **style, row=1, col=1)
    both = {"x": [MARGIN_IN_D], "y": [LAG_IN_D], "mode": "markers", "hoverinfo": "skip"}
    marker = {"symbol": "x", "size": 11, "color": COLOURS[1]}
    figure.add_trace(Scatter(**both, marker=marker, name="both at once: no design"), row=1, col=1)


def _frequency_axis(frequency: np.ndarray) -> dict:
    ends = [np.log10(frequency[0]), np.log10(frequency[-1] * 1.02)]
    return labelled_axis("frequency of the gap's motion in Hz", frequency, log=True) | {"range": ends}


def _decibels(response: np.ndarray) -> np.ndarray:
    return 20 * np.log10(np.abs(response))


def _degrees(response: np.ndarray) -> np.ndarray:
    return np.degrees(np.unwrap(np.angle(response)))
