"""A self-contained HTML page: heading, summary, tables, interactive figures, and how it was made."""

from collections.abc import Iterable, Mapping, Sequence
from html import escape
from math import floor, inf, isfinite, isnan, log10
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from maglev_env.recordings.files import write_text_atomic
from maglev_env.rig.excitation import UNITS

if TYPE_CHECKING:
    from plotly.graph_objects import Figure, Scatter

COLOURS = ("#0072B2", "#D55E00", "#009E73")  # Okabe and Ito's palette, which colour-blind readers can distinguish
INFEASIBLE, STAR = "#D9D9D9", "#E8000B"
ISO_LIMITS = {3.0: "A | B", 4.0: "B | C", 5.0: "C | D"}  # peak |S|, ISO 14839-3
_SIGNIFICANT = 4
_CSS = """
body { font: 15px/1.5 system-ui, sans-serif; color: #222; max-width: 1180px; margin: 2em auto; padding: 0 1.2em; }
h1 { font-size: 1.5em; margin-bottom: .2em; } h2 { font-size: 1.15em; margin: 2em 0 .4em; }
.summary { font-size: 1.1em; } .note { color: #555; max-width: 62em; } .scroll { overflow-x: auto; }
.beside { min-width: 640px; } td.wrapped { white-space: normal; } table:has(td.wrapped) { min-width: 640px; }
table { border-collapse: collapse; font-variant-numeric: tabular-nums; font-size: .9em; }
th, td { padding: .25em .7em; text-align: right; border-bottom: 1px solid #ddd; white-space: nowrap; }
th { vertical-align: bottom; white-space: pre; } .best tbody tr:first-child td { font-weight: 600; }
table.facts th, table.facts td { text-align: left; font-weight: normal; white-space: normal; vertical-align: top; }
table.facts th { color: #555; width: 14em; } footer { margin: 3em 0; }
"""


def page(
    title: str, summary: str, sections: "Sequence[tuple[str, str | Figure]]", made_by: Mapping[str, object]
) -> str:
    """The HTML of one page, which includes plotly.js once and so needs no network.

    Args:
        title: plain text, as are summary, headings and made_by; they are escaped here.
        summary: one or two sentences below the title.
        sections: (heading or "", content); content is a plotly Figure, or HTML whose strings the caller has escaped.
        made_by: names and values that say how the page was made, for its foot.
    """
    parts, drawn = [], 0
    for heading, content in sections:
        parts.append(f"<h2>{escape(heading)}</h2>" if heading else "")
        if isinstance(content, str):
            parts.append(content)
            continue
        drawn += 1
        html = content.to_html(
            full_html=False,
            include_plotlyjs=drawn == 1,
            div_id=f"figure-{drawn}",  # plotly's own ids are random, but equal results must give equal pages
            config={"displaylogo": False, "responsive": True},
        )
        beside = any((axis.domain or (0.0,))[0] > 0 for axis in content.select_xaxes())
        parts.append(f'<div class="scroll"><div class="beside">{html}</div></div>' if beside else html)
    return (
        f'<!DOCTYPE html>\n<html lang="en"><head><meta charset="utf-8">'
        f'<meta name="viewport" content="width=device-width, initial-scale=1"><title>{escape(title)}</title>'
        f"<style>{_CSS}</style></head>\n<body><h1>{escape(title)}</h1>\n"
        f'<p class="summary">{escape(summary)}</p>\n' + "\n".join(parts) + "\n<footer><h2>What made this page</h2>"
        f"{facts(made_by.items())}</footer></body></html>\n"
    )


def write_page(path: Path, html: str) -> None:
    """Write a page atomically: a reader sees either the old page or the whole new one.

    Raises:
        OSError: It cannot be written.
    """
    write_text_atomic(path, html)


def table(head: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """HTML of a table of text; everything is escaped."""
    cells = "".join(f"<th>{escape(name)}</th>" for name in head)
    body = "".join("<tr>" + "".join(f"<td>{escape(c)}</td>" for c in row) + "</tr>" for row in rows)
    return f'<div class="scroll"><table><thead><tr>{cells}</tr></thead><tbody>{body}</tbody></table></div>'


def markdown_table(head: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """Markdown of a table of text."""
    lines = [head, ["---"] * len(head), *rows]
    return "\n".join(
        "| " + " | ".join(cell.replace("|", "\\|").replace("\n", " ") for cell in line) + " |" for line in lines
    )


def facts(pairs: Iterable[tuple[str, object]]) -> str:
    """HTML of a two-column table of names and values; everything is escaped."""
    rows = "".join(f"<tr><th>{escape(str(k))}</th><td>{escape(str(v))}</td></tr>" for k, v in pairs)
    return f'<table class="facts">{rows}</table>'


def rig_facts(rig: Mapping[str, Any]) -> dict[str, str]:
    """Names and values that describe a rig and its protocol; rig: a `Rig` as JSON data, empty if it is not known."""
    if not rig:
        return {"Rig": "not known"}
    found = {"Rig": f"{rig['name']} ({rig['magnet']}), {rig['mass']:g} kg"}
    driven = []
    for e in (rig.get("protocol") or {}).get("excitations", []):
        low, high = (e["lines"][end] * e["fundamental"] for end in (0, -1))
        lines = f"{len(e['lines'])} lines from {low:g} to {high:g} Hz"
        driven.append(f"{e['kind']} at the {e['at']}, {lines}, peak {e['amplitude']:g} {UNITS[e['at']]}")
    return found | ({"Excitation": "; ".join(driven)} if driven else {})


def note(text: str) -> str:
    """HTML of a paragraph in grey; the text is escaped."""
    return f'<p class="note">{escape(text)}</p>'


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
    figure.update_layout(template="plotly_white", height=height, font=font, margin={"l": 70, "r": 30, "t": 50, "b": 60})
    figure.update_xaxes(showline=True, linecolor="#888", mirror=True, ticks="outside")
    figure.update_yaxes(showline=True, linecolor="#888", mirror=True, ticks="outside")
    return figure


def labelled_axis(title: str, values: np.ndarray, log: bool) -> dict[str, Any]:
    """Axis settings for values in display units (positive if log); a logarithmic axis has labels at 1, 2 and 5."""
    axis: dict[str, Any] = {"title_text": title, "type": "log" if log else "linear"}
    if log:
        decades = range(floor(log10(values.min())), floor(log10(values.max())) + 1)
        ticks = [digit * 10.0**decade for decade in decades for digit in (1, 2, 5)]
        axis |= {"tickvals": ticks, "ticktext": [f"{tick:g}" for tick in ticks]}
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
        label = {"text": f"{zones} at {limit:g}", "xref": "x domain", "x": 1, "xanchor": "right", "yanchor": "bottom"}
        y = log10(limit) if log else limit  # annotations, unlike shapes, need the exponent on a logarithmic axis
        figure.add_annotation(**label, y=y, row=row, col=col, showarrow=False, font={"size": 10, "color": "#666"})
