"""The free correction of a block: a section of the page, with its curves."""

from typing import TYPE_CHECKING

import numpy as np

from maglev_env.units import prefixed
from maglev_workbench.page import COLOURS, html_text, labelled_axis, note, shaded, styled
from sim2real.free.correction import Free
from sim2real.free.drawn import Drawn
from sim2real.free.kinds import LINEAR, PLACES
from sim2real.free.words import UNITS, WHERE

if TYPE_CHECKING:
    from plotly.graph_objects import Figure

_NOTE = (
    "What must be added at a place of the loop so that the simulation is right, over what passes that place; shaded: "
    "two standard errors. A free correction would absorb every effect, so it competes with none: it is looked for only "
    "where no effect explains the gap, and shown only where it beats the other simulation on what no fit has seen. "
    "corrected.toml has it, so simulations, sweeps and tuning use it."
)
_TALL, _HIGH = 130, 290  # pixels of the figure around its rows, and of a row


def free_sections(free: Free) -> "list[tuple[str, str | Figure]]":
    """Sections of a page: a sentence and, where something was gained, the curves."""
    heading, sentence = "A free correction of a block", f"<p>{html_text(free.sentence().replace(' +- ', ' ± '))}</p>"
    if not free.gained:
        return [(heading, sentence)]
    return [(heading, sentence), ("", free_figure(free)), ("", note(_NOTE))]


def free_figure(free: Free) -> "Figure":
    """A panel for each curve and loop, and two for each factor over frequency.

    They stand below each other, because a narrow window has no room for two.
    """
    from plotly.subplots import make_subplots

    panels = [(d, part) for d in free.drawn for part in (("size", "phase") if d.kind.shape == LINEAR else ("",))]
    rows, titles = len(panels), [WHERE[d.kind.place] for d, _ in panels]
    figure = styled(make_subplots(rows, 1, subplot_titles=titles, vertical_spacing=0.5 / rows), _TALL + _HIGH * rows)
    for row, (d, part) in enumerate(panels, 1):
        at = {"row": row, "col": 1}
        if part:
            _factor(figure, d, part, at)
        else:
            _curve(figure, d, at)
    return figure.update_layout(showlegend=False)


def _curve(figure: "Figure", d: Drawn, at: dict[str, int]) -> None:
    """A curve, or a loop once round."""
    over, of = PLACES[d.kind.place]
    across, across_unit = prefixed(float(abs(d.at).max()), UNITS[over])
    scale, unit = (100.0, "%") if of == "share" else prefixed(float(abs(d.value).max()), UNITS[of])
    x, y, se = d.at * across, d.value * scale, d.se * scale
    closed = np.append(np.arange(x.size), 0) if d.form is None else np.arange(x.size)
    if d.form is not None:
        figure.add_trace(shaded(x, y - 2 * se, y + 2 * se, COLOURS[0]), **at)
    _line(figure, x[closed], y[closed], f"%{{x:.3g}} {across_unit}: %{{y:.3g}} {unit}", d.form is not None, at)
    figure.add_hline(0.0, line={"color": "#666", "width": 1, "dash": "dot"}, **at)
    figure.update_xaxes(title_text=f"{over} in {across_unit}", **at)
    figure.update_yaxes(title_text=f"{'change of the gain' if of == 'share' else of + ' added'} in {unit}", **at)


def _factor(figure: "Figure", d: Drawn, part: str, at: dict[str, int]) -> None:
    """Size and phase of a factor on what passes; real part and damping of a stiffness that is added."""
    whole = d.value + 1 if d.relative else d.value
    if d.relative:
        of_size = part == "size"
        y = abs(whole) if of_size else np.degrees(np.angle(whole))
        se = d.se if of_size else np.degrees(d.se / np.maximum(abs(whole), 1e-12))
        unit, title = ("", "factor on the gain") if of_size else ("°", "phase added in °")
    else:
        y = whole.real if part == "size" else whole.imag / (2 * np.pi * d.at)
        se = d.se if part == "size" else d.se / (2 * np.pi * d.at)
        unit, title = ("N/m", "stiffness added") if part == "size" else ("N s/m", "damping added")
        scale, unit = prefixed(float(abs(y).max()), unit)
        y, se, title = y * scale, se * scale, f"{title} in {unit}"
    figure.add_trace(shaded(d.at, y - 2 * se, y + 2 * se, COLOURS[0]), **at)
    _line(figure, d.at, y, f"%{{x:.4g}} Hz: %{{y:.3g}} {unit}", False, at)
    figure.update_xaxes(**labelled_axis("frequency in Hz", d.at, log=True), **at)
    figure.update_yaxes(title_text=title, **at)


def _line(figure: "Figure", x: np.ndarray, y: np.ndarray, text: str, marked: bool, at: dict[str, int]) -> None:
    from plotly.graph_objects import Scatter

    own = {"mode": "lines+markers", "marker": {"size": 5}} if marked else {"mode": "lines"}
    figure.add_trace(Scatter(x=x, y=y, line={"color": COLOURS[0]}, hovertemplate=f"{text}<extra></extra>", **own), **at)
