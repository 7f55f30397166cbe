"""Figure of mismatches: rms error of the gap, phase margin and peak sensitivity, as read and after a calibration."""

from typing import TYPE_CHECKING

import numpy as np

from maglev_workbench.commands.selfsense.robustness.experiments import AS_BELIEVED, Robustness, change_of
from maglev_workbench.page import COLOURS, ISO_LIMITS, styled

if TYPE_CHECKING:
    from plotly.graph_objects import Figure

_STYLES = {  # colour, symbol, name
    "raw": (COLOURS[1], "circle", "as it reads"),
    "calibrated": (COLOURS[0], "diamond", "statically calibrated"),
    "demodulator": (COLOURS[2], "square-open", "demodulation alone, calibrated"),
}
_PANELS = {"phase_margin": "phase margin in °", "peak_sensitivity": "peak |S|"}


def robustness_figure(r: Robustness) -> "Figure":
    """Dots per mismatch: rms error by itself, and phase margin and peak |S| of the loop."""
    from plotly.graph_objects import Scatter
    from plotly.subplots import make_subplots

    names = list(r.rows)
    titles = ["rms error of the gap in µm", *_PANELS.values()]
    figure = styled(make_subplots(1, 3, shared_yaxes=True, horizontal_spacing=0.03, subplot_titles=titles), 560)
    alone = {"raw": "raw", "calibrated": "estimator", "demodulator": "demodulator"}
    for style, field in alone.items():
        colour, symbol, label = _STYLES[style]
        x = [1e6 * getattr(row.errors, field) for row in r.rows.values()]
        marker = {"color": colour, "symbol": symbol, "size": 9}
        trace = {"x": x, "y": names, "mode": "markers", "marker": marker, "name": label, "legendgroup": style}
        figure.add_trace(Scatter(**trace, hovertemplate="%{y}: %{x:.3g} µm<extra></extra>"), row=1, col=1)
    figure.update_xaxes(type="log", dtick=1, row=1, col=1)
    for col, (quantity, title) in enumerate(_PANELS.items(), 2):
        held = [getattr(getattr(row, of), quantity) for row in r.rows.values() for of in ("raw", "calibrated")]
        held = np.concatenate(held)
        low, high = (np.nanmin(held), np.nanmax(held)) if np.isfinite(held).any() else (0.0, 1.0)
        edge = low - 0.08 * (high - low)  # crosses stand at the left
        for of in ("raw", "calibrated"):
            colour, symbol, label = _STYLES[of]
            loops = [getattr(row, of) for row in r.rows.values()]
            lost = np.array([not loop.levitates.all() for loop in loops])
            x = np.array([np.mean(getattr(loop, quantity)) for loop in loops])
            marker = {"color": colour, "size": 9, "symbol": np.where(lost, "x", symbol)}
            text = np.where(lost, "does not levitate", [f"{title} {value:.3g}" for value in x])
            trace = {"x": np.where(lost, edge, x), "y": names, "mode": "markers", "marker": marker, "text": text}
            half = np.nan_to_num([change_of(r, loop, quantity)[1] for loop in loops])
            trace |= {
                "error_x": {"array": np.where(lost, 0.0, half), "thickness": 1.5, "width": 3},
                "legendgroup": of,
                "showlegend": False,
                "hovertemplate": "%{y}: %{text}<extra></extra>",
            }
            figure.add_trace(Scatter(**trace, name=label), row=1, col=col)
        believed = np.mean(getattr(r.rows[AS_BELIEVED].raw, quantity))
        if np.isfinite(believed):
            figure.add_vline(float(believed), row=1, col=col, line={"color": "#666", "width": 1, "dash": "dash"})
        if quantity == "peak_sensitivity":
            for limit in ISO_LIMITS:
                if low < limit < high:
                    figure.add_vline(limit, row=1, col=col, line={"color": "#666", "width": 1})
    figure.update_yaxes(autorange="reversed")
    figure.update_layout(margin={"l": 140})
    return figure.update_layout(legend={"orientation": "h", "y": -0.1})
