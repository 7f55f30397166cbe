"""Figures of a run-up: response, whirl modes, sensitivity, motor and temperature."""

from math import log10
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from maglev_workbench.page import COLOURS, labelled_axis, mark_iso_zones, styled

if TYPE_CHECKING:
    from plotly.graph_objects import Figure

    from maglev_workbench.commands.runup.study import Report

ZONES = {0.3: "A | B", 0.4: "B | C", 0.5: "C | D"}  # of the clearance, ISO 14839-2
FINE = 141  # points of a curve over the speeds
PLANES = "ab"


def run_up(found: "Report") -> "Figure":
    """Measured peaks and once-per-turn amplitudes beside the linear model, with the zones."""
    from plotly.graph_objects import Figure

    from maglev_workbench.commands.runup.study import readings

    up, speeds = found.result, found.speeds
    grid = _grid(found)
    model = readings(found.rotor, grid) * 1e6
    touched = up.touched_down[0]
    figure = Figure()
    for p, (plane, colour) in enumerate(zip(PLANES, COLOURS, strict=False)):
        line = {"color": colour, "width": 1.6}
        figure.add_scatter(x=grid, y=model[:, p], mode="lines", line=line, name=f"{plane}: linear model")
        for name, values, symbol in (
            ("once per turn", up.once[0, :, p], "circle"),
            ("peak", up.peak[0, :, p], "line-ew-open"),
        ):
            marker = {"color": colour, "symbol": symbol, "size": 7}
            figure.add_scatter(x=speeds, y=values * 1e6, mode="markers", marker=marker, name=f"{plane}: {name}")
    axial = {"color": COLOURS[2], "symbol": "diamond", "size": 7}
    figure.add_scatter(x=speeds, y=up.once[0, :, 2] * 1e6, mode="markers", marker=axial, name="axial reading")
    if touched.any():
        cross = {"color": "black", "symbol": "x", "size": 11}
        at = up.peak[0, touched].max(axis=-1) * 1e6
        figure.add_scatter(x=speeds[touched], y=at, mode="markers", marker=cross, name="touched down")
    clearance = found.rotor.axis.clearance * 1e6
    for i, (share, zones) in enumerate(ZONES.items()):
        figure.add_hline(share * clearance, line={"color": "#666", "width": 1, "dash": "dash"})
        label = {"text": f"{zones} at {share:g} of the clearance", "x": 0.22 * i, "xref": "x domain", "xanchor": "left"}
        font = {"size": 10, "color": "#666"}
        figure.add_annotation(**label, y=log10(share * clearance), yanchor="bottom", showarrow=False, font=font)
    shown = np.concatenate([up.peak[0].ravel(), up.once[0].ravel()]) * 1e6
    low, high = max(shown[shown > 0].min(), 0.1), max(shown.max(), clearance)
    figure.update_yaxes(**labelled_axis("displacement in µm", np.array([low, high]), True))
    figure.update_yaxes(range=[log10(low) - 0.1, log10(high) + 0.1])
    return styled(figure.update_xaxes(title_text="speed in rpm"), 520)


def save_picture(found: "Report", path: Path) -> None:
    """Write the run-up as a static picture, in the format of the path's suffix."""
    from matplotlib.figure import Figure

    from maglev_workbench.commands.runup.study import readings

    up, grid, clearance = found.result, _grid(found), found.rotor.axis.clearance * 1e6
    drawing = Figure(figsize=(8, 4), layout="constrained")
    axes = drawing.subplots()
    for p, (plane, model) in enumerate(zip(PLANES, readings(found.rotor, grid).T * 1e6, strict=True)):
        axes.plot(grid, model, f"C{p}", lw=1, label=f"{plane}: linear model")
        axes.plot(found.speeds, up.once[0, :, p] * 1e6, f"C{p}o", ms=4, label=f"{plane}: once per turn")
        axes.plot(found.speeds, up.peak[0, :, p] * 1e6, f"C{p}_", label=f"{plane}: peak")
    axes.plot(found.speeds, up.once[0, :, 2] * 1e6, "C2d", ms=4, label="axial reading")
    for i, (share, zones) in enumerate(ZONES.items()):
        axes.axhline(share * clearance, color="0.5", lw=0.8, ls="--")
        at = {"x": 0.02 + 0.22 * i, "transform": axes.get_yaxis_transform(), "va": "bottom"}
        axes.text(y=share * clearance, s=f"{zones} at {share:g} of the clearance", fontsize=7, **at)
    axes.set(xlabel="speed in rpm", ylabel="displacement in µm", yscale="log", title=f"Run-up of {found.rotor.name}")
    axes.legend(fontsize="x-small", loc="lower right")
    drawing.savefig(path, dpi=110)


def campbell(found: "Report") -> "Figure":
    """Whirl frequencies over speed, undamped and of the closed loop, with the line of the rotation frequency."""
    from plotly.graph_objects import Figure

    from maglev_workbench.commands.runup.study import damped, whirl

    grid = _grid(found)[:: FINE // 28]
    figure = Figure()
    for direction, colour in (("forward", COLOURS[0]), ("backward", COLOURS[1])):
        values = whirl(found.rotor, grid)
        values = np.sort(np.where((values > 0) == (direction == "forward"), abs(values), np.nan), axis=1)
        for i, column in enumerate(values.T):
            style = {"line": {"color": colour, "width": 2}, "legendgroup": direction, "showlegend": i == 0}
            figure.add_scatter(x=grid, y=column, mode="lines", name=f"undamped, {direction}", **style)
    modes = [(v, *row) for v in grid for row in damped(found.rotor, v)]
    if modes:
        x, y, ratio = np.array(modes).T
        marker = {"color": ratio, "colorscale": "Greys_r", "cmin": 0, "cmax": 1.2, "size": 5}
        hover = "%{x:g} rpm: %{y:.1f} Hz, damping ratio %{customdata:.2f}<extra></extra>"
        style = {"marker": marker, "customdata": ratio, "hovertemplate": hover}
        figure.add_scatter(x=x, y=y, mode="markers", name="closed loop", **style)
    line = {"color": "#666", "dash": "dash"}
    figure.add_scatter(x=grid, y=abs(grid) / 60, mode="lines", line=line, name="speed of rotation")
    figure.update_xaxes(title_text="speed in rpm").update_yaxes(title_text="frequency in Hz", rangemode="tozero")
    return styled(figure, 440)


def sensitivity(found: "Report") -> "Figure":
    """|S| of each controller at the identified speeds, with the zones."""
    from plotly.graph_objects import Figure

    figure, one = Figure(), found.identified
    for i, v in enumerate(found.id_speeds):
        for c, (name, colour) in enumerate(zip(found.rotor.gains, COLOURS, strict=False)):
            line = {"color": colour, "dash": ("solid", "dash")[i]}
            s = abs(one.sensitivity[c][i])
            figure.add_scatter(x=one.frequency[c], y=s, mode="lines", line=line, name=f"{name} at {v:g} rpm")
    mark_iso_zones(figure)
    figure.update_xaxes(**labelled_axis("frequency in Hz", one.frequency[0], True)).update_yaxes(title_text="|S|")
    return styled(figure, 440)


def motor(found: "Report") -> "Figure":
    """Torque, current and copper loss over speed."""
    from plotly.subplots import make_subplots

    labels = {
        "torque": (1e3, "torque in mN m"),
        "current": (1, "current in A, peak"),
        "copper_loss": (1, "copper loss in W"),
    }
    figure = make_subplots(1, 3, subplot_titles=[label for _, label in labels.values()])
    for col, (name, (scale, _)) in enumerate(labels.items(), 1):
        line = {"color": COLOURS[0]}
        figure.add_scatter(x=found.speeds, y=found.motor[name] * scale, line=line, name=name, row=1, col=col)
    grid = _grid(found)
    limit = [1e3 * found.rotor.motor.greatest_torque(abs(v) * np.pi / 30) for v in grid]
    figure.add_scatter(x=grid, y=limit, line={"color": "#666", "dash": "dash"}, name="greatest torque", row=1, col=1)
    figure.update_xaxes(title_text="speed in rpm").update_yaxes(rangemode="tozero")
    return styled(figure.update_layout(showlegend=False), 360)


def temperature(found: "Report") -> "Figure":
    """Rise of the housing over time at the least and the greatest speed."""
    from plotly.graph_objects import Figure

    figure, mass = Figure(), found.rotor.thermal
    time = np.linspace(0, max(7200.0, 3 * mass.time_constant), FINE)
    for at, colour in zip(
        dict.fromkeys((abs(found.speeds).argmin(), abs(found.speeds).argmax())), COLOURS, strict=False
    ):
        rise = mass.temperature(time, float(found.heat[at]), 0.0)
        figure.add_scatter(x=time / 60, y=rise, line={"color": colour}, name=f"{found.speeds[at]:g} rpm")
    figure.update_xaxes(title_text="minutes").update_yaxes(title_text="K above the ambient")
    return styled(figure, 360)


def _grid(found: "Report") -> np.ndarray:
    return np.linspace(found.speeds.min(), found.speeds.max(), FINE)
