"""One picture of an episode: orbit, coefficients, sensitivity against the ISO zones, and the gains tried."""

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from matplotlib import colormaps
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Circle

from estimation.iso_14839 import iso_14839_3_zone
from estimation.normal import NORMAL_95
from maglev_env.envs.pictures.frames import (
    BAR,
    BAR_AT,
    BLUE,
    DPI,
    GREEN,
    GREY,
    HALVES,
    LEFT,
    LOWER,
    NORMAL,
    ORANGE,
    RED,
    RIGHT,
    SCORES,
    SIZE,
    SMALL,
    UPPER,
    WALL,
    ZONES,
    History,
    draw_heading,
    draw_scores,
    draw_tries,
    panel,
    plain,
    put_axis,
    put_title,
)
from maglev_env.experiment import Experiment, recorded_channels
from maglev_env.kernel.simulate import simulate_records
from maglev_env.linear.loop import loop_response
from maglev_env.loop.axes import suffixes
from maglev_env.rig.excitation import lines_at
from maglev_env.task.episodes import Episode
from maglev_env.task.task import Task

COEFFICIENTS = {"stiffness": (1e-3, "N/mm"), "damping": (1.0, "N s/m")}
SENSITIVITY_LIMITS, SENSITIVITY_TOP = (3.0, 4.0, 5.0), 6.5  # ISO 14839-3; a fixed scale keeps frames comparable


def episode_figure(task: Task, episode: Episode, history: History) -> Figure:
    """The picture as a figure; its axes are labelled motion, stiffness, damping, sensitivity and tried."""
    action, info = history[-1]
    experiment = task.experiment(episode, task.box.gains(action), len(history) - 1)
    figure = Figure(figsize=SIZE, dpi=DPI, facecolor="white")
    draw_heading(figure, task, history)
    motion = _draw_orbit if experiment.rig.axes == 2 else _draw_motion
    motion(panel(figure, "motion", LEFT, UPPER), experiment, info)
    pair = [panel(figure, name, RIGHT, place) for name, place in zip(COEFFICIENTS, HALVES, strict=True)]
    _draw_coefficients(pair, task, episode, info)
    _draw_sensitivity(panel(figure, "sensitivity", LEFT, LOWER), experiment, episode, info)
    if {"kp", "kd"} <= set(task.box.names):
        _draw_gains(panel(figure, "tried", (RIGHT[0], 0.925), LOWER), task, history)
    else:
        draw_scores(panel(figure, "tried", RIGHT, LOWER), task, history)
    return figure


def _motion(e: Experiment, info: dict[str, Any]) -> tuple[np.ndarray, np.ndarray]:
    """Time (n,) in s and displacement (axes, n) in µm, from rest to the end of the first period or to the touchdown.

    The displacement is the probe's reading, or with self-sensing the rotor's true position.
    """
    down, rate, axes = "touchdown_time" in info, e.recorded_rate, e.rig.axes
    periods = int(info.get("touchdown_time", 0.0) * e.fundamental) + 1
    # Only the displacement's noise affects the rotor. That of the other channels is not simulated, which saves time.
    rig = replace(e.rig, noise=replace(e.rig.noise, force=0.0, current=0.0))
    record = simulate_records([replace(e, rig=rig, periods=periods, transient_periods=0)], threads=1)[0]
    names = recorded_channels(e)
    shown = names.index("position" if "position" in names else "displacement")
    displacement = record.reshape(len(names), axes, -1)[shown] * 1e6
    known = max(1, int(np.isfinite(displacement[0]).sum()))
    displacement = np.nan_to_num(displacement[:, :known])  # an unknown first sample: the rotor is at rest
    if down:  # the rotor reaches the wall within the sample after the last reading
        last, length = displacement[:, -1:], np.linalg.norm(displacement[:, -1])
        wall = (last / length if length else np.eye(axes)[:, :1]) * e.rig.clearance * 1e6
        displacement = np.append(displacement, wall, axis=1)
    return np.arange(known + down) / rate, displacement


def _motion_title(axes: Axes, e: Experiment, info: dict[str, Any]) -> None:
    if "touchdown_time" in info:
        put_title(axes, f"Rotor in its bore: touchdown after {plain(info['touchdown_time'])} s", RED)
        return
    peak, clearance = info["peak_displacement"], e.rig.clearance
    put_title(axes, f"Rotor in its bore: peak {peak * 1e6:.3g} µm, {peak / clearance:.0%} of clearance")


def _magnification(largest: float, room: float) -> int:
    """The largest factor of 1, 2, 5, 10, ..., with which a motion fits into the available space."""
    return max([1, *(f for f in (2, 5, 10, 20, 50, 100) if f * largest <= room)])


def _draw_motion(axes: Axes, e: Experiment, info: dict[str, Any]) -> None:
    """Displacement of one axis over time between the walls; a small one is also drawn magnified above.

    Zones of ISO 14839-2 are for operating vibration, and here an excitation moves the rotor.
    """
    time, (y,) = _motion(e, info)
    wall, end = e.rig.clearance * 1e6, time[-1] * (1.06 if "touchdown_time" in info else 1.0)
    for side in (-wall, wall):
        axes.axhspan(side, side * 1.1, color=WALL, lw=0)
    axes.plot(time, y, color=BLUE, lw=0.8)
    factor = _magnification(np.abs(y).max(), 0.3 * wall)
    if "touchdown_time" in info:
        axes.plot(time[-1], y[-1], "X", color=RED, ms=12, mec="white")
    elif factor > 1:
        axes.axhspan(0.3 * wall, wall, color="white", lw=0)
        axes.plot(time, factor * y + 0.65 * wall, color=BLUE, lw=0.8)
        plate = {"facecolor": "white", "lw": 0, "pad": 1}
        axes.text(0.01 * end, 0.96 * wall, f"× {factor}", fontsize=NORMAL, va="top", bbox=plate)
    put_axis(axes, "x", (0.0, end), "time / s")
    put_axis(axes, "y", (-1.1 * wall, 1.1 * wall), "displacement / µm")
    _motion_title(axes, e, info)


def _draw_orbit(axes: Axes, e: Experiment, info: dict[str, Any]) -> None:
    """Displacement y over x inside the clearance circle; a small one is also drawn magnified beside it."""
    _, (x, y) = _motion(e, info)
    wall = e.rig.clearance * 1e6
    axes.set_facecolor(WALL)
    axes.add_patch(Circle((0, 0), wall, facecolor="white", lw=0))
    axes.plot(x, y, color=BLUE, lw=0.6)
    put_axis(axes, "x", (-wall, wall), "x / µm")
    put_axis(axes, "y", (-1.1 * wall, 1.1 * wall), "y / µm")
    shape = (LEFT[1] - LEFT[0]) * SIZE[0] / ((UPPER[1] - UPPER[0]) * SIZE[1])
    left, width = -1.1 * wall, 2.2 * wall * shape  # equal scales in x and y
    factor = _magnification(np.hypot(x, y).max(), 0.5 * wall)
    if "touchdown_time" in info:
        axes.plot(x[-1], y[-1], "X", color=RED, ms=12, mec="white")
        left = -width / 2
    elif factor > 1:
        axes.add_patch(Circle((1.65 * wall, 0), 0.52 * wall, facecolor="white", edgecolor=GREY, lw=0.8))
        axes.plot(factor * x + 1.65 * wall, factor * y, color=BLUE, lw=0.6)
        axes.text(1.65 * wall, 0.6 * wall, f"× {factor}", fontsize=NORMAL, ha="center")
    axes.set_xlim(left, left + width)
    axes.xaxis.label.set_x(-left / width)
    _motion_title(axes, e, info)


def _draw_coefficients(pair: Sequence[Axes], task: Task, episode: Episode, info: dict[str, Any]) -> None:
    """Stiffness above damping: per band, and in the target band beside the target, all with 95 % error bars."""
    bands, band = task.layout.bands, task.rig.target.band
    for axes, name, (scale, unit) in zip(pair, COEFFICIENTS, COEFFICIENTS.values(), strict=True):
        target = getattr(episode.target, name) * scale
        axes.axvspan(*band, color="#E3E3E3", lw=0)
        axes.axhline(target, color=GREEN, lw=1.4, ls="--", label="target")
        known = [target]
        if f"band_{name}" in info:
            values = info[f"band_{name}"] * scale
            errors = NORMAL_95 * info.get(f"band_{name}_se", np.full(len(bands), np.nan)) * scale
            axes.hlines(values, *bands.T, color=BLUE, lw=0.8)
            axes.errorbar(bands.mean(axis=1), values, errors, fmt="o", color=BLUE, ms=3.5, lw=1.2, capsize=3,
                          label="per band, ±1.96 se")  # fmt: skip
            known = [*known, *values]
        if name in info:
            value, low, high = (info.get(key, np.nan) * scale for key in (name, f"{name}_low", f"{name}_high"))
            axes.errorbar(np.mean(band), value, [[value - low], [high - value]], fmt="D", color=ORANGE, mec="black",
                          ms=6, lw=1.2, capsize=3, label="in target band")  # fmt: skip
            known = [*known, value]
        if len(known) == 1:
            axes.text(0.5, 0.2, "no estimate", transform=axes.transAxes, ha="center", fontsize=NORMAL, color=RED)
        put_axis(axes, "x", (0.0, max(bands[-1, 1], band[1]) * 1.02), "frequency / Hz" if axes is pair[-1] else "")
        # A very long error bar would compress the other values, so it may extend beyond the panel.
        room = 0.5 * np.ptp(known) or 0.5 * target
        put_axis(axes, "y", (min(known) - room, max(known) + room), f"{name} / {unit}")
    pair[0].tick_params(labelbottom=False)
    pair[0].legend(fontsize=SMALL, loc="lower right", bbox_to_anchor=(1.01, 0.97), ncols=3, frameon=False,
                   handlelength=1.5, columnspacing=1.0, handletextpad=0.4)  # fmt: skip
    put_title(pair[0], "Worse axis" if task.rig.axes == 2 else "Identified")


def _draw_sensitivity(axes: Axes, e: Experiment, episode: Episode, info: dict[str, Any]) -> None:
    """|S| of the linearised loop over the injection lines, its measured peak, and the zones of ISO 14839-3."""
    low, high = lines_at(e.excitations, "current")[[0, -1]] * e.fundamental
    ends = (*SENSITIVITY_LIMITS, SENSITIVITY_TOP)
    for zone, start, stop in zip("ABCD", (0.0, *SENSITIVITY_LIMITS), ends, strict=True):
        axes.axhspan(start, stop, color=ZONES[zone], lw=0)
        axes.text(0.015, (start + stop) / 2, zone, transform=axes.get_yaxis_transform(), fontsize=NORMAL, color=GREY,
                  va="center", weight="bold")  # fmt: skip
    stable = info["pole_radius"] < 1
    frequency = np.union1d(np.geomspace(low, high, 200), info.get("peak_frequency", low))
    found = np.abs(loop_response(e, frequency).sensitivity).reshape(len(frequency), e.rig.axes, -1)
    for axis, suffix in enumerate(suffixes(e.rig.axes)):
        style = {"color": (BLUE, ORANGE)[axis], "ls": ("-", "--")[axis]} if stable else {"color": GREY, "ls": ":"}
        name = f"linearised loop {suffix[1:]}".strip() + ("" if stable else ", unstable")
        axes.plot(frequency, found[:, axis, axis], lw=1.4, **style, label=name)
    target = episode.target.peak_sensitivity
    axes.axhline(target, color=GREEN, lw=1.4, ls="--", label=f"target {target:g}")
    if "peak_sensitivity" in info:
        peak, at = info["peak_sensitivity"], info["peak_frequency"]
        style = {"marker": "o" if peak <= SENSITIVITY_TOP else "^", "color": RED, "mec": "white", "ms": 9}
        axes.plot(at, min(peak, SENSITIVITY_TOP), ls="", **style, clip_on=False, zorder=4, label="measured peak")
        put_title(axes, f"Sensitivity |S|: peak {peak:.3g} at {at:.3g} Hz, zone {iso_14839_3_zone(peak)}")
    else:
        put_title(axes, "Sensitivity |S|: not measured" + ("" if stable else ", the loop is unstable"), RED)
    put_axis(axes, "x", (low, high), "frequency / Hz", log=True)
    put_axis(axes, "y", (0.0, SENSITIVITY_TOP), "")
    axes.legend(fontsize=SMALL, loc="upper right", frameon=False)


def _draw_gains(axes: Axes, task: Task, history: History) -> None:
    for which, name in (("x", "kp"), ("y", "kd")):
        i = task.box.names.index(name)
        ends = task.box.low[i], task.box.high[i]
        put_axis(axes, which, ends, f"{name} / {task.box.units[i]}", log=bool(task.box.log[i]))
    draw_tries(axes, *np.array([[info["kp"], info["kd"]] for _, info in history]).T, history)
    bar = colormaps[SCORES](np.linspace(0, 1, BAR[1]))
    axes.figure.figimage(np.repeat(bar[:, None], BAR[0], axis=1), *BAR_AT, origin="lower")
    for height, label in ((0.0, "0"), (0.5, "score"), (1.0, "1")):
        axes.text(1.08, height, label, transform=axes.transAxes, fontsize=SMALL, va="center",
                  rotation=90 * (height == 0.5))  # fmt: skip
