"""Figures of a study: the score of every experiment, and where the gains lie that were tried."""

from typing import TYPE_CHECKING

import numpy as np

from maglev_env.task.pump_goal import RotorGoalTask
from maglev_env.task.task import Task
from maglev_workbench.commands.tune.advised import gains_in_words
from maglev_workbench.page import COLOURS, STAR, labelled_axis, styled
from tuning.study.recommendation import Recommendation
from tuning.study.study import Outcome

if TYPE_CHECKING:
    from plotly.graph_objects import Figure

ABREAST = 3  # pairs of gains beside each other


def course_figure(task: Task, found: Outcome) -> "Figure":
    """Score of every experiment in order with its gains on hover, and the best so far."""
    import plotly.graph_objects as go

    t, text = found.trials, _hover(task, found)
    at = np.arange(1, len(t) + 1)
    figure = go.Figure()
    figure.add_scatter(x=at, y=t.score, mode="markers", name="experiment", marker={"color": COLOURS[0]},
                       text=text, hoverinfo="text")  # fmt: skip
    figure.add_scatter(
        x=at, y=np.maximum.accumulate(t.score), mode="lines", name="best so far",
        line={"color": COLOURS[1], "shape": "hv"},
    )  # fmt: skip
    down = np.flatnonzero(t.touchdown)
    marker = {"symbol": "x", "color": STAR, "size": 10}
    shown = {"name": "touchdown", "marker": marker, "text": [text[i] for i in down], "hoverinfo": "text"}
    figure.add_scatter(x=at[down], y=t.score[down], mode="markers", **shown)
    figure.update_xaxes(title_text="experiment")
    figure.update_yaxes(title_text="score", range=[-0.03, 1.03])
    return styled(figure, 380)


def _hover(task: Task | RotorGoalTask, found: Outcome) -> list[str]:
    """What every experiment was and gave, for its points."""
    t = found.trials
    return [
        f"experiment {i + 1}: score {score:.3f}<br>{gains_in_words(task, point).replace(', ', '<br>')}"
        for i, (point, score) in enumerate(zip(t.points, t.score, strict=True))
    ]


def where_figure(task: Task | RotorGoalTask, found: Outcome, advice: Recommendation) -> "Figure":
    """Scatter plots of each pair of tried gains, coloured by score; a star marks the recommended ones."""
    import plotly.graph_objects as go
    from plotly.subplots import make_subplots

    names, gains, t = task.box.names, task.box.gains(found.trials.points), found.trials
    text, titles = (
        _hover(task, found),
        [f"{name}, {unit}".removesuffix(", ") for name, unit in zip(task.box.names, task.box.units, strict=True)],
    )
    pairs = [(a, b) for a in range(len(names)) for b in range(a + 1, len(names))] or [(0, 0)]
    columns = min(len(pairs), ABREAST)
    rows = -(-len(pairs) // columns)
    figure = make_subplots(rows, columns, horizontal_spacing=0.1, vertical_spacing=0.25 / rows)
    for i, (a, b) in enumerate(pairs):
        row, column = i // columns + 1, i % columns + 1
        marker = {"color": t.score, "colorscale": "Viridis", "cmin": 0, "cmax": 1, "showscale": i == len(pairs) - 1}
        marker["colorbar"] = {"title": {"text": "score"}}
        figure.add_trace(
            go.Scatter(
                x=gains[:, a], y=gains[:, b], mode="markers", marker=marker, showlegend=False, text=text,
                hoverinfo="text",
            ), row, column,
        )  # fmt: skip
        if advice.chosen:
            g = task.box.gains(advice.chosen.point)
            star = {"symbol": "star", "size": 15, "color": STAR}
            chosen = {"text": f"recommended<br>{gains_in_words(task, advice.chosen.point)}", "hoverinfo": "text"}
            figure.add_trace(
                go.Scatter(x=[g[a]], y=[g[b]], mode="markers", marker=star, showlegend=False, **chosen), row, column
            )
        for axis, j in ((figure.update_xaxes, a), (figure.update_yaxes, b)):
            axis(**labelled_axis(titles[j], gains[:, j], bool(task.box.log[j])), row=row, col=column)
    return styled(figure, 380 * rows)
