"""Score on the twin and peak sensitivity of every case, before and after the diagnosis."""

from collections.abc import Sequence
from math import isfinite
from typing import TYPE_CHECKING

import numpy as np

from maglev_workbench.page import COLOURS, ISO_LIMITS, styled
from sim2real.blind.judging.worth import CORRECTED, NOMINAL, PRESET, SIMULATORS, TWIN, CaseWorth

if TYPE_CHECKING:
    from plotly.graph_objects import Figure

NAMES = (PRESET, *SIMULATORS)
WORDS = {PRESET: "preset gains", NOMINAL: "nominal simulator", CORRECTED: "corrected simulator", TWIN: "twin itself"}
PALETTE = {PRESET: "#999999", NOMINAL: COLOURS[1], CORRECTED: COLOURS[0], TWIN: COLOURS[2]}
SYMBOLS = {PRESET: "x-thin-open", NOMINAL: "circle", CORRECTED: "circle", TWIN: "diamond-open"}
HIGHEST = 8.0  # largest peak |S| in the plot; larger ones, and loops that fail, are drawn at this value


def before_after_figure(cases: Sequence[CaseWorth]) -> "Figure":
    """A bar per case from the score with the nominal simulator's gains to that with the corrected one's.

    The case with the largest improvement is on top.
    """
    from plotly.subplots import make_subplots

    ordered = sorted(cases, key=lambda c: c.by[CORRECTED].score - c.by[NOMINAL].score)
    labels = [f"{c.truth} ({c.id}{'' if c.right else ', not named'})" for c in ordered]
    figure = make_subplots(1, 2, shared_yaxes=True, horizontal_spacing=0.04)
    for column, value in enumerate((_score, _peak), 1):
        of = {name: [value(c, name) for c in ordered] for name in NAMES}
        ends = np.array([of[NOMINAL], of[CORRECTED], np.full(len(ordered), np.nan)]).T.ravel()
        bar = {"mode": "lines", "line": {"color": "#bbb", "width": 3}, "hoverinfo": "skip", "showlegend": False}
        figure.add_scatter(x=ends, y=[label for label in labels for _ in range(3)], row=1, col=column, **bar)
        for name in NAMES:
            mark = {"color": PALETTE[name], "symbol": SYMBOLS[name], "size": 10, "line": {"width": 2}}
            shown = {"mode": "markers", "marker": mark, "legendgroup": name, "showlegend": column == 1}
            words = WORDS[name] if name == PRESET else f"tuned on the {WORDS[name]}"
            figure.add_scatter(x=of[name], y=labels, name=words, row=1, col=column, **shown)
    for limit in ISO_LIMITS:
        figure.add_vline(limit, row=1, col=2, line={"color": "#666", "width": 1, "dash": "dash"})
    figure.update_xaxes(title_text="score on the twin", range=[-0.03, 1.03], col=1)
    figure.update_xaxes(title_text=f"peak |S| (at {HIGHEST:g}: more, or the loop fails)", col=2)
    figure.update_layout(legend={"orientation": "h", "y": 1.0, "yanchor": "bottom"})
    return styled(figure, 170 + 26 * len(ordered))


def _score(c: CaseWorth, name: str) -> float:
    return c.by[name].score


def _peak(c: CaseWorth, name: str) -> float:
    r = c.by[name]
    return HIGHEST if r.failures or not isfinite(r.peak_sensitivity) else min(r.peak_sensitivity, HIGHEST)
