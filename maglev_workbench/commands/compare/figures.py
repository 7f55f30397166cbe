"""Plots of a comparison: regret over experiments, performance profiles, probabilities of improvement."""

from typing import TYPE_CHECKING

import numpy as np

from maglev_workbench.commands.compare.numbers import Table
from maglev_workbench.page import COLOURS, shaded, styled
from tuning.comparison.compare import Comparison
from tuning.methods import METHODS, STARTS, split_name

if TYPE_CHECKING:
    from plotly.graph_objects import Figure

PALETTE = ("#999999", *COLOURS, "#CC79A7", "#E69F00", "#56B4E9", "#000000", "#882255")  # Okabe and Ito's, and two
DASHES = ("solid", "dash", "dot", "dashdot", "longdash")
LEAST = 1e-4  # a logarithmic axis has no 0


def course_figure(found: Comparison, of: Table) -> "Figure":
    """Median regret of every tuner over the number of experiments, with its interval."""
    import plotly.graph_objects as go

    figure = go.Figure()
    every = np.array(found.checkpoints)
    for m in found.results:
        x = [n for n in found.checkpoints if (n, m) in of]
        value, low, high = np.maximum([of[n, m].median for n in x], LEAST).T
        colour, line = _style(m)
        figure.add_trace(shaded(x, low, high, colour, opacity=0.12, legendgroup=m))
        figure.add_scatter(x=x, y=value, name=m, mode="lines+markers", line=line, legendgroup=m)
    figure.update_xaxes(
        title_text="experiments on each rig", type="log", tickvals=every, ticktext=[str(n) for n in every]
    )
    figure.update_yaxes(title_text="median simple regret", type="log", exponentformat="power", dtick=1)
    return styled(figure, 480)


def profile_figure(found: Comparison, of: Table, thresholds: np.ndarray) -> "Figure":
    """Share of rigs below a regret, with its interval, a panel per budget."""
    import plotly.graph_objects as go
    from plotly.subplots import make_subplots

    titles = [f"after {n} experiments" for n in found.budgets]
    figure = make_subplots(1, len(titles), shared_yaxes=True, subplot_titles=titles, horizontal_spacing=0.05)
    for column, n in enumerate(found.budgets, 1):
        for m in found.reached(n):
            value, low, high = of[n, m].profile
            colour, line = _style(m)
            figure.add_trace(shaded(thresholds, low, high, colour, opacity=0.12, legendgroup=m), 1, column)
            trace = go.Scatter(
                x=thresholds, y=value, name=m, mode="lines", line=line, legendgroup=m, showlegend=column == 1
            )
            figure.add_trace(trace, 1, column)
    figure.update_xaxes(title_text="regret", type="log", exponentformat="power", dtick=1)
    figure.update_yaxes(range=[-0.02, 1.02])
    figure.update_yaxes(title_text="share of rigs", col=1)
    return styled(figure, 440)


def improvement_figure(found: Comparison, of: Table) -> "Figure":
    """Probability that the row's tuner is better than the column's on a rig, with its interval, a panel per budget."""
    import plotly.graph_objects as go
    from plotly.subplots import make_subplots

    names = list(found.results)
    titles = [f"after {n} experiments" for n in found.budgets]
    panel, gap = 46 * len(names), 80  # px
    inside = len(titles) * (panel + gap) - gap
    figure = make_subplots(len(titles), 1, subplot_titles=titles, vertical_spacing=gap / inside)
    for row, n in enumerate(found.budgets, 1):
        pairs = [[of[n, a].better.get(b) if (n, a) in of else None for b in names] for a in names]
        z = [[np.nan if p is None else p[0] for p in line] for line in pairs]
        text = [["" if p is None else f"{p[0]:.2f}<br>{p[1]:.2f} .. {p[2]:.2f}" for p in line] for line in pairs]
        cells = go.Heatmap(
            x=names, y=names, z=z, text=text, texttemplate="%{text}", zmin=0, zmax=1, colorscale="RdBu",
            showscale=row == 1, hoverinfo="skip",
        )  # fmt: skip
        figure.add_trace(cells, row, 1)
    figure.update_yaxes(autorange="reversed")
    return styled(figure, 110 + inside)


def _style(method: str) -> tuple[str, dict]:
    """Colour and line of a tuner, the same in every comparison."""
    name, start = split_name(method)
    i, starts = list(METHODS).index(name), list(STARTS)
    # A start has lines of its own; of tuners with the same colour, and from the same start, no two are alike.
    dash = i // len(PALETTE) if start is None else 1 + len(METHODS) // len(PALETTE) + starts.index(start)
    colour = PALETTE[i % len(PALETTE)]
    return colour, {"color": colour, "dash": DASHES[dash]}
