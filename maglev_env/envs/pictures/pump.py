"""A picture of a spinning rotor's episode: the last run-up, what was identified, and the scores so far."""

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from maglev_env.envs.pictures.frames import (
    BLUE,
    DISPLACEMENT_LIMITS,
    DPI,
    GREEN,
    LEFT,
    LOWER,
    ORANGE,
    RED,
    RIGHT,
    SIZE,
    SMALL,
    UPPER,
    WALL,
    ZONES,
    History,
    draw_heading,
    draw_scores,
    panel,
    put_axis,
    put_title,
)
from maglev_env.rotor.identification import MODES
from maglev_env.task.pump import RotorTask
from maglev_env.task.pump_episodes import RotorEpisode


def rotor_figure(task: RotorTask, episode: RotorEpisode, history: History) -> Figure:
    """The picture as a figure; its axes are labelled motion, current, identified and tried."""
    info = history[-1][1]
    figure = Figure(figsize=SIZE, dpi=DPI, facecolor="white")
    draw_heading(figure, task, history)
    _draw_run_up(panel(figure, "motion", LEFT, UPPER), task, episode, info)
    _draw_current(panel(figure, "current", RIGHT, UPPER), task, info)
    _draw_identified(panel(figure, "identified", LEFT, LOWER), task, info)
    draw_scores(panel(figure, "tried", RIGHT, LOWER), task, history)
    return figure


def _ladder(task: RotorTask) -> tuple[np.ndarray, np.ndarray, tuple[float, float]]:
    """Indices that sort the speeds, the sorted speeds (krpm), and the limits of their axis."""
    speeds = np.array(task.layout.speeds) / 1000
    order = speeds.argsort()
    low, high = speeds.min(), speeds.max()
    room = 0.03 * (high - low) or 1.0
    return order, speeds[order], (low - room, high + room)


def _draw_run_up(axes: Axes, task: RotorTask, episode: RotorEpisode, info: dict) -> None:
    """Peak displacement at both planes over the speed, on the zones of ISO 14839-2."""
    order, speeds, ends = _ladder(task)
    wall = episode.rotor.axis.clearance * 1e6
    low = 1e-3 * wall
    for zone, start, stop in zip("ABCD", (0.0, *DISPLACEMENT_LIMITS), (*DISPLACEMENT_LIMITS, 1.0), strict=True):
        axes.axhspan(max(start * wall, low), stop * wall, color=ZONES[zone], lw=0)
    axes.axhspan(wall, 1.4 * wall, color=WALL, lw=0)
    shown = np.clip(info["peak"][order] * 1e6, low, wall)
    for plane, colour in zip("ab", (BLUE, ORANGE), strict=True):
        axes.plot(speeds, shown[:, "ab".index(plane)], "o-", color=colour, ms=3.5, lw=1.2, label=f"plane {plane}")
    down = "touchdown_speed" in info
    if down:
        axes.plot(info["touchdown_speed"] / 1000, wall, "X", color=RED, ms=12, mec="white", zorder=4)
    put_axis(axes, "x", ends, "speed / krpm")
    put_axis(axes, "y", (low, 1.4 * wall), "peak displacement / µm", log=True)
    axes.legend(fontsize=SMALL, loc="lower right", frameon=False)
    if down:
        put_title(axes, f"Run-up: touchdown at {info['touchdown_speed']:g} rpm", RED)
    else:
        put_title(axes, f"Run-up: peak {info['peak_displacement'] * 1e6:.3g} µm, zone {info['displacement_zone']}")


def _draw_current(axes: Axes, task: RotorTask, info: dict) -> None:
    order, speeds, ends = _ladder(task)
    current = info["coil_rms"][order].max(axis=1)
    limit = task.layout.target.current_limit
    axes.plot(speeds, current, "o-", color=BLUE, ms=3.5, lw=1.2)
    axes.axhline(limit, color=GREEN, lw=1.4, ls="--", label=f"limit {limit:g} A")
    put_axis(axes, "x", ends, "speed / krpm")
    put_axis(axes, "y", (0.0, 1.1 * max(limit, current.max())), "largest coil current, rms / A")
    axes.legend(fontsize=SMALL, loc="upper left", frameon=False)
    put_title(axes, f"Coils: {info['current_rms']:.3g} A at most")


def _draw_identified(axes: Axes, task: RotorTask, info: dict) -> None:
    """Stiffness and damping over those of the preset gains, per speed and mode."""
    target, labels, known = task.layout.target, [], [1.0]
    axes.axhline(1.0, color=GREEN, lw=1.4, ls="--")
    for name, colour, shift in (("stiffness", BLUE, -0.1), ("damping", ORANGE, 0.1)):
        wanted = np.ravel(getattr(target, name))
        keys = task.layout.identified(name)
        at = [i for i, key in enumerate(keys) if key in info]
        ratio = np.array([info[keys[i]] / wanted[i] for i in at])
        axes.plot(np.array(at) + shift, ratio, "D", color=colour, mec="black", ms=6, label=name)
        known += list(ratio)
    labels = [f"{mode}\n{speed:g} rpm" for speed in task.layout.id_speeds for mode in MODES]
    put_axis(axes, "y", (min(0.0, *known), 1.1 * max(2.0, *known)), "over that of the preset gains")
    axes.set_xlim(-0.5, len(labels) - 0.5)
    axes.set_xticks(range(len(labels)), labels)
    axes.legend(fontsize=SMALL, loc="upper right", frameon=False, ncols=2)
    if "peak_sensitivity" in info:
        worst = f"peak sensitivity {info['peak_sensitivity']:.3g}, zone {info['sensitivity_zone']}"
        put_title(axes, f"Identified: {worst}")
    else:
        put_title(axes, "Identified: not everywhere", RED)
