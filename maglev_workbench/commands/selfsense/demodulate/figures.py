"""Figures of demodulator and estimator: traces over two periods with their errors, and a piece enlarged."""

from typing import TYPE_CHECKING

import numpy as np

from maglev_workbench.commands.selfsense.demodulate.study import DUTIES, METHODS, Demodulation
from maglev_workbench.page import COLOURS, styled

if TYPE_CHECKING:
    from plotly.graph_objects import Figure, Scatter

COLOUR = {"demodulated": COLOURS[1], "estimated": COLOURS[0]}
TRUE = "#222"
_POINTS = 2000  # per trace; blocks of about a PWM period
_ENLARGED = 20  # PWM periods


def comparison(d: Demodulation) -> "Figure":
    """Two periods of true, demodulated and estimated gap, and the errors below; left constant, right varying duty."""
    from plotly.subplots import make_subplots

    titles = ["duty one half", f"duty one half ± {d.duty_swing:g}"]
    grid = {"shared_xaxes": True, "shared_yaxes": True, "vertical_spacing": 0.06, "horizontal_spacing": 0.04}
    figure = styled(make_subplots(2, 2, subplot_titles=titles, row_heights=[0.55, 0.45], **grid), 640)
    n = round(2 * d.sensor.acquisition.rate / d.frequency)
    block = -(-n // _POINTS)
    time = 1e3 * _means(d.time[:n] - d.time[0], block)
    for col, duty in enumerate(DUTIES, 1):
        trace = d.traces[duty]
        for m in METHODS:
            line = {"color": COLOUR[m], "width": 1.2}
            gap, error = trace.gaps[m][:n], (trace.gaps[m] - d.gap)[:n]
            figure.add_trace(_line(time, _means(gap, block), line, m, col == 1), row=1, col=col)
            figure.add_trace(_line(time, _means(error, block), line, m, False), row=2, col=col)
        true = {"color": TRUE, "width": 1.6, "dash": "dot"}
        figure.add_trace(_line(time, _means(d.gap[:n], block), true, "true", col == 1), row=1, col=col)
    dashed = {"color": TRUE, "width": 1.6, "dash": "dash"}
    closed = _line(time, _means(d.closed_form[:n], block), dashed, "closed form of the demodulator's error", True)
    figure.add_trace(closed, row=2, col=2)
    figure.update_xaxes(title_text="time in ms", row=2)
    figure.update_yaxes(title_text="gap in µm", row=1, col=1)
    figure.update_yaxes(title_text="error in µm", row=2, col=1)
    return figure.update_layout(legend={"orientation": "h", "y": -0.12})


def enlarged(d: Demodulation) -> "Figure":
    """Some PWM periods around the largest drive of the varying duty, every sample."""
    from plotly.graph_objects import Figure

    trace = d.traces["varying"]
    rate = d.sensor.acquisition.rate
    n = round(_ENLARGED * rate / d.sensor.supply.frequency)
    first = max(0, int(np.argmax(np.abs(trace.drive[: round(rate / d.frequency)]))) - n // 2)
    part = slice(first, first + n)
    time = 1e3 * (d.time[part] - d.time[0])
    figure = styled(Figure(), 380)
    for m in METHODS:
        figure.add_trace(_line(time, trace.gaps[m][part], {"color": COLOUR[m], "width": 1.5}, m, True))
    figure.add_trace(_line(time, d.gap[part], {"color": TRUE, "width": 1.6, "dash": "dot"}, "true", True))
    figure.update_xaxes(title_text="time in ms").update_yaxes(title_text="gap in µm")
    return figure.update_layout(legend={"orientation": "h", "y": -0.2})


def _line(time: np.ndarray, metres: np.ndarray, line: dict, name: str, legend: bool) -> "Scatter":
    from plotly.graph_objects import Scatter

    y = (1e6 * metres).astype(np.float32)
    text = "%{x:.4g} ms: %{y:.2f} µm" + f"<extra>{name}</extra>"
    trace = {"x": time.astype(np.float32), "y": y, "mode": "lines", "line": line, "name": name, "legendgroup": name}
    return Scatter(**trace, hovertemplate=text, showlegend=legend)


def _means(values: np.ndarray, block: int) -> np.ndarray:
    """Means over blocks of samples; what is left over at the end is dropped."""
    return values[: values.size // block * block].reshape(-1, block).mean(axis=1)
