"""Common parts of the pictures of episodes: panels, axes, heading, tried gains, sizes and colours."""

from collections.abc import Sequence
from textwrap import wrap
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from maglev_env.task.task import TOUCHDOWN_REWARD, Tuning

History = Sequence[tuple[np.ndarray, dict[str, Any]]]

SIZE, DPI = (9.6, 7.2), 100  # inches and dots per inch: 720 x 960 px
LEFT, RIGHT = (0.075, 0.475), (0.58, 0.98)  # panels, as shares of the figure
UPPER, LOWER = (0.51, 0.86), (0.07, 0.41)
HALVES = ((0.70, 0.86), (0.51, 0.67))
BAR, BAR_AT = (10, 245), (902, 50)  # colour bar of the scores: width and height, left and bottom, px
BLUE, ORANGE, GREEN, RED, GREY, WALL = "#0072B2", "#E69F00", "#009E73", "#D00000", "#555555", "#BBBBBB"
ZONES = {"A": "#E1F3E7", "B": "#FAF6D2", "C": "#FDE8CE", "D": "#FADDDA"}
DISPLACEMENT_LIMITS = (0.3, 0.4, 0.5)  # ISO 14839-2, of the clearance
SCORES = "viridis"
NO_BREAK = "\u00a0"
SMALL, NORMAL, LARGE = 7.5, 9, 13  # points


def panel(figure: Figure, label: str, across: tuple[float, float], up: tuple[float, float]) -> Axes:
    axes = figure.add_axes((across[0], up[0], across[1] - across[0], up[1] - up[0]), label=label)
    axes.tick_params(labelsize=SMALL)
    return axes


def put_title(axes: Axes, text: str, colour: str = "black") -> None:
    axes.set_title(text, fontsize=NORMAL, loc="left", y=1.02, color=colour)


def put_axis(axes: Axes, which: str, ends: tuple[float, float], label: str, log: bool = False) -> None:
    """Set limits, scale, label and a few ticks of the x or y axis; drawing ticks takes most of the time of a frame."""
    if log:
        decades = 10.0 ** np.arange(np.floor(np.log10(ends[0])), np.log10(ends[1]))
        steps = (1.0, 2.0, 5.0) if ends[1] < 100 * ends[0] else (1.0,)
        ticks = np.ravel(np.outer(decades, steps))
        axes.set(**{f"{which}scale": "log"})
    else:
        ticks = MaxNLocator(5, steps=[1, 2, 2.5, 5, 10]).tick_values(*ends)
    ticks = ticks[(ticks >= ends[0]) & (ticks <= ends[1])]
    axis = getattr(axes, f"{which}axis")
    axis.set_ticks([], minor=True)
    axis.set_ticks(ticks, [f"{tick:.6g}".replace("-", "−") for tick in ticks])
    axes.set(**{f"{which}lim": ends})
    axis.set_label_text(label, fontsize=SMALL)


def plain(value: float) -> str:
    return np.format_float_positional(value, precision=4, fractional=False, trim="-")


def draw_heading(figure: Figure, task: Tuning, history: History) -> None:
    count, info = len(history) - 1, history[-1][1]
    down, feasible = "touchdown_time" in info, info["feasible"]
    which = f"experiment {count} of {task.budget}" if count else f"start, before {task.budget} experiments"
    result = "touchdown" if down else f"score {info['score']:.3f}" if feasible else "unstable loop"
    gains = [f"{name} = {plain(info[name])} {unit}" for name, unit in zip(task.box.names, task.box.units, strict=True)]
    rows = wrap(",  ".join(gain.replace(" ", NO_BREAK) for gain in gains), 92)
    reward = f"reward: score; unstable 0; touchdown {TOUCHDOWN_REWARD:g}".replace("-", "−")
    big, small = {"fontsize": LARGE, "weight": "bold"}, {"fontsize": NORMAL, "color": GREY}
    figure.text(LEFT[0], 0.955, f"{task.name}: {which}", **big, parse_math=False)  # a name may hold dollars
    figure.text(RIGHT[1], 0.955, result, **big, ha="right", color="black" if feasible else RED)
    fine = small if len(rows) == 1 else small | {"fontsize": SMALL}
    for i, row in enumerate(rows):
        figure.text(LEFT[0], 0.922 - 0.022 * i, row.replace(NO_BREAK, " "), **fine)
    figure.text(RIGHT[1], 0.922, reward, **small, ha="right")


def draw_scores(axes: Axes, task: Tuning, history: History) -> None:
    put_axis(axes, "x", (-0.5, max(task.budget, 4) + 0.5), "experiment")
    put_axis(axes, "y", (0.0, 1.0), "score")
    draw_tries(axes, np.arange(len(history)), np.array([info["score"] for _, info in history]), history)


def draw_tries(axes: Axes, x: np.ndarray, y: np.ndarray, history: History) -> None:
    """Draw tries at x, y (n,) in their order, coloured by score: a ring marks the last one, crosses mark touchdowns."""
    scores = np.array([info["score"] for _, info in history])
    down = np.array(["touchdown_time" in info for _, info in history])
    axes.plot(x, y, color=WALL, lw=0.8, zorder=1)
    over = {"clip_on": False, "zorder": 3}
    axes.scatter(x[~down], y[~down], 45, scores[~down], cmap=SCORES, vmin=0, vmax=1, **over)
    axes.scatter(x[down], y[down], 45, RED, marker="x", **over)
    axes.scatter(x[-1], y[-1], 160, facecolor="none", edgecolor="black", lw=1.5, **over)
    best = int(scores.argmax())
    which = f"best score {scores[best]:.3f}, {f'experiment {best}' if best else 'start'}"
    put_title(axes, f"Tried so far: {which if scores[best] > 0 else 'none scores'}")
