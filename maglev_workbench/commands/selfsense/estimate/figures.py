"""Figures of a recorded coil: its gap with invalid parts marked, and a few PWM periods of its ripple."""

from typing import TYPE_CHECKING

import numpy as np

from maglev_workbench.commands.selfsense.estimate.recorded_coils import SensedCoil
from maglev_workbench.page import COLOURS, styled
from selfsense.validity import AT_END, CLIPPED, CONVERGING, LOST, NO_RIPPLE, WRONG_READING

if TYPE_CHECKING:
    from plotly.graph_objects import Figure, Scatter

REASONS = {CONVERGING: "#999999", NO_RIPPLE: COLOURS[1], AT_END: "#CC79A7", CLIPPED: "#E69F00"}
REASONS |= {WRONG_READING: "#56B4E9", LOST: "#F0E442"}
_POINTS = 6000  # per trace
_PERIODS = 6  # of the PWM in the ripple's figure
_RECTANGLES = 2000  # of one reason


def gap_figure(coil: SensedCoil) -> "Figure":
    """Estimated and recorded gap, their difference, and the ripple's amplitude; invalid stretches shaded by reason."""
    from plotly.subplots import make_subplots

    gap = coil.gap
    block = -(-gap.time.size // _POINTS)
    time = 1e3 * _means(gap.time, block)
    titles = ["gap in µm", "amplitude in A"]
    traces = [(1, 1e6 * gap.gap, "estimated gap", {"color": COLOURS[0], "width": 1.2})]
    if coil.signals.displacement is not None:
        recorded = 1e6 * (coil.sensor.gap - coil.signals.displacement)
        traces.append((1, recorded, "recorded gap", {"color": "#222", "width": 1.4, "dash": "dot"}))
        traces.append((2, 1e6 * gap.gap - recorded, "error", {"color": COLOURS[0], "width": 1}))
        titles.insert(1, "error in µm")
    rows = len(titles)
    traces.append((rows, gap.amplitude, "amplitude", {"color": COLOURS[2], "width": 1}))
    heights = [2.0] + [1.0] * (rows - 1)
    grid = {"shared_xaxes": True, "vertical_spacing": 0.05, "row_heights": heights}
    figure = styled(make_subplots(rows, 1, **grid), 200 + 180 * rows)
    shown = {}
    for row, values, name, line in traces:
        means = _means(values, block)
        shown.setdefault(row, []).append(means)
        figure.add_trace(_line(time, means, name, line, row == 1), row=row, col=1)
    for row, values in shown.items():
        low, high = np.nanmin(values), np.nanmax(values)
        pad = 0.08 * (high - low) + 1e-3 * abs(high) + 1e-12
        figure.update_yaxes(range=[low - pad, high + pad], row=row, col=1)
        for reason, colour in REASONS.items():
            trace = _rectangles(coil, reason, low - pad, high + pad, colour, row == 1)
            if trace is not None:
                figure.add_trace(trace, row=row, col=1)
    for row, title in enumerate(titles, 1):
        figure.update_yaxes(title_text=title, row=row, col=1)
    text = "time in ms" + (f" (means over {block} samples)" if block > 1 else "")
    figure.update_xaxes(title_text=text, row=rows, col=1)
    return figure.update_layout(legend={"orientation": "h", "y": 1.08})


def ripple_figure(coil: SensedCoil) -> "Figure":
    """Current and switching voltage over some PWM periods in the middle of the longest valid stretch."""
    from plotly.subplots import make_subplots

    figure = styled(make_subplots(2, 1, shared_xaxes=True, vertical_spacing=0.08), 420)
    valid = np.flatnonzero(np.diff(np.concatenate([[False], coil.gap.valid, [False]])))
    starts, stops = valid[::2], valid[1::2]
    longest = int(np.argmax(stops - starts))
    n = round(_PERIODS * coil.coil.spec.sample_rate / coil.gap.pwm_frequency)
    first = max(0, int(starts[longest] + stops[longest] - n) // 2)
    part = slice(first, first + n + 1)
    time = 1e3 * coil.gap.time[part]
    for row, values, name, colour in (
        (1, coil.signals.current, "current in A", COLOURS[0]),
        (2, coil.signals.voltage, "voltage in V", COLOURS[1]),
    ):
        line = {"color": colour, "width": 1.2, "shape": "linear" if row == 1 else "vh"}
        trace = _line(time, values[part], name.partition(" ")[0], line, False)
        figure.add_trace(trace.update(mode="lines+markers", marker={"size": 4}), row=row, col=1)
        figure.update_yaxes(title_text=name, row=row, col=1)
    return figure.update_xaxes(title_text="time in ms", row=2, col=1)


def _rectangles(coil: SensedCoil, reason: str, low: float, high: float, colour: str, legend: bool) -> "Scatter | None":
    from plotly.graph_objects import Scatter

    rate = coil.coil.spec.sample_rate
    x, y = [], []
    for stretch in [s for s in coil.gap.reasons if s.reason == reason][:_RECTANGLES]:
        a, b = 1e3 * stretch.start / rate, 1e3 * stretch.stop / rate
        x += [a, a, b, b, a, None]
        y += [low, high, high, low, low, None]
    if not x:
        return None
    style = {"mode": "none", "fill": "toself", "fillcolor": colour, "opacity": 0.35, "hoverinfo": "skip"}
    return Scatter(x=x, y=y, **style, name=f"no gap: {reason}", legendgroup=reason, showlegend=legend)


def _line(time: np.ndarray, values: np.ndarray, name: str, line: dict, legend: bool) -> "Scatter":
    from plotly.graph_objects import Scatter

    text = "%{x:.5g} ms: %{y:.5g}" + f"<extra>{name}</extra>"
    data = {"x": time, "y": values.astype(np.float32), "mode": "lines", "line": line, "name": name}
    return Scatter(**data, hovertemplate=text, showlegend=legend)


def _means(values: np.ndarray, block: int) -> np.ndarray:
    """Means over blocks of samples, nan if a sample is nan; an incomplete block at the end is dropped."""
    return values[: values.size // block * block].reshape(-1, block).mean(axis=1)
