"""Reliability plots of the stated probabilities, for the page and for the markdown."""

from pathlib import Path
from typing import TYPE_CHECKING

from maglev_env.recordings.files import atomic_file
from maglev_workbench.page import COLOURS, styled
from sim2real.blind.judging.calibration import Reliability

if TYPE_CHECKING:
    from plotly.graph_objects import Figure

STATED, RIGHT = "stated probability of the most probable hypothesis", "share right"


def reliability_figure(r: Reliability) -> "Figure":
    """Share of right answers over stated probability, with the number of campaigns at each point."""
    import plotly.graph_objects as go

    figure = go.Figure(go.Scatter(x=[0, 1], y=[0, 1], mode="lines", line={"color": "#999", "dash": "dash"}))
    texts = [str(n) for n in r.count]
    marks = {"mode": "lines+markers+text", "textposition": "top left", "marker": {"color": COLOURS[0], "size": 9}}
    figure.add_scatter(x=r.stated, y=r.right, text=texts, line={"color": COLOURS[0]}, **marks)
    figure.update_xaxes(title_text=STATED, range=[0, 1.02]).update_yaxes(title_text=RIGHT, range=[0, 1.05])
    return styled(figure.update_layout(showlegend=False), 460)


def save_reliability(path: Path, r: Reliability) -> None:
    """Write the same plot as a PNG.

    Raises:
        OSError: It cannot be written.
    """
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(5.2, 4.0), dpi=110, layout="constrained")
    FigureCanvasAgg(figure)
    axes = figure.add_subplot()
    axes.plot([0, 1], [0, 1], "--", color="#999999", lw=1)
    axes.plot(r.stated, r.right, "o-", color=COLOURS[0])
    for stated, right, n in zip(r.stated, r.right, r.count, strict=True):
        axes.annotate(str(n), (stated, right), xytext=(-4, 6), textcoords="offset points", ha="right", fontsize=8)
    axes.set(xlabel=STATED, ylabel=RIGHT, xlim=(0, 1.02), ylim=(0, 1.08))
    with atomic_file(path) as file:
        figure.savefig(file, format="png", metadata={"Software": None})  # equal results give equal bytes
