"""The actuator's gain over frequency: table, section of a page with its figure, a sentence, and JSON."""

from typing import TYPE_CHECKING, Any

import numpy as np

from estimation.apparent_gain import ApparentGain
from estimation.normal import NORMAL_95
from maglev_env.units import prefixed
from maglev_workbench.page import COLOURS, labelled_axis, note, number, styled, with_interval
from maglev_workbench.page import table as html_table

if TYPE_CHECKING:
    import rich.table
    from plotly.graph_objects import Figure

_HEAD = ("gain over frequency, Hz", "N/A", "late by, degrees")


def gain_table(found: ApparentGain) -> "rich.table.Table":
    """The bands with 95 % intervals."""
    from rich.table import Table

    table = Table(*_HEAD, caption=basis(found))
    for row in _rows(found):
        table.add_row(*row)
    return table


def gain_sections(found: ApparentGain, of: str = "") -> "list[tuple[str, str | Figure]]":
    """Figure and table; of: name of the recording."""
    heading = "Actuator gain over frequency" + (f" of {of}" if of else "")
    alone = "Thin lines: each recording alone. " if len(_recordings(found)) > 1 else ""
    return [
        (heading, _figure(found)),
        ("", note(f"Bars: 95 %. {alone}{basis(found)}") + html_table(_HEAD, _rows(found))),
    ]


def gain_line(found: ApparentGain) -> str:
    """A sentence on how the gain changes with frequency; empty where one gain may do."""
    said = []
    if found.extremes is not None:
        said = [
            f"{with_interval(*b.size_within(found.together))} N/A at {_span(b.f_lo, b.f_hi)}"
            for b in sorted(found.extremes, key=lambda b: b.f_lo)
        ]
    text = f"actuator gain changes with frequency: {', '.join(said)}" if said else ""
    if (late := found.latest) is not None:
        angle, low, high = late.phase_within(found.together)
        text += "; force" if text else "force"
        text += f" late by {with_interval(-angle, -high, -low)} degrees at {_span(late.f_lo, late.f_hi)}"
    return text and f"{text} (95 %)"


def gain_json(found: ApparentGain) -> dict[str, Any]:
    """SI and degrees."""
    return {
        "stiffness": found.stiffness,
        "stiffness_se": found.stiffness_se,
        "stiffness_source": found.source,
        "damping": found.damping,
        "bands": [
            {
                "f_lo": b.f_lo,
                "f_hi": b.f_hi,
                "frequency": b.frequency,
                "gain": b.size[0],
                "gain_interval": list(b.size[1:]),
                "phase": b.phase[0],
                "phase_interval": list(b.phase[1:]),
                "recordings": {name: {"gain": abs(g), "phase": b.phase_of(g)} for name, g in b.of_each.items()},
            }
            for b in found.bands
        ],
    }


def basis(found: ApparentGain) -> str:
    """What the gain stands on, and what all bands have in common."""
    scale, unit = prefixed(found.stiffness, "N/m")
    half = NORMAL_95 * found.stiffness_se * scale
    k = with_interval(found.stiffness * scale, found.stiffness * scale - half, found.stiffness * scale + half)
    return (
        f"With a stiffness of {k} {unit} ({found.source}) and a damping of {_damping(found)}. What is not known of "
        "stiffness, mass, scales and the time between the readings is in the intervals and moves all bands together; "
        "an error of the damping would show as a phase."
    )


def _damping(found: ApparentGain) -> str:
    scale, unit = prefixed(found.damping, "N s/m")
    return f"{found.damping * scale:.3g} {unit}"


def _span(low: float, high: float) -> str:
    return f"{number(low)} .. {number(high)} Hz"


def _rows(found: ApparentGain) -> list[tuple[str, ...]]:
    rows = []
    for b in found.bands:
        angle, low, high = b.phase
        rows.append(
            (f"{number(b.f_lo)} .. {number(b.f_hi)}", with_interval(*b.size), with_interval(-angle, -high, -low))
        )
    return rows


def _recordings(found: ApparentGain) -> list[str]:
    """The recordings that tell the gain in some band by themselves."""
    return list(dict.fromkeys(name for b in found.bands for name in b.of_each))


def _figure(found: ApparentGain) -> "Figure":
    from plotly.graph_objects import Scatter
    from plotly.subplots import make_subplots

    figure = styled(make_subplots(2, 1, shared_xaxes=True, vertical_spacing=0.06), 520)
    f = np.array([b.frequency for b in found.bands])
    names = _recordings(found)
    if len(names) > 1:
        for k, name in enumerate(names):
            own = np.array([b.of_each.get(name, np.nan) for b in found.bands], complex)
            line = {"width": 1, "color": (*COLOURS, "#CC79A7", "#E69F00", "#56B4E9")[1 + k % 5]}
            phase = [b.phase_of(g) for b, g in zip(found.bands, own, strict=True)]
            for row, values in ((1, abs(own)), (2, np.array(phase))):
                values = np.where(np.isfinite(own), values, np.nan)
                trace = Scatter(x=f, y=values, name=name, line=line, legendgroup=name, showlegend=row == 1,
                                mode="lines", connectgaps=True)  # fmt: skip
                figure.add_trace(trace, row=row, col=1)
    for row, values in ((1, [b.size for b in found.bands]), (2, [b.phase for b in found.bands])):
        middle, low, high = np.array(values).T
        bars = {"array": high - middle, "arrayminus": middle - low, "thickness": 1, "width": 3}
        hover = [f"{_span(b.f_lo, b.f_hi)}: {number(v)}" for b, v in zip(found.bands, middle, strict=True)]
        trace = Scatter(x=f, y=middle, error_y=bars, name="all" if len(names) > 1 else "gain", mode="lines+markers",
                        line={"color": COLOURS[0], "width": 2}, text=hover, hovertemplate="%{text}<extra></extra>",
                        showlegend=row == 1 and len(names) > 1)  # fmt: skip
        figure.add_trace(trace, row=row, col=1)
        seen = [v for v in (*low, *high) if np.isfinite(v)] if row == 1 else []
        if seen:
            sure = [b.size[2] for b in found.bands if b.size_se < 0.2 * abs(b.gain)] or seen
            figure.update_yaxes(range=[0, 1.15 * max(sure)], row=1, col=1)
    ends = np.array([found.bands[0].f_lo, found.bands[-1].f_hi])
    figure.update_xaxes(**labelled_axis("", ends, log=True)).update_xaxes(title_text="frequency in Hz", row=2, col=1)
    figure.update_yaxes(title_text="gain in N/A", row=1, col=1).update_yaxes(title_text="phase in °", row=2, col=1)
    return figure.update_layout(legend={"orientation": "h", "y": -0.16})
