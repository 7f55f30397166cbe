"""Figures of x-y identification: the four stiffnesses or dampings over frequency, and the row sums."""

import re
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from maglev_env.evaluation.identification_planar import PlanarIdentification
from maglev_env.units import common_unit
from maglev_workbench.commands.estimate.figures import COEFFICIENTS, Units
from maglev_workbench.page import COLOURS, styled, with_interval

if TYPE_CHECKING:
    from plotly.graph_objects import Figure

ELEMENTS = {"xx": (0, 0), "xy": (0, 1), "yx": (1, 0), "yy": (1, 1)}  # force axis, motion axis
SYMBOLS = {"stiffness": "k", "damping": "c"}
SUMS = ("{0}_xx + r {0}_xy", "{0}_yy + {0}_yx / r")  # the sums that motion along y = r x determines, for real r
_SHADE = "#EEE"


@dataclass(frozen=True)
class _Series:
    """Points of one panel, (bands,), in the panel's unit; good: their intervals are bounded."""

    label: str
    colour: str
    value: np.ndarray
    low: np.ndarray
    high: np.ndarray
    good: np.ndarray


def planar_units(found: PlanarIdentification) -> Units:
    """Units that fit the size of the direct coefficients; where none are known, of the row sums."""
    known, sums = found.estimate.identifiable, found.row_sums
    return {
        name: common_unit(
            getattr(found.estimate, name)[known][:, [0, 1], [0, 1]].ravel()
            if known.any()
            else np.concatenate([getattr(own, name) for s in sums for own in (s.x, s.y)] or [np.zeros(0)]),
            si,
        )
        for name, si in COEFFICIENTS.items()
    }


def coefficient_matrix(found: PlanarIdentification, name: str) -> "Figure":
    """The four elements of "stiffness" or "damping", arranged as in the matrix, with 95 % bars and least squares."""
    from plotly.graph_objects import Scatter

    scale, unit = planar_units(found)[name]
    ml, ls, known = found.estimate, found.least_squares, found.estimate.identifiable
    values, low, high = (scale * getattr(ml, f"{name}{end}") for end in ("", "_low", "_high"))
    titles = [f"{SYMBOLS[name]}<sub>{element}</sub> in {unit}" for element in ELEMENTS]
    series = [[_Series("ML", COLOURS[0], values[:, i, j], low[:, i, j], high[:, i, j], ml.informative)]
              for i, j in ELEMENTS.values()]  # fmt: skip
    centre = found.bands.mean(axis=1)
    figure = _panels(centre, titles, series, [unit] * 4)
    marker = {"symbol": "x-thin-open", "size": 8, "color": COLOURS[1]}
    for p, (i, j) in enumerate(ELEMENTS.values()):
        trace = {"x": centre[known], "y": scale * getattr(ls, name)[known, i, j], "mode": "markers", "marker": marker}
        text = f"%{{x:g}} Hz: %{{y:.4g}} {unit}<extra>least squares</extra>"
        style = {"hovertemplate": text, "name": "least squares", "legendgroup": "LS", "showlegend": p == 0}
        figure.add_trace(Scatter(**trace, **style), row=p // 2 + 1, col=p % 2 + 1)
    for first, last in _runs(~known):
        # Each band extends half-way to the centres of its neighbours.
        edges = np.concatenate([found.bands[:1, 0], (centre[1:] + centre[:-1]) / 2, found.bands[-1:, 1]])
        figure.add_vrect(edges[first], edges[last + 1], fillcolor=_SHADE, line_width=0, layer="below")
    return figure


def row_sum_panels(found: PlanarIdentification, names: Sequence[str]) -> "Figure":
    """Row sums of each recording (its name in names) along its line of motion: stiffness above, damping below."""
    titles, series, units = [], [], []
    for name, (scale, unit) in planar_units(found).items():
        for axis, text in zip("xy", SUMS, strict=True):
            titles.append(re.sub("_(..)", r"<sub>\1</sub>", text.format(SYMBOLS[name])) + f" in {unit}")
            units.append(unit)
            rows = [getattr(sums, axis) for sums in found.row_sums]
            points = [[scale * getattr(row, f"{name}{end}") for end in ("", "_low", "_high")] for row in rows]
            series.append([_Series(label, COLOURS[i % len(COLOURS)], *points[i], rows[i].informative)
                           for i, label in enumerate(names)])  # fmt: skip
    return _panels(found.bands.mean(axis=1), titles, series, units)


def _panels(centre: np.ndarray, titles: list[str], series: list[list[_Series]], units: list[str]) -> "Figure":
    """Four panels of points with bars over the bands' centres, Hz."""
    from plotly.graph_objects import Scatter
    from plotly.subplots import make_subplots

    figure = styled(make_subplots(2, 2, subplot_titles=titles, horizontal_spacing=0.1, vertical_spacing=0.13), 640)
    shown = set()
    for p, (panel, unit) in enumerate(zip(series, units, strict=True)):
        place = {"row": p // 2 + 1, "col": p % 2 + 1}
        bottom, top = _range(panel)
        figure.update_yaxes(range=[bottom, top], **place)
        reach = 2 * (top - bottom)  # replaces infinity: extends beyond the panel
        for one in panel:
            low, high = np.clip(one.low, bottom - reach, one.value), np.clip(one.high, one.value, top + reach)
            known = np.isfinite(one.value)
            for some, opacity, symbol, label in (
                (known & one.good, 1, "circle", one.label),
                (known & ~one.good, 0.4, "circle-open", f"{one.label}, unbounded"),
            ):
                if not some.any():
                    continue
                up, down = high[some] - one.value[some], one.value[some] - low[some]
                bars = {"array": up, "arrayminus": down, "thickness": 1, "width": 2}
                ends = zip(one.value[some], one.low[some], one.high[some], strict=True)
                trace = {"x": centre[some], "y": one.value[some], "text": [with_interval(*each) for each in ends]}
                hover = f"%{{x:g}} Hz: %{{text}} {unit}<extra>{label}</extra>"
                style = {"marker": {"color": one.colour, "symbol": symbol, "size": 6}, "opacity": opacity}
                legend = {"name": label, "legendgroup": label, "showlegend": label not in shown}
                shown.add(label)
                figure.add_trace(
                    Scatter(**trace, **style, **legend, mode="markers", hovertemplate=hover, error_y=bars), **place
                )
    figure.update_xaxes(range=[centre[0] - 0.04 * np.ptp(centre) - 1, centre[-1] + 0.04 * np.ptp(centre) + 1])
    figure.update_xaxes(title_text="centre of the band in Hz", row=2)
    return figure.update_layout(legend={"orientation": "h", "y": -0.14})


def _range(panel: list[_Series]) -> tuple[float, float]:
    """Limits of a panel: the bounded points and nearly all of their bars; all points if none is bounded."""
    some = [one.good & np.isfinite(one.value) for one in panel]
    if not any(each.any() for each in some):
        some = [np.isfinite(one.value) for one in panel]
    values = np.concatenate([one.value[each] for one, each in zip(panel, some, strict=True)])
    if not values.size:
        return 0.0, 1.0
    bars = [np.concatenate([getattr(one, end)[each] for one, each in zip(panel, some, strict=True)])
            for end in ("low", "high")]  # fmt: skip
    # A wide error bar of one band must not compress the others.
    low, high = (np.quantile(bar[np.isfinite(bar)], q) if np.isfinite(bar).any() else values[0]
                 for bar, q in zip(bars, (0.1, 0.9), strict=True))  # fmt: skip
    bottom, top = min(values.min(), low), max(values.max(), high)
    pad = 0.1 * (top - bottom) + 0.01 * max(abs(top), abs(bottom)) + 1e-12
    return bottom - pad, top + pad


def _runs(flags: np.ndarray) -> list[tuple[int, int]]:
    """First and last index of every run of True."""
    steps = np.diff(np.concatenate([[0], flags.astype(int), [0]]))
    return list(zip(np.flatnonzero(steps == 1), np.flatnonzero(steps == -1) - 1, strict=True))
