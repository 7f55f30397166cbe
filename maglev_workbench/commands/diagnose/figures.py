"""Figures of a diagnosis: the loop with the shares of the gap, responses, ranking, gap, bands and kinds of lines."""

from collections.abc import Mapping, Sequence
from html import escape
from typing import TYPE_CHECKING

import numpy as np

from maglev_env.loop.effect import EFFECTS
from maglev_env.recordings.campaign import Campaign
from maglev_workbench.page import COLOURS, labelled_axis, mark_iso_zones, number, shaded, styled
from sim2real.curve import Curve
from sim2real.result import Diagnosis
from sim2real.words import percent

if TYPE_CHECKING:
    from plotly.graph_objects import Figure

LOOP = ("controller", "amplifier", "actuator", "mechanics", "sensor")
SIGNALS = ("command", "current", "force", "displacement", "reading")  # output of each block of the loop
LINE, GAP = "currentColor", COLOURS[1]  # of the text, which is light on a dark screen
FLOOR, SHOWN = 0.001, 9  # probability and number of hypotheses that the ranking shows
_BOX, _STEP, _LEFT, _TOP, _HIGH, _ROW = 122, 208, 92, 66, 60, 28
_WIDEST = 15  # characters of an effect's name that a block holds in one line
_QUANTITY = {"receptance": ("displacement / force in µm/N", 1e6), "sensitivity": ("|S|", 1.0)}


def loop_diagram(diagnosis: Diagnosis, effects: Sequence[str]) -> str:
    """The loop as SVG.

    Below the blocks are the segments that the recorded channels isolate, with their shares of the gap. The larger the
    share that may belong to a block, the darker it is.

    Args:
        diagnosis: the diagnosis.
        effects: the effects of the verdict, which are written into their blocks.
    """
    where, controlled = diagnosis.where, diagnosis.campaign.rig.controlled
    names = LOOP if controlled else LOOP[3:]
    shares = {n: v for n, v in where.blocks.items() if where.significant and v > 0}
    rows = _stacked([n for n in sorted(shares, key=lambda n: -shares[n])])
    bottom = _TOP + _HIGH + 14 + _ROW * (max(rows.values(), default=-1) + 1) + 14
    parts = [_box(i, name, _darkness(name, shares), effects) for i, name in enumerate(names)]
    for i in range(len(names)):
        start = _LEFT + i * _STEP + _BOX
        label = SIGNALS[LOOP.index(names[i])]
        parts.append(_arrow([(start, _TOP + _HIGH / 2), (start + _STEP - _BOX, _TOP + _HIGH / 2)]))
        parts.append(_text(start + (_STEP - _BOX) / 2 - 4, _TOP + _HIGH / 2 + 15, label, 11))
    outside = [e for e in effects if e in EFFECTS and EFFECTS[e].block == "external"]
    pushed = _LEFT + names.index("mechanics") * _STEP + _BOX / 2
    if forces := [*(["shaker's force"] if _shaken(diagnosis.campaign) else []), *outside]:
        parts.append(_arrow([(pushed, 24), (pushed, _TOP)]))
        parts.append(_text(pushed, 16, " + ".join(forces), 11, bool(outside)))
    if controlled:
        end, first, y = _LEFT + 4 * _STEP + _BOX + 34, _LEFT - 34, _TOP + _HIGH / 2
        parts.append(_arrow([(end, y), (end, bottom), (first, bottom), (first, y), (_LEFT, y)]))
        joint = _LEFT + _BOX + (_STEP - _BOX) / 2 - 4
        parts.append(_arrow([(joint, 34), (joint, y)]) + _text(joint, 26, "injection", 11))
        parts.append(
            _arrow([(8, y), (first, y)]) + _text(26, y - 6, "reference", 11) + _text(first + 12, y + 16, "–", 14)
        )
    for name, row in rows.items():
        span = [names.index(b) for b in name.split("+") if b in names]
        if not span:
            continue
        x, width = _LEFT + min(span) * _STEP, (max(span) - min(span)) * _STEP + _BOX
        y = _TOP + _HIGH + 14 + row * _ROW
        fill = f'fill="{GAP}" fill-opacity="{0.08 + 0.75 * shares[name]:.2f}" stroke="{GAP}"'
        parts.append(f'<rect x="{x}" y="{y}" width="{width}" height="{_ROW - 6}" rx="4" {fill}/>')
        parts.append(_text(x + width / 2, y + 15, f"{percent(shares[name])} in {name.replace('+', ' + ')}", 12))
    width = _LEFT + (len(names) - 1) * _STEP + _BOX + 70
    head = '<div class="scroll">'  # a narrow window scrolls, because smaller letters cannot be read
    head += f'<svg viewBox="0 0 {width} {bottom + 14}" style="max-width:{width}px;min-width:{width // 2}px" role="img"'
    arrow = (
        '<defs><marker id="tip" viewBox="0 0 8 8" refX="7" refY="4" markerWidth="7" markerHeight="7" orient="auto">'
        f'<path d="M0 0 L8 4 L0 8 z" fill="{LINE}"/></marker></defs>'
    )
    return f'{head} font-family="system-ui, sans-serif" xmlns="http://www.w3.org/2000/svg">{arrow}{"".join(parts)}</svg></div>'


def _shaken(campaign: Campaign) -> bool:
    """Whether a force acts on the rotor from outside, as the recordings state or show."""
    return any(
        "force" in r.channels or any(e.kind != "none" and e.at == "force" for e in r.excitations)
        for r in campaign.recordings
    )


def _darkness(name: str, shares: Mapping[str, float]) -> float:
    return min(1.0, sum(v for segment, v in shares.items() if name in segment.split("+")))


def _stacked(segments: Sequence[str]) -> dict[str, int]:
    """A row for each segment, below those that it overlaps."""
    rows: dict[str, int] = {}
    for name in segments:
        own = set(name.split("+"))
        taken = {row for other, row in rows.items() if own & set(other.split("+"))}
        rows[name] = next(row for row in range(len(segments)) if row not in taken)
    return rows


def _box(index: int, name: str, darkness: float, effects: Sequence[str]) -> str:
    x, blamed = _LEFT + index * _STEP, [e for e in effects if e in EFFECTS and EFFECTS[e].block == name]
    edge = f'stroke="{GAP}" stroke-width="3"' if blamed else f'stroke="{LINE}" stroke-width="1.3"'
    place = f'<rect x="{x}" y="{_TOP}" width="{_BOX}" height="{_HIGH}" rx="6"'
    shape = f'{place} style="fill:var(--ground)" {edge}/>{place} fill="{GAP}" fill-opacity="{0.6 * darkness:.2f}"/>'
    lines = [name, *(line for effect in blamed for line in _in_box(effect))]
    apart = min(16.0, (_HIGH - 4) / len(lines))
    start = _TOP + _HIGH / 2 + 5 - apart / 2 * (len(lines) - 1)
    return shape + "".join(
        _text(x + _BOX / 2, start + apart * k, line, min(int(apart), 14 if k == 0 else 12), k > 0)
        for k, line in enumerate(lines)
    )


def _in_box(effect: str) -> list[str]:
    """The name of an effect in lines that a block holds, parted behind an underscore."""
    if len(effect) <= _WIDEST or "_" not in effect:
        return [effect]
    cut = min((i for i, c in enumerate(effect) if c == "_"), key=lambda i: abs(i - len(effect) / 2)) + 1
    return [effect[:cut], effect[cut:]]


def _text(x: float, y: float, words: str, size: int, bold: bool = False) -> str:
    weight = ' font-weight="700"' if bold else ""
    style = f'font-size="{size}" text-anchor="middle" fill="currentColor"{weight}'
    return f'<text x="{x:g}" y="{y:g}" {style}>{escape(words)}</text>'


def _arrow(points: Sequence[tuple[float, float]]) -> str:
    path = " ".join(f"{x:g},{y:g}" for x, y in points)
    return f'<polyline points="{path}" fill="none" stroke="{LINE}" stroke-width="1.3" marker-end="url(#tip)"/>'


def responses(curves: Sequence[Curve]) -> "Figure":
    """Curves of one kind, a column for each axis.

    The rows are the magnitude, for a receptance the phase, and the distance from the measured curve in units of its
    noise.
    """
    from plotly.subplots import make_subplots

    title, scale = _QUANTITY[curves[0].kind]
    phased = curves[0].kind == "receptance"
    apart = any(len(_drawn(c)) > 1 for c in curves)  # else no simulated rig levitates
    heads = [f"along {c.axis}, {c.record}" if c.axis else c.record for c in curves]
    heights = [0.42, *([0.29] if phased else []), *([0.29 if phased else 0.35] if apart else [])]
    figure = make_subplots(len(heights), len(curves), shared_xaxes=True, vertical_spacing=0.05, row_heights=heights,
                           subplot_titles=heads)  # fmt: skip
    styled(figure, 140 + int(500 * sum(heights)))
    for col, curve in enumerate(curves, 1):
        _sizes(figure, curve, scale, col)
        if phased:
            _phases(figure, curve, col)
        if apart:
            _distances(figure, curve, len(heights), col)
        figure.update_xaxes(**labelled_axis("", curve.frequency, log=True), col=col)
        figure.update_xaxes(title_text="frequency in Hz", row=len(heights), col=col)
    figure.update_yaxes(title_text=title, row=1, col=1)
    if phased:
        figure.update_yaxes(title_text="phase in °", row=2, col=1).update_yaxes(dtick=90, row=2)
    if apart:
        figure.update_yaxes(title_text="distance / noise", row=len(heights), col=1)
    return figure.update_layout(legend={"orientation": "h", "y": -0.12})


_STYLES = {
    "nominal": {"mode": "lines", "line": {"color": COLOURS[1], "width": 1.6, "dash": "dash"}},
    "corrected": {"mode": "lines", "line": {"color": COLOURS[0], "width": 1.6}},
    "measured": {"mode": "markers", "marker": {"color": "#222", "size": 4}},
}


def _drawn(curve: Curve) -> dict[str, np.ndarray]:
    """Those of the nominal, corrected and measured curves that are finite, in drawing order."""
    return {name: getattr(curve, name) for name in _STYLES if np.isfinite(getattr(curve, name)).all()}


def _sizes(figure: "Figure", curve: Curve, scale: float, col: int) -> None:
    from plotly.graph_objects import Scatter

    f, size, sigma = curve.frequency, scale * abs(curve.measured), scale * curve.sd / np.sqrt(2)
    figure.add_trace(shaded(f, np.maximum(size - 2 * sigma, size / 30), size + 2 * sigma, "#222"), row=1, col=col)
    for name, values in _drawn(curve).items():
        text = f"%{{x:.4g}} Hz: %{{y:.4g}}<extra>{name}</extra>"
        shown = {"name": name, "legendgroup": name, "showlegend": col == 1, "hovertemplate": text}
        figure.add_trace(Scatter(x=f, y=scale * abs(values), **_STYLES[name], **shown), row=1, col=col)
    seen = np.concatenate([scale * abs(v) for v in _drawn(curve).values()])
    if curve.kind == "sensitivity":
        mark_iso_zones(figure, row=1, col=col, log=True)
        seen = np.append(seen, [0.8, 6.0])
    ends = np.array([seen.min() / 1.2, seen.max() * 1.2])
    figure.update_yaxes(**labelled_axis("", ends, log=True), range=np.log10(ends), row=1, col=col)


def _phases(figure: "Figure", curve: Curve, col: int) -> None:
    from plotly.graph_objects import Scatter

    for name, values in _drawn(curve).items():
        phase = (np.degrees(np.angle(values)) + 270) % 360 - 270  # -270 to 90, so that -180 of a mass does not jump
        text = f"%{{x:.4g}} Hz: %{{y:.4g}}°<extra>{name}</extra>"
        shown = {"showlegend": False, "hovertemplate": text}
        figure.add_trace(Scatter(x=curve.frequency, y=phase, **_STYLES[name], **shown), row=2, col=col)


def _distances(figure: "Figure", curve: Curve, row: int, col: int) -> None:
    from plotly.graph_objects import Scatter

    found = {name: curve.distance(values) for name, values in _drawn(curve).items() if name != "measured"}
    for name, values in found.items():
        text = f"%{{x:.4g}} Hz: %{{y:.3g}} times the noise<extra>{name}</extra>"
        shown = {"showlegend": False, "hovertemplate": text}
        figure.add_trace(Scatter(x=curve.frequency, y=values, **_STYLES[name], **shown), row=row, col=col)
    figure.add_hline(1.0, row=row, col=col, line={"color": "#666", "width": 1, "dash": "dot"})
    top = max((values.max() for values in found.values()), default=1.0)
    ends = np.array([0.1, max(10.0, 1.5 * top)])
    decades = [10.0**k for k in range(-1, int(np.ceil(np.log10(ends[1]))) + 1)]
    axis = {"type": "log", "tickvals": decades, "ticktext": [f"{v:g}" for v in decades]}
    figure.update_yaxes(**axis, range=np.log10(ends), row=row, col=col)


def ranking(diagnosis: Diagnosis) -> "Figure":
    """The most probable hypotheses as bars; those of the verdict are coloured."""
    from plotly.graph_objects import Bar, Figure

    kept = [e for e in diagnosis.which if e.probability >= FLOOR][:SHOWN][::-1]
    labels = [" + ".join(e.effects) for e in kept]
    blamed = {"+".join(diagnosis.cause)} if diagnosis.verdict == "explained" else {*diagnosis.cause}
    colours = [GAP if "+".join(e.effects) in blamed else COLOURS[0] for e in kept]
    words = [percent(e.probability) for e in kept]
    bar = Bar(x=[e.probability for e in kept], y=labels, orientation="h", marker={"color": colours}, text=words,
              textposition="outside", cliponaxis=False, hovertemplate="%{y}: %{x:.3g}<extra></extra>")  # fmt: skip
    figure = styled(Figure(bar), 110 + 30 * len(kept))
    figure.update_xaxes(title_text="probability", range=[0, 1.08]).update_yaxes(automargin=True)
    return figure


def gap_bars(rows: Sequence[tuple[str, float | None]]) -> "Figure":
    """Bars of gaps in units of the noise, the first one on top; None if the rotor touches down; dashed: noise alone."""
    from plotly.graph_objects import Bar, Figure

    rows = list(rows)[::-1]
    words = [f"{v:.3g}" if v is not None else "does not levitate" for _, v in rows]
    colours = [{"nominal": COLOURS[1], "corrected": COLOURS[0]}.get(name, "#999") for name, _ in rows]
    known = [v for _, v in rows if v is not None]
    log = bool(known) and max(known) > 20 * min(known)
    at = [v if v is not None else (0.8 if log else 0.0) for _, v in rows]
    bar = Bar(x=at, y=[name for name, _ in rows], orientation="h", marker={"color": colours}, text=words,
              textposition="outside", cliponaxis=False, hoverinfo="skip")  # fmt: skip
    figure = styled(Figure(bar), 110 + 32 * len(rows))
    figure.add_vline(1.0, line={"color": "#222", "dash": "dash", "width": 1.2})
    top = max([1.0, *known])
    axis = labelled_axis("gap in units of the noise", np.array([0.8, 2 * top]), log)
    figure.update_xaxes(**axis, range=np.log10([0.8, 2 * top]) if log else [0, 1.15 * top])
    return figure.update_yaxes(automargin=True)


def shares(diagnosis: Diagnosis) -> "Figure":
    """Shares of the gap by third octave and by kind of lines."""
    from plotly.graph_objects import Bar
    from plotly.subplots import make_subplots

    titles = ("by band", "by kind of line")
    figure = styled(make_subplots(1, 2, column_widths=[0.68, 0.32], subplot_titles=titles), 340)
    low, high, share = np.array(diagnosis.where.bands).T
    text = "%{customdata}: %{y:.1%}<extra></extra>"
    bands = [f"{a:.3g} .. {b:.3g} Hz" for a, b in zip(low, high, strict=True)]
    # Bars of equal width in Hz look unequal on a logarithmic axis, so the axis has categories.
    figure.add_trace(Bar(x=[number(np.sqrt(a * b)) for a, b in zip(low, high, strict=True)], y=share, customdata=bands,
                         marker={"color": GAP}, hovertemplate=text), row=1, col=1)  # fmt: skip
    kind = diagnosis.where.kind
    figure.add_trace(Bar(x=list(kind), y=list(kind.values()), marker={"color": GAP}, text=[percent(v) for v in
                         kind.values()], textposition="outside", cliponaxis=False), row=1, col=2)  # fmt: skip
    figure.update_xaxes(type="category", tickangle=-45, title_text="centre of the third octave in Hz", row=1, col=1)
    figure.update_yaxes(tickformat=".0%", rangemode="tozero").update_yaxes(range=[0, 1.1], row=1, col=2)
    return figure.update_layout(showlegend=False)
