"""The pooled estimate of a named rig: a table of identified against nominal values, and JSON."""

from collections.abc import Sequence
from dataclasses import asdict
from itertools import chain
from typing import TYPE_CHECKING, Any

import numpy as np

from estimation.normal import NORMAL_95
from maglev_env.evaluation.identification import Identification
from maglev_env.units import prefixed
from maglev_workbench.commands.estimate.each_figure import each_figure, shown_unit
from maglev_workbench.commands.estimate.gain_report import gain_json, gain_line, gain_sections
from maglev_workbench.page import html_text, note
from maglev_workbench.page import table as html_table
from sim2real.coefficients import Coefficient
from sim2real.pooled import Pooled
from sim2real.words import AT_BOUND

if TYPE_CHECKING:
    import rich.table
    from plotly.graph_objects import Figure


APART = 3.0  # standard errors
SMALL = (
    "a response takes the motion for small, the readings for simultaneous and an amplifier_time_constant that is left "
    "out for none; the fit is right as far as the rig's force law is"
)
LATE = ", such as a force that comes later than the current (its lag acts as negative damping)"
_HEAD = ("all recordings together", "identified", "95 %", "nominal", "change", "standard errors")


def pooled_table(found: Pooled) -> "rich.table.Table":
    """Identified beside nominal coefficients, in percent and in standard errors."""
    from rich.table import Table

    table = Table(*_HEAD)
    for row in _rows(found):
        table.add_row(*row)
    return table


def pooled_sections(found: Pooled, apart: Sequence[str] = ()) -> "list[tuple[str, str | Figure]]":
    """The same table as a section of a page; apart: what `apart_lines` says."""
    said = [*apart, *pooled_lines(found)]
    lines = "".join(f"<li>{html_text(line.replace(' +- ', ' ± '))}</li>" for line in said)
    whole = html_table(_HEAD, _rows(found)) + (f"<ul>{lines}</ul>" if lines else "")
    sections: list[tuple[str, str | Figure]] = [("The rig in all recordings", whole)]
    if found.of_each:
        head, rows = _each(found)
        typeset = [[cell.replace(" +- ", " ± ") for cell in row] for row in rows]
        drawn = each_figure(found)
        if drawn is not None:
            mind = "Bars: 95 %, as each recording tells it alone, and of all together; dotted: the nominal rig."
            sections += [("Each recording alone", drawn), ("", note(mind) + html_table(head, typeset))]
        else:
            sections.append(("Each recording alone", html_table(head, typeset)))
    return sections + (gain_sections(found.gain) if found.gain is not None else [])


def each_table(found: Pooled) -> "rich.table.Table":
    """What each recording says alone, and the means with the weight, with standard errors."""
    from rich.table import Table

    head, rows = _each(found)
    table = Table(*head)
    for row in rows:
        table.add_row(*row)
    return table


def _each(found: Pooled) -> tuple[tuple[str, ...], list[tuple[str, ...]]]:
    """Head and rows: a coefficient a column, +- standard error; a dash where a recording says nothing of it."""
    units = {c.name: shown_unit(c) for c in found.coefficients}
    head = ("alone, +- standard error", *(f"{name.replace('_', ' ')}, {unit}" for name, (_, unit) in units.items()))
    rows = []
    for name, own in found.of_each.items():
        said = {
            c.name: f"{c.value * units[c.name][0]:.4g} +- {c.se * units[c.name][0]:.2g}" if c.identified else _untold(c)
            for c in own
            if c.name in units
        }
        rows.append((name, *(said.get(c.name, "-") for c in found.coefficients)))
    return head, rows


def _rows(found: Pooled) -> list[tuple[str, ...]]:
    rows = []
    for c in found.coefficients:
        scale, unit = shown_unit(c)
        low, high = (end * scale for end in c.interval)
        interval = f"{low:.4g} .. {high:.4g}" if c.identified else _untold(c)
        change = "-" if c.change is None or not c.identified else f"{c.change:+.1%}"
        apart = f"{c.apart:+.1f}" if c.identified else "-"
        name = f"{c.name.replace('_', ' ')}, {unit}"
        value = f"{c.value * scale:.4g}" if c.identified else "-"  # a number beside "not bounded" would be quoted
        rows.append((name, value, interval, f"{c.nominal * scale:.4g}", change, apart))
    return rows


def _untold(c: Coefficient) -> str:
    """Why there is no interval."""
    return AT_BOUND if c.at_limit and c.bounded else "not bounded"


def pooled_lines(found: Pooled) -> list[str]:
    """What is to be said below the table."""
    lines = [
        f"{c.name.replace('_', ' ')} ended at the bound of what is searched, {c.value:.4g} {c.unit}: not identified, "
        f"but a sign that the rig's model lacks something{LATE if c.name == 'damping' and c.value < 0 else ''}"
        for c in found.coefficients
        if c.at_limit
    ]
    lines += [*found.contradictions, *chain.from_iterable(found.disagreements.values())]
    if found.held_out:
        lines.append(f"held out, and not used: {', '.join(found.held_out)}")
    if found.gain is not None and (text := gain_line(found.gain)):
        lines.append(text)
    if found.misfit > 1.1:
        lines.append(
            f"the rig's model leaves {found.misfit:.2g} times the noise: intervals are widened for it; "
            "`maglev diagnose` looks for what is missing"
        )
    return [*lines, *found.notes]


def apart_lines(axes: Sequence[tuple[str, Identification]], found: Pooled) -> list[str]:
    """Where the response of a recording (file, identification) gives another gain or stiffness than the rig's fit."""
    lines = []
    fitted = {c.name: c for c in found.coefficients if c.identified}
    for file, one in axes:
        if one.actuator is None:
            continue
        a, said = one.actuator, []
        for name, value, se in (
            ("actuator_gain", a.gain, a.gain_se),
            ("negative_stiffness", a.stiffness, a.stiffness_se),
        ):
            c = fitted.get(name)
            if c is None or abs(value - c.value) <= APART * float(np.hypot(se, c.se)):
                continue
            scale, unit = prefixed(c.value, c.unit)
            own, both = (f"{v * scale:.4g} +- {NORMAL_95 * e * scale:.2g}" for v, e in ((value, se), (c.value, c.se)))
            said.append(f"{name.replace('_', ' ')} {own} {unit}, where the rig's fit to all recordings gives {both}")
        if said:
            lines.append(f"{file}: its response alone gives {' and '.join(said)} (95 %); {SMALL}")
    return lines


def pooled_json(found: Pooled) -> dict[str, Any]:
    """The pooled estimate as JSON data, SI; what is not bounded has no interval."""
    return {
        "coefficients": [_coefficient(c) for c in found.coefficients],
        "misfit": found.misfit,
        "disagreements": list(chain.from_iterable(found.disagreements.values())),
        "contradictions": list(found.contradictions),
        "held_out": list(found.held_out),
        "notes": list(found.notes),
        "second_body": None if found.second_body is None else asdict(found.second_body),
        "gain_over_frequency": gain_json(found.gain) if found.gain is not None else None,
        "recordings": {name: [_coefficient(c) for c in own] for name, own in found.of_each.items()},
    }


def _coefficient(c: Coefficient) -> dict[str, Any]:
    return {
        "name": c.name,
        "unit": c.unit,
        "value": c.value,
        "se": None if c.at_limit else c.se,
        "interval": list(c.interval) if c.identified else None,
        "nominal": c.nominal,
        "change": c.change,
        "at_limit": c.at_limit,
    }
