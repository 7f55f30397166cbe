"""Figures of a sweep: maps with the stability border, lines, points, and coefficients over frequency."""

from collections.abc import Mapping, Sequence
from math import prod
from typing import TYPE_CHECKING, Any

import numpy as np

from estimation.normal import NORMAL_95
from maglev_workbench.page import (
    COLOURS,
    INFEASIBLE,
    STAR,
    colour_panels,
    labelled_axis,
    mark_iso_zones,
    note,
    number,
    shaded,
    styled,
)
from tuning.swept_sets import SweptSets

if TYPE_CHECKING:
    from plotly.graph_objects import Figure

PID = ("kp", "ki", "kd")
QUANTITIES = {  # factor from SI, label, colours
    "stiffness": (1e-3, "stiffness in kN/m", "viridis"),
    "damping": (1.0, "damping in N s/m", "viridis"),
    "peak_sensitivity": (1.0, "peak sensitivity |S|", "cividis_r"),
    "score": (1.0, "score", "viridis"),
}
_HOVER = (
    "stiffness %{customdata[0]:.4g} kN/m, damping %{customdata[1]:.4g} N s/m<br>peak |S| %{customdata[2]:.3g}, "
    "phase margin %{customdata[4]:.3g}°<br>score %{customdata[3]:.3g}<extra></extra>"
)
_INFEASIBLE = "%{text}<extra>infeasible</extra>"
WORST_SENSITIVITY = 6.0  # end of the colour scale: a loop with a larger peak is not useful


def shown_gains(sets: SweptSets) -> list[str]:
    """Gains that tables and figures of a sweep show: those of a PID, and all others that differ."""
    return [name for name in sets.shown if name in PID or np.unique(sets[name]).size > 1]


def gains_in_words(sets: SweptSets) -> list[str]:
    """The shown gains of every experiment, in display units."""
    columns = [(name, sets[name] * sets.shown[name][0], sets.shown[name][1]) for name in shown_gains(sets)]
    return [
        ", ".join(f"{name} {number(values[i])} {unit}".rstrip() for name, values, unit in columns)
        for i in range(len(sets))
    ]


def over_gains(sets: SweptSets) -> "list[tuple[str, str | Figure]]":
    """The four quantities over the swept gains, as maps, lines or points according to the layout of the sweep."""
    counts = {name: np.unique(sets[name]).size for name in shown_gains(sets)}
    swept = _across([name for name, count in counts.items() if count > 1])
    if not swept:
        return []
    colours = f" Colours end at the 2nd and 98th percentile, for |S| at {WORST_SENSITIVITY:g}."
    if len(swept) == 1:
        text = (
            "Shaded: 95 %. Thick: the stability border, half way between two gains. Grey: infeasible. Star: the best."
        )
        return [(f"Over {swept[0]}", _lines(sets, swept[0])), ("", note(text))]
    points = {tuple(p) for p in zip(*(sets[name] for name in swept), strict=True)}
    if len(swept) <= 3 and len(points) == len(sets) == prod(counts[name] for name in swept):
        text = (
            "Thick: the stability border, half way between grid points. Grey: infeasible. Star: the best shown, filled "
        )
        text += "where it is the best of all. Thin: peak |S| 3, 4 and 5, where the zones of ISO 14839-3 meet." + colours
        return [("Maps over the gains", _maps(sets, swept)), ("", note(text))]
    text = "Crosses: infeasible. Star: the best. Every point shows its other gains on hover." + colours
    return [("Points over the gains", _points(sets, swept)), ("", note(text))]


def _across(swept: list[str]) -> list[str]:
    """Swept gains in the order in which figures use them: across, up, and the others."""
    ahead = [name for name in ("kp", "kd") if name in swept]
    return ahead + [name for name in swept if name not in ahead] if len(swept) > 2 else swept


def _shown(sets: SweptSets, name: str, of: str = "") -> np.ndarray:
    """A variable in display units of its quantity `of`, (experiments,); nan if infeasible or unbounded."""
    value = sets[name] * QUANTITIES[of or name][0]
    return np.where(sets["feasible"] & np.isfinite(value), value, np.nan)


def _hover(sets: SweptSets) -> dict[str, np.ndarray]:
    """customdata (experiments, 5 + gains) for hover texts, and texts (experiments,) on why a set is infeasible."""
    gains = [sets[name] * sets.shown[name][0] for name in shown_gains(sets)]
    values = [*(_shown(sets, name) for name in QUANTITIES), sets["phase_margin"], *gains]
    times = sets["touchdown_time"]
    why = ["unstable loop" if np.isnan(t) else f"touched down after {t:.3g} s" for t in times]
    return {"customdata": np.stack(values, axis=-1), "text": np.array(why)}


def _templates(sets: SweptSets) -> tuple[str, str]:
    """Hover texts of feasible and of infeasible sets; the gains stand in customdata from the sixth place on."""
    parts = []
    for i, name in enumerate(shown_gains(sets), 5):
        parts.append(f"{name} %{{customdata[{i}]:.4g}} {sets.shown[name][1]}".rstrip())
    where = ", ".join(parts) + "<br>"
    return where + _HOVER, where + _INFEASIBLE


def _axis(sets: SweptSets, name: str) -> dict[str, Any]:
    scale, unit = sets.shown[name]
    return labelled_axis(f"{name} in {unit}", sets[name] * scale, sets.attrs.get("log") == "true")


def _gain_panels(sets: SweptSets, x: str, y: str) -> "Figure":
    """Empty panels of the quantities over two gains, with their colour scales."""
    scales = []
    for name, (_, label, colours) in QUANTITIES.items():
        ends = {"peak_sensitivity": (1, WORST_SENSITIVITY), "score": (0, 1)}.get(name)
        scales.append((label, colours, *(ends or np.nanpercentile(_shown(sets, name), [2, 98]))))
    return colour_panels(scales, _axis(sets, x), _axis(sets, y))


def _reached_out(values: np.ndarray, log: bool) -> np.ndarray:
    """Grid values extended by half a step at either end, to the borders of a map's outer cells."""
    v = np.log(values) if log else values
    v = np.concatenate([v[:1] - (v[1] - v[0]) / 2, v, v[-1:] + (v[-1] - v[-2]) / 2])
    return np.exp(v) if log else v


def _maps(sets: SweptSets, swept: Sequence[str]) -> "Figure":
    """Heat maps over two gains with the stability border; a slider selects the third gain."""
    x, y, *slid = swept
    order = np.lexsort([sets[name] for name in (x, y, *slid)])
    slices = order.reshape(-1, np.unique(sets[y]).size, np.unique(sets[x]).size)
    best = int(np.where(sets["feasible"], sets["score"], -1.0).argmax())
    first = int(np.flatnonzero((slices == best).any(axis=(1, 2)))[0])
    figure, owner, hover = _gain_panels(sets, x, y), [], _hover(sets)
    traces, panels = [], []
    for s, cells in enumerate(slices):
        for panel, trace in _map_traces(sets, hover, cells, x, y, best):
            traces.append(trace | {"visible": s == first})
            panels.append(panel)
            owner.append(s)
    figure.add_traces(traces, rows=[p // 2 + 1 for p in panels], cols=[p % 2 + 1 for p in panels])
    if slid:
        scale, unit = sets.shown[slid[0]]
        steps = []
        for s, cells in enumerate(slices):
            label = number(float(sets[slid[0]][cells[0, 0]]) * scale)
            steps.append({"method": "restyle", "label": label, "args": [{"visible": [o == s for o in owner]}]})
        prefix = {"prefix": f"{slid[0]} in {unit}: "}
        figure.update_layout(sliders=[{"active": first, "steps": steps, "currentvalue": prefix, "pad": {"t": 60}}])
    return figure


def _map_traces(
    sets: SweptSets, hover: Mapping[str, np.ndarray], cells: np.ndarray, x: str, y: str, best: int
) -> list[tuple[int, dict[str, Any]]]:
    """The traces of one slice with their panels; cells: experiments (y, x); best: experiment of the best score.

    They are data, of which plotly makes traces once: it would copy each of its own.
    """
    ok, log = sets["feasible"][cells], sets.attrs.get("log") == "true"
    at_x, at_y = sets[x][cells[0]] * sets.shown[x][0], sets[y][cells[:, 0]] * sets.shown[y][0]
    cell = {"x": at_x, "y": at_y, "customdata": hover["customdata"][cells], "hoverongaps": False}
    feasible, infeasible = _templates(sets)
    grey = {"z": np.where(ok, np.nan, 0.0), "colorscale": [INFEASIBLE, INFEASIBLE], "showscale": False}
    grey |= {"text": hover["text"][cells], "hovertemplate": infeasible}
    border = {"x": _reached_out(at_x, log), "y": _reached_out(at_y, log), "z": np.pad(ok.astype(float), 1, mode="edge")}
    border |= {"contours": {"start": 0.5, "end": 0.5, "size": 1, "coloring": "none"}, "name": "stability border"}
    border |= {"line": {"color": "black", "width": 4, "smoothing": 0}, "hoverinfo": "skip"}
    traces: list[tuple[int, dict[str, Any]]] = []
    for panel, name in enumerate(QUANTITIES):
        z = _shown(sets, name)[cells]
        of_panel = {"z": z, "coloraxis": f"coloraxis{panel + 1}", "hovertemplate": feasible}
        traces.append((panel, {"type": "heatmap", **cell, **grey}))
        traces.append((panel, {"type": "heatmap", **cell, **of_panel}))
        traces.append((panel, {"type": "contour", **border}))
        if name == "peak_sensitivity":
            zones = {"start": 3, "end": 5, "size": 1, "coloring": "none", "showlabels": True}
            line = {"color": "white", "width": 1.5, "smoothing": 0}
            zoned = {"contours": zones, "line": line, "hoverinfo": "skip"}
            traces.append((panel, {"type": "contour", "x": at_x, "y": at_y, "z": z, **zoned}))
        if ok.any():
            score = np.where(ok, sets["score"][cells], -1.0)
            here = cells.ravel()[score.argmax()]
            traces.append((panel, _star(sets, here, x, y, "star" if here == best else "star-open")))
    return traces


def _star(sets: SweptSets, best: int, x: str, y: str, symbol: str = "star") -> dict[str, Any]:
    at = {axis: [float(sets[name][best]) * sets.shown[name][0]] for axis, name in (("x", x), ("y", y))}
    marker = {"symbol": symbol, "size": 16, "color": STAR, "line": {"color": "white", "width": 1.5}}
    return {"type": "scatter", **at, "mode": "markers", "marker": marker, "hoverinfo": "skip"}


def _points(sets: SweptSets, swept: Sequence[str]) -> "Figure":
    """Scattered gain sets over two of the gains, coloured; infeasible ones as crosses."""
    from plotly import graph_objects as go

    x, y = swept[:2]
    hover, ok, figure = _hover(sets), sets["feasible"], _gain_panels(sets, x, y)
    at_x, at_y = (sets[name] * sets.shown[name][0] for name in (x, y))
    cross = {"symbol": "x-thin", "size": 7, "line": {"color": "#999", "width": 1.5}}
    best = int(np.where(ok, sets["score"], -1.0).argmax())
    feasible, infeasible = _templates(sets)
    for p, name in enumerate(QUANTITIES):
        colour = {"color": _shown(sets, name)[ok], "coloraxis": f"coloraxis{p + 1}", "size": 9}
        panel = {"row": p // 2 + 1, "col": p % 2 + 1}
        for some, marker, template in ((~ok, cross, infeasible), (ok, colour, feasible)):
            trace = {"x": at_x[some], "y": at_y[some], "mode": "markers", "marker": marker, "hovertemplate": template}
            figure.add_trace(go.Scatter(**trace, **{key: value[some] for key, value in hover.items()}), **panel)
        figure.add_trace(_star(sets, best, x, y), **panel)
    return figure


def _lines(sets: SweptSets, x: str) -> "Figure":
    """The quantities over one gain with 95 % bands and the stability borders."""
    from plotly import graph_objects as go
    from plotly.subplots import make_subplots

    data = sets.some(np.argsort(sets[x], kind="stable"))
    log, at, ok = data.attrs.get("log") == "true", data[x] * sets.shown[x][0], data["feasible"]
    middle = np.sqrt(at[1:] * at[:-1]) if log else (at[1:] + at[:-1]) / 2
    edges = np.concatenate([at[:1], middle, at[-1:]])
    best, hover = int(np.where(ok, data["score"], -1.0).argmax()), _hover(data)
    figure = make_subplots(2, 2, subplot_titles=[label for _, label, _ in QUANTITIES.values()], vertical_spacing=0.13)
    half = NORMAL_95 * data["peak_sensitivity_se"]
    for p, name in enumerate(QUANTITIES):
        panel = {"row": p // 2 + 1, "col": p % 2 + 1}
        y = _shown(data, name)
        if name in ("stiffness", "damping"):
            ends = [_shown(data, f"{name}_{end}", name) for end in ("low", "high")]
            figure.add_trace(shaded(at, *ends, COLOURS[0]), **panel)
        if name == "peak_sensitivity":
            figure.add_trace(shaded(at, y - half, y + half, COLOURS[0]), **panel)
            figure.update_yaxes(range=[0, min(1.1 * np.nanmax(y + half), 2 * WORST_SENSITIVITY)], **panel)
            mark_iso_zones(figure, **panel)
        trace = {"x": at, "y": y, "customdata": hover["customdata"], "hovertemplate": _templates(sets)[0]}
        figure.add_trace(go.Scatter(**trace, mode="lines+markers", line={"color": COLOURS[0]}), **panel)
        marker = {"symbol": "star", "size": 15, "color": STAR}
        figure.add_trace(go.Scatter(x=at[[best]], y=y[[best]], marker=marker, hoverinfo="skip"), **panel)
        for i in np.flatnonzero(~ok):
            grey = {"fillcolor": INFEASIBLE, "line_width": 0, "layer": "below"}
            figure.add_vrect(float(edges[i]), float(edges[i + 1]), **grey, **panel)
        for i in np.flatnonzero(ok[1:] != ok[:-1]):
            figure.add_vline(float(middle[i]), line={"color": "black", "width": 4}, name="stability border", **panel)
    figure.update_xaxes(**_axis(data, x)).update_layout(showlegend=False)
    return styled(figure, 760)


def best_bands(sets: SweptSets, rows: Sequence[Mapping[str, Any]]) -> "Figure":
    """Stiffness and damping in the sliding bands of a few gain sets with 95 % bands."""
    from plotly.graph_objects import Scatter
    from plotly.subplots import make_subplots

    units = {"stiffness": "kN/m", "damping": "N s/m"}
    figure = styled(make_subplots(1, 2, subplot_titles=[QUANTITIES[name][1] for name in units]), 440)
    centre = (sets["band_low"] + sets["band_high"]) / 2
    chosen = np.array([row["experiment"] for row in rows])
    for col, (name, unit) in enumerate(units.items(), 1):
        value, half = (sets.in_bands(v, chosen) * QUANTITIES[name][0] for v in (f"band_{name}", f"band_{name}_se"))
        low, high = np.nanpercentile(value, [8, 97])
        pad = 0.3 * (high - low) + 0.05 * abs(high)
        figure.update_yaxes(range=[low - pad, high + pad], row=1, col=col)
        for i, (row, colour, dash) in enumerate(zip(rows, COLOURS, ("solid", "dash", "dot"), strict=False)):
            gains = ", ".join(f"{g} {number(row['gains'][g] * sets.shown[g][0])}" for g in shown_gains(sets))
            reach = NORMAL_95 * half[i]
            figure.add_trace(
                shaded(centre, value[i] - reach, value[i] + reach, colour, legendgroup=gains), row=1, col=col
            )
            text = f"%{{x:g}} Hz: %{{y:.4g}} ± %{{customdata:.2g}} {unit}<extra>{i + 1}</extra>"
            trace = {"name": f"{i + 1}: {gains}", "legendgroup": gains, "showlegend": col == 1, "hovertemplate": text}
            line = {"color": colour, "dash": dash}
            figure.add_trace(Scatter(x=centre, y=value[i], customdata=reach, line=line, **trace), row=1, col=col)
    figure.update_xaxes(title_text="centre of the band in Hz")
    return figure.update_layout(legend={"orientation": "h", "y": -0.2})
