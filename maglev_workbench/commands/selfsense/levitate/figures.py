"""Figures of self-sensing in the loop: |S|, coefficients over bands, a piece of time, and its cost over kp and kd."""

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from estimation.normal import NORMAL_95
from maglev_env.evaluation.evaluation import Evaluation
from maglev_env.loop.gains import GAIN_CARDS, of_axis
from maglev_workbench.commands.selfsense.levitate.experiments import SENSORS, Comparison, Curve, Piece
from maglev_workbench.page import (
    COLOURS,
    INFEASIBLE,
    STAR,
    colour_panels,
    labelled_axis,
    mark_iso_zones,
    shaded,
    styled,
)

if TYPE_CHECKING:
    from plotly.graph_objects import Figure, Scatter

NAMES = {"probe": "probe", "self_sensing": "self-sensing"}
COLOUR = dict(zip(SENSORS, COLOURS, strict=False))
LOST = COLOURS[1]  # cells that only the probe holds
_COEFFICIENTS = {"stiffness": (1e-3, "kN/m"), "damping": (1.0, "N s/m")}
_COSTS = (  # label, colours
    ("phase margin lost, degrees (linear model)", "cividis_r"),
    ("gap error, µm rms", "cividis_r"),
    ("peak |S|, times that with the probe", "cividis_r"),
    ("score, less that with the probe", "viridis"),
)


def sensitivity(curves: Mapping[str, Curve]) -> "Figure":
    """|S| of both loops at the injection lines with 95 % bars, and by the linear model."""
    from plotly.graph_objects import Figure, Scatter

    figure = styled(Figure(), 460)
    tops, bottoms = [6.0], []
    for s, curve in curves.items():
        size, half = np.abs(curve.measured), NORMAL_95 * np.sqrt(curve.variance / 2)
        if curve.model is not None:
            line = {"color": COLOUR[s], "width": 1.5, "dash": "solid" if s == "probe" else "dash"}
            name = f"{NAMES[s]}, linear model"
            model = {"x": curve.model_frequency, "y": np.abs(curve.model), "mode": "lines", "hoverinfo": "skip"}
            figure.add_trace(Scatter(**model, line=line, name=name))
            bottoms.append(np.abs(curve.model).min())
        if np.isfinite(size).any():
            bars = {"array": half, "arrayminus": np.minimum(half, 0.99 * size), "thickness": 1, "width": 0}
            text = "%{x:.4g} Hz: |S| %{y:.4g} ± %{customdata:.2g}" + f"<extra>{NAMES[s]}</extra>"
            marker = {"color": COLOUR[s], "size": 5, "symbol": "circle" if s == "probe" else "diamond"}
            dots = {"x": curve.frequency, "y": size, "error_y": bars, "customdata": half, "hovertemplate": text}
            figure.add_trace(Scatter(**dots, mode="markers", marker=marker, name=NAMES[s]))
            tops.append(1.2 * size.max())
            bottoms.append(size.min())
    mark_iso_zones(figure, log=True)
    ends = np.array([min(bottoms, default=0.1) / 1.3, max(tops)])
    lines = next(iter(curves.values())).frequency
    figure.update_xaxes(**labelled_axis("frequency in Hz", lines, log=True))
    figure.update_yaxes(**labelled_axis("|S|", ends, log=True), range=np.log10(ends))
    return figure.update_layout(legend={"orientation": "h", "y": -0.2})


def coefficients(preset: Mapping[str, Evaluation]) -> "Figure":
    """Stiffness and damping of the first experiments in sliding bands with 95 % bands."""
    from plotly.graph_objects import Scatter
    from plotly.subplots import make_subplots

    titles = [f"{name} in {unit}" for name, (_, unit) in _COEFFICIENTS.items()]
    figure = styled(make_subplots(1, 2, subplot_titles=titles), 440)
    for col, (name, (factor, unit)) in enumerate(_COEFFICIENTS.items(), 1):
        shown = []
        for s, e in preset.items():
            value, half = (
                v[0] * factor for v in (getattr(e, f"band_{name}"), NORMAL_95 * getattr(e, f"band_{name}_se"))
            )
            if not np.isfinite(value).any():
                continue
            centre = e.bands.mean(axis=1)
            figure.add_trace(shaded(centre, value - half, value + half, COLOUR[s], legendgroup=s), row=1, col=col)
            text = f"%{{x:g}} Hz: %{{y:.4g}} ± %{{customdata:.2g}} {unit}<extra>{NAMES[s]}</extra>"
            line = {"color": COLOUR[s], "dash": "solid" if s == "probe" else "dash"}
            trace = {"x": centre, "y": value, "customdata": half, "hovertemplate": text, "line": line}
            trace |= {"name": NAMES[s], "legendgroup": s, "showlegend": col == 1}
            figure.add_trace(Scatter(**trace), row=1, col=col)
            shown.append(value)
        if shown:
            low, high = np.nanpercentile(shown, [8, 97])
            pad = 0.3 * (high - low) + 0.05 * abs(high)
            figure.update_yaxes(range=[low - pad, high + pad], row=1, col=col)
    figure.update_xaxes(title_text="centre of the band in Hz")
    return figure.update_layout(legend={"orientation": "h", "y": -0.2})


def piece(shown: Piece) -> "Figure":
    """Position and reading, and below them their difference, over time in ms."""
    from plotly.graph_objects import Scatter
    from plotly.subplots import make_subplots

    figure = styled(make_subplots(2, 1, shared_xaxes=True, vertical_spacing=0.08, row_heights=[0.6, 0.4]), 480)
    time = 1e3 * (shown.time - shown.time[0])
    error = shown.reading - shown.position
    for row, values, name, colour in (
        (1, shown.reading, "sensed reading", COLOUR["self_sensing"]),
        (1, shown.position, "position", "#222"),
        (2, error, "reading less position", COLOUR["self_sensing"]),
    ):
        line = {"color": colour, "width": 1.2}
        figure.add_trace(Scatter(x=time, y=1e6 * values, name=name, line=line, showlegend=row == 1), row=row, col=1)
    figure.update_yaxes(title_text="displacement in µm", row=1, col=1)
    figure.update_yaxes(title_text="error in µm", row=2, col=1)
    figure.update_xaxes(title_text="time in ms", row=2, col=1)
    return figure.update_layout(legend={"orientation": "h", "y": 1.08})


def cost_map(c: Comparison) -> "Figure":
    """Maps of the losses by self-sensing over kp and kd, with the stability borders of both sensors."""
    from plotly.graph_objects import Heatmap

    probe, sensed = (c.map[s] for s in SENSORS)
    shape = (len(c.gains["kp"]), len(c.gains["kd"]))
    with np.errstate(invalid="ignore"):
        ratio = sensed.margins["peak_sensitivity"] / probe.margins["peak_sensitivity"]
    costs = [c.lost, 1e6 * sensed.gap_error_rms, ratio, sensed.score - probe.score]
    both = probe.feasible & sensed.feasible
    only = np.where(probe.feasible & ~sensed.feasible, 1.0, np.nan)
    only[~probe.feasible & ~sensed.feasible] = 0.0
    at = {name: c.gains[name] * GAIN_CARDS[name].on_pages[0] for name in ("kp", "kd")}
    x, y = (_axis(c, name) for name in ("kp", "kd"))
    scales = []
    for (label, colours), cost in zip(_COSTS, costs, strict=True):
        ends = np.percentile(cost[both & np.isfinite(cost)], [2, 98]) if both.any() else (0.0, 1.0)
        scales.append((label, colours, *ends))
    figure = colour_panels(scales, x, y)
    cell = {"x": at["kp"], "y": at["kd"], "hoverongaps": False}
    where = "kp %{x:.4g} A/mm, kd %{y:.4g} A s/m<br>"
    fill = {"colorscale": [[0, INFEASIBLE], [0.5, INFEASIBLE], [0.5, LOST], [1, LOST]], "zmin": 0, "zmax": 1}
    why = np.where(only == 1, "only the probe holds it", "neither sensor holds it").reshape(shape).T
    held = _hover(c).reshape(*shape, -1).transpose(1, 0, 2)
    for p, cost in enumerate(costs):
        panel = {"row": p // 2 + 1, "col": p % 2 + 1}
        flat = {"z": only.reshape(shape).T, "text": why, "hovertemplate": where + "%{text}<extra></extra>"}
        figure.add_trace(Heatmap(**cell, **flat, **fill, showscale=False), **panel)
        z = np.where(both, cost, np.nan).reshape(shape).T
        trace = {"z": z, "customdata": held, "hovertemplate": where + _HELD, "coloraxis": f"coloraxis{p + 1}"}
        figure.add_trace(Heatmap(**cell, **trace), **panel)
        for s, e in c.map.items():
            figure.add_trace(_border(c, s, e.feasible.reshape(shape), showlegend=p == 0), **panel)
        figure.add_trace(_preset(c, showlegend=p == 0), **panel)
    figure.add_trace(_swatch(LOST, "only the probe holds"), row=1, col=1)
    figure.add_trace(_swatch(INFEASIBLE, "neither holds"), row=1, col=1)
    return figure.update_layout(showlegend=True, legend={"orientation": "h", "y": -0.07})


_HELD = (
    "phase margin %{customdata[0]:.3g}° to %{customdata[1]:.3g}°, by the linear model %{customdata[6]:.3g}° less<br>"
    "peak |S| %{customdata[2]:.3g} to %{customdata[3]:.3g}, score %{customdata[4]:.3g} to %{customdata[5]:.3g}<br>"
    "gap error %{customdata[7]:.3g} µm rms<extra></extra>"
)


def _axis(c: Comparison, name: str) -> dict[str, Any]:
    values = c.gains[name] * GAIN_CARDS[name].on_pages[0]
    ends = _edges(values, c.log)[[0, -1]]
    axis = labelled_axis(f"{name} in {GAIN_CARDS[name].on_pages[1]}", values, c.log)
    return axis | {"range": np.log10(ends) if c.log else ends}


def _hover(c: Comparison) -> np.ndarray:
    """customdata (experiments, 8) for _HELD."""
    pairs = [(e.margins["phase_margin"], e.margins["peak_sensitivity"], e.score) for e in c.map.values()]
    own = c.map["self_sensing"]
    columns = [column for pair in zip(*pairs, strict=True) for column in pair]
    return np.stack([*columns, c.lost, 1e6 * own.gap_error_rms], axis=-1)


def _edges(centres: np.ndarray, log: bool) -> np.ndarray:
    """Borders (n + 1,) of the cells with evenly spaced centres (n,)."""
    v = np.log(centres) if log else centres
    half = (v[-1] - v[0]) / (2 * (v.size - 1))
    v = np.concatenate([v - half, v[-1:] + half])
    return np.exp(v) if log else v


def _border(c: Comparison, sensor: str, held: np.ndarray, showlegend: bool) -> "Scatter":
    """The edges between cells (kp, kd) that a sensor holds and those that it does not."""
    from plotly.graph_objects import Scatter

    x, y = (_edges(c.gains[name] * GAIN_CARDS[name].on_pages[0], c.log) for name in ("kp", "kd"))
    xs: list[float] = []
    ys: list[float] = []
    for i, j in np.argwhere(held[1:] != held[:-1]):
        xs += [x[i + 1], x[i + 1], np.nan]
        ys += [y[j], y[j + 1], np.nan]
    for i, j in np.argwhere(held[:, 1:] != held[:, :-1]):
        xs += [x[i], x[i + 1], np.nan]
        ys += [y[j + 1], y[j + 1], np.nan]
    line = {"color": "black", "width": 4} if sensor == "probe" else {"color": STAR, "width": 2}
    legend = {"name": f"stability border, {NAMES[sensor]}", "legendgroup": sensor, "showlegend": showlegend}
    return Scatter(x=xs, y=ys, mode="lines", line=line, hoverinfo="skip", **legend)


def _preset(c: Comparison, showlegend: bool) -> "Scatter":
    from plotly.graph_objects import Scatter

    own = of_axis(c.rig.gains, 0)
    at = {axis: [getattr(own, name) * GAIN_CARDS[name].on_pages[0]] for axis, name in (("x", "kp"), ("y", "kd"))}
    marker = {"symbol": "star", "size": 14, "color": "white", "line": {"color": "black", "width": 1.5}}
    legend = {"name": "preset gains", "legendgroup": "preset", "showlegend": showlegend}
    return Scatter(**at, mode="markers", marker=marker, hoverinfo="skip", **legend)


def _swatch(colour: str, name: str) -> "Scatter":
    from plotly.graph_objects import Scatter

    return Scatter(
        x=[None], y=[None], mode="markers", name=name, marker={"symbol": "square", "size": 12, "color": colour}
    )
