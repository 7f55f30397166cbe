"""A self-contained HTML page: the answer, tables, interactive figures, and how it was made."""

import re
from collections.abc import Iterable, Mapping, Sequence
from html import escape
from math import ceil, floor, inf, isfinite, isnan, log10
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from maglev_env.recordings.files import write_text_atomic
from maglev_env.rig.excitation import UNITS
from maglev_workbench.page_figures import LICENCE, asset, figures_json, plotly_packed
from maglev_workbench.page_links import GENERATOR, NO_LINKS, link_pages, with_data

if TYPE_CHECKING:
    from plotly.graph_objects import Figure, Scatter

COLOURS = ("#0072B2", "#D55E00", "#009E73")  # Okabe and Ito's palette, which colour-blind readers can distinguish
INFEASIBLE, STAR = "#D9D9D9", "#E8000B"
ISO_LIMITS = {3.0: "A | B", 4.0: "B | C", 5.0: "C | D"}  # peak |S|, ISO 14839-3
_SIGNIFICANT = 4


def page(
    title: str, summary: str, sections: "Sequence[tuple[str, str | Figure]]", made_by: Mapping[str, object]
) -> str:
    """The HTML of one page, which carries all that it draws with and so needs no network and no file beside it.

    Args:
        title: plain text, as are summary, headings and made_by; they are escaped here.
        summary: the answer in one or two sentences, below the title.
        sections: (heading or "", content); content is a plotly Figure, or HTML whose strings the caller has escaped.
        made_by: names and values that say how the page was made, for its foot.
    """
    parts: list[str] = []
    figures: list[Figure] = []
    for heading, content in sections:
        parts.append(f"<h2>{escape(heading)}</h2>" if heading else "")
        if isinstance(content, str):
            parts.append(content)
            continue
        figures.append(content)
        place = (
            f'<div class="plotly-graph-div" id="figure-{len(figures)}" style="height:{content.layout.height or 450}px"'
        )
        place += "></div>"
        beside = any((axis.domain or (0.0,))[0] > 0 for axis in content.select_xaxes())
        parts.append(f'<div class="scroll"><div class="beside">{place}</div></div>' if beside else place)
    library = (
        f'<!-- {LICENCE} -->\n<script type="text/plain" id="plotly">{plotly_packed()}</script>\n' if figures else ""
    )
    return (
        f'<!DOCTYPE html>\n<html lang="en"><head><meta charset="utf-8">'
        f'<meta name="viewport" content="width=device-width, initial-scale=1">'
        f'<meta name="color-scheme" content="light dark">{GENERATOR}<title>{escape(title)}</title>'
        f'<link rel="icon" href="data:,"><style>{asset("page.css")}</style></head>\n'
        f'<body>{NO_LINKS}<h1>{escape(title)}</h1>\n<p class="summary">{html_text(summary)}</p>\n'
        + "\n".join(parts)
        + f"\n<footer><h2>What made this page</h2>{facts(made_by.items())}</footer>\n"
        f'<script type="application/json" id="figures">{figures_json(figures)}</script>\n'
        f"{library}<script>{asset('page.js')}</script></body></html>\n"
    )


def write_page(path: Path, html: str, data: Sequence[Path | None] = ()) -> None:
    """Write a page atomically, with links to its data and to and from the pages beside it.

    Args:
        path: of the page.
        html: as `page` gives it.
        data: files that the page is about; None and those outside its folder are not linked.

    Raises:
        OSError: It cannot be written.
    """
    write_text_atomic(path, with_data(html, path, [file for file in data if file is not None]))
    link_pages(path)


def html_text(text: str) -> str:
    """HTML of plain text, in which a command stands between backticks."""
    return re.sub(r"`([^`]+)`", r"<code>\1</code>", escape(text))


def table(head: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """HTML of a table of text; everything is escaped."""
    cells = "".join(f"<th>{escape(name)}</th>" for name in head)
    body = "".join("<tr>" + "".join(f"<td>{html_text(c)}</td>" for c in row) + "</tr>" for row in rows)
    return f'<div class="scroll"><table><thead><tr>{cells}</tr></thead><tbody>{body}</tbody></table></div>'


def markdown_table(head: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """Markdown of a table of text."""
    lines = [head, ["---"] * len(head), *rows]
    return "\n".join(
        "| " + " | ".join(cell.replace("|", "\\|").replace("\n", " ") for cell in line) + " |" for line in lines
    )


def facts(pairs: Iterable[tuple[str, object]]) -> str:
    """HTML of a two-column table of names and values; everything is escaped."""
    rows = "".join(f"<tr><th>{escape(str(k))}</th><td>{html_text(str(v))}</td></tr>" for k, v in pairs)
    return f'<table class="facts">{rows}</table>'


def rig_facts(rig: Mapping[str, Any]) -> dict[str, str]:
    """Names and values that describe a rig and its protocol; rig: a `Rig` as JSON data, empty if it is not known."""
    if not rig:
        return {"Rig": "not known"}
    found = {"Rig": f"{rig['name']} ({rig['magnet']}), {rig['mass']:g} kg"}
    if rig.get("effects"):
        found["Effects of the rig"] = effects_in_words(rig["effects"])
    driven = []
    for e in (rig.get("protocol") or {}).get("excitations", []):
        low, high = (e["lines"][end] * e["fundamental"] for end in (0, -1))
        lines = f"{len(e['lines'])} lines from {low:g} to {high:g} Hz"
        driven.append(f"{e['kind']} at the {e['at']}, {lines}, peak {e['amplitude']:g} {UNITS[e['at']]}")
    return found | ({"Excitation": "; ".join(driven)} if driven else {})


def effects_in_words(effects: Mapping[str, Mapping[str, object]]) -> str:
    """Added effects with their parameters in SI, "none" without one."""
    return (
        "; ".join(f"{name}: {', '.join(f'{k} = {v}' for k, v in e.items())}" for name, e in effects.items()) or "none"
    )


def note(text: str) -> str:
    """HTML of a paragraph in grey; the text is escaped."""
    return f'<p class="note">{html_text(text)}</p>'


def number(value: float | None, digits: int = 3) -> str:
    """A number with some significant digits, without an exponent if that is readable; a dash for None or nan."""
    if value is None or isnan(value):
        return "–"
    if not isfinite(value):
        return "∞" if value > 0 else "-∞"
    exponent = _exponent(value, digits) if value else 0
    if not -5 < exponent < 7:
        return f"{value:.{digits - 1}e}"
    return f"{value:.{max(0, digits - 1 - exponent)}f}"


def _exponent(value: float, digits: int) -> int:
    """Power of ten of a value's first digit, once it is rounded: 99.97 is 100 to three digits, and has three before the
    point."""
    return floor(log10(abs(float(f"{value:.{digits - 1}e}"))))


def with_interval(value: float | None, low: float | None, high: float | None) -> str:
    """A value with its 95 % interval, rounded to the digits that the interval supports: 43.04 ±0.20, 43.0 [12.0, ∞]."""
    if value is None or isnan(value):
        return "–"
    low, high = -inf if low is None or isnan(low) else low, inf if high is None or isnan(high) else high
    if not (isfinite(low) and isfinite(high)) or high <= low:
        return number(value) if high <= low else f"{number(value)} [{number(low)}, {number(high)}]"
    half = (high - low) / 2
    first = _exponent(half, 2)
    places = 1 - first
    if value:
        places = min(places, _SIGNIFICANT - 1 - _exponent(value, _SIGNIFICANT))
    places = max(0, places)
    if abs(high + low - 2 * value) <= 0.2 * (high - low):
        return f"{value:.{places}f} ±{number(half, max(1, min(2, places + 1 + first)))}"
    return f"{value:.{places}f} [{low:.{places}f}, {high:.{places}f}]"


def styled(figure: "Figure", height: int) -> "Figure":
    """Apply the common style of the pages to a figure and return it; height in px."""
    font = {"family": "system-ui, sans-serif", "size": 13}
    figure.update_layout(height=height, font=font, margin={"l": 70, "r": 30, "t": 50, "b": 60})
    figure.update_xaxes(showline=True, linecolor="#888", mirror=True, ticks="outside")
    figure.update_yaxes(showline=True, linecolor="#888", mirror=True, ticks="outside")
    return figure


def labelled_axis(title: str, values: np.ndarray, log: bool) -> dict[str, Any]:
    """Axis settings for values in display units (positive if log); a logarithmic axis has labels at 1, 2 and 5.

    Where fewer than three of these lie among the values, the labels are those of a linear axis.
    """
    axis: dict[str, Any] = {"title_text": title, "type": "log" if log else "linear"}
    if log and values.size:
        low, high = float(values.min()), float(values.max())
        decades = range(floor(log10(low)), floor(log10(high)) + 1)
        ticks = [digit * 10.0**decade for decade in decades for digit in (1, 2, 5)]
        if high > low and sum(low <= tick <= high for tick in ticks) < 3:
            step = 10.0 ** floor(log10((high - low) / 2))
            step *= next((digit for digit in (5, 2) if digit * step <= (high - low) / 2), 1)
            ticks = [step * i for i in range(max(1, floor(low / step)), ceil(high / step) + 1)]
        axis |= {"tickvals": ticks, "ticktext": [f"{tick:.12g}" for tick in ticks]}
    return axis


def colour_panels(scales: Sequence[tuple[str, str, float, float]], x: Mapping, y: Mapping) -> "Figure":
    """A figure of four empty panels with the same two axes.

    Args:
        scales: (label, colour scale, lowest and highest value) of the panels, for coloraxis1 to 4.
        x: settings of the x axis, see `labelled_axis`.
        y: settings of the y axis.
    """
    from plotly.subplots import make_subplots

    figure = make_subplots(2, 2, subplot_titles=[s[0] for s in scales], horizontal_spacing=0.17, vertical_spacing=0.13)
    figure.update_xaxes(**x).update_yaxes(**y).update_layout(showlegend=False)
    for p, (_, colours, low, high) in enumerate(scales):
        bar = {"x": (0.425, 1.01)[p % 2], "y": (0.79, 0.21)[p // 2], "len": 0.44, "thickness": 12}
        axis = {"colorscale": colours, "cmin": low, "cmax": high, "colorbar": bar}
        figure.update_layout({f"coloraxis{p + 1}": axis})
    return styled(figure, 860)


def shaded(x: ArrayLike, low: ArrayLike, high: ArrayLike, colour: str, **trace: Any) -> "Scatter":
    """A shaded band between low and high, each (n,), with gaps where either is not finite."""
    from plotly.graph_objects import Scatter

    x, low, high = (np.asarray(a, dtype=float) for a in (x, low, high))
    good = np.isfinite(low) & np.isfinite(high)
    runs = np.split(np.arange(x.size), np.flatnonzero(np.diff(good)) + 1)
    xs: list[float] = []
    ys: list[float] = []
    for run in runs:
        if run.size and good[run[0]]:
            xs += [*x[run], *x[run][::-1], np.nan]
            ys += [*low[run], *high[run][::-1], np.nan]
    style = {"mode": "none", "fill": "toself", "fillcolor": colour, "opacity": 0.25, "hoverinfo": "skip"}
    return Scatter(x=xs, y=ys, **{**style, "showlegend": False, **trace})


def mark_iso_zones(figure: "Figure", row: int | None = None, col: int | None = None, log: bool = False) -> None:
    """Draw the limits of the zones of ISO 14839-3 into a panel of |S|; log: its y axis is logarithmic."""
    for limit, zones in ISO_LIMITS.items():
        figure.add_hline(limit, row=row, col=col, line={"color": "#666", "width": 1, "dash": "dash"})
        label = {
            "text": f"{zones} at {limit:g}",
            "xref": "x domain",
            "x": 0.995,
            "xanchor": "right",
            "yanchor": "middle",
        }
        label |= {"bgcolor": "white", "borderpad": 0}  # interrupts its line, because the next line may be near
        y = log10(limit) if log else limit  # annotations, unlike shapes, need the exponent on a logarithmic axis
        figure.add_annotation(**label, y=y, row=row, col=col, showarrow=False, font={"size": 10, "color": "#666"})
