"""The next recording that a campaign's tuning proposes, or the gains to keep, as tables, page and JSON."""

from collections.abc import Iterable, Sequence
from dataclasses import asdict
from html import escape
from math import floor, inf, log10
from typing import TYPE_CHECKING, Any

import numpy as np

from estimation.normal import NORMAL_95
from maglev_env.evaluation.goal_score import in_words as requirement_in_words
from maglev_env.recordings.formats.json_data import plain
from maglev_workbench.commands.tune.next_recording import digits, excitation_words, in_words, summary
from maglev_workbench.commands.tune.report import gain_heads
from maglev_workbench.page import (
    COLOURS,
    labelled_axis,
    mark_iso_zones,
    note,
    number,
    page,
    rig_facts,
    shaded,
    styled,
    table,
    with_interval,
)
from tuning.campaign.advice import Advice
from tuning.campaign.candidates import Prediction
from tuning.campaign.gain_set import Shown

if TYPE_CHECKING:
    import rich.table
    from plotly.graph_objects import Figure

SHOWN = ("stiffness kN/m", "damping N s/m", "peak |S|", "gain margin", "phase margin °", "score")
UNIT = {
    "mass": "kg",
    "actuator_gain": "N/A",
    "negative_stiffness": "N/m",
    "support_stiffness": "N/m",
    "delay": "s",
    "sensor_lag": "s",
}
WORDS = {
    "score": "score",
    "peak_sensitivity": "peak |S|",
    "gain_margin_high": "upper gain margin",
    "phase_margin": "phase margin °",
    "displacement": "peak displacement over clearance",
}
PREDICTED = ("figure", "expected", "95 %")


def campaign_tables(advice: Advice) -> "Iterable[str | rich.table.Table]":
    """Tables for a terminal, before the summary."""
    from rich import box
    from rich.table import Table

    blocks = (
        ("What the recordings showed", ("recordings", *gain_heads(advice.task.box), *SHOWN), _set_rows(advice)),
        ("Identified rig", ("parameter", "identified", "nominal"), _rig_rows(advice)),
        ("Predicted at the gains to record", PREDICTED, _values_rows(advice, advice.prediction)),
        ("What the gains to keep reach", PREDICTED, _values_rows(advice, _kept(advice))),
    )
    for title, head, rows in blocks:
        if rows:
            grid = Table(box=box.SIMPLE_HEAD, collapse_padding=True, pad_edge=False, title=title)
            for i, name in enumerate(head):
                grid.add_column(name, justify="right" if i else "left")
            for row in rows:
                grid.add_row(*row)
            yield grid
    yield from (f"note: {text}" for text in advice.notes)
    for i, reason in advice.refused:
        yield f"not kept: {in_words(advice, advice.sets[i].gains)}: {reason}"


def campaign_page(advice: Advice, block: str, made_by: dict[str, str], further: Sequence[str] = ()) -> str:
    """The HTML page of one call, with further notes."""
    sections: list[tuple[str, str | Figure]] = []
    if any(s.sensitivity for s in advice.sets):
        sections.append(("Sensitivity of the loop", sensitivity_figure(advice)))
    if rows := _set_rows(advice):
        sections.append(
            ("What the recordings showed", table(("recordings", *gain_heads(advice.task.box), *SHOWN), rows))
        )
    if rows := _rig_rows(advice):
        sections.append(("Identified rig", table(("parameter", "identified (95 %)", "nominal"), rows)))
    if rows := _values_rows(advice, advice.prediction):
        sections.append(("Predicted at the gains to record", table(PREDICTED, rows)))
    if rows := _values_rows(advice, _kept(advice)):
        sections.append(("What the gains to keep reach", table(PREDICTED, rows)))
    excited = "; ".join(excitation_words(advice))
    sections.append(("To paste" if advice.stop else "To record", note(excited) + f"<pre>{escape(block)}</pre>"))
    refused = [(in_words(advice, advice.sets[i].gains), reason) for i, reason in advice.refused]
    if refused:
        sections.append(("Not kept", table(("gains", "why"), refused)))
    sections += [("", note(text)) for text in (*advice.notes, *further)]
    made = {**rig_facts(plain(asdict(advice.task.rig))), **made_by, "Tuned": ", ".join(advice.task.box.names)}
    return page(f"Tuning of {advice.task.name} on the bench", summary(advice), sections, made)


def campaign_json(advice: Advice, made_by: dict[str, Any]) -> dict[str, Any]:
    """JSON data of schema maglev-tune-campaign/2."""
    sets = [
        {
            "gains": asdict(s.gains), "recordings": s.files, "failed": s.failed, "untold": s.untold,
            "shown": one, "claimed": p and _predicted_json(p),
        }
        for s, one, p in zip(advice.sets, advice.shown, advice.claimed, strict=True)
    ]  # fmt: skip
    rig = None
    if advice.identified:
        told = advice.identified.told()
        rig = {
            "parameters": {n: {"value": v, "se": e, "nominal": o} for n, (v, e, o) in told.items()},
            "misfit": advice.identified.misfit,
        }
    return plain(
        {
            "schema": "maglev-tune-campaign/2",
            "made_by": made_by,
            "sets": sets,
            "identified": rig,
            "next": advice.next and asdict(advice.next),
            "kind": advice.kind,
            "why": advice.why or None,
            "diagnosis": advice.diagnosis and advice.diagnosis.sentence,
            "prediction": advice.prediction and _predicted_json(advice.prediction),
            "share": advice.share,
            "limited": advice.limited,
            "stop": advice.stop,
            "keep": None if advice.keep is None else asdict(advice.sets[advice.keep].gains),
            "claim": (kept := _kept(advice)) and _predicted_json(kept),
            "refused": [{"gains": asdict(advice.sets[i].gains), "reason": reason} for i, reason in advice.refused],
            "notes": advice.notes,
        }
    )


def sensitivity_figure(advice: Advice) -> "Figure":
    """|S| as measured at every gain set, and as predicted at the next gains."""
    import plotly.graph_objects as go

    figure = go.Figure()
    for i, s in enumerate(advice.sets):
        if s.sensitivity is not None:
            words = ", ".join(
                f"{n} {digits(getattr(s.gains, n))}" for n in advice.task.box.names
            )  # short, for the legend
            width = 2.5 if i == advice.keep else 1.2
            figure.add_scatter(
                x=s.sensitivity.frequency,
                y=np.abs(s.sensitivity.value),
                mode="lines",
                name=words,
                line={"width": width},
            )
    if advice.prediction:
        frequency, size, low, high = advice.prediction.response
        figure.add_trace(shaded(frequency, low, high, COLOURS[1]))
        line = {"color": COLOURS[1], "dash": "dash", "width": 2.5}
        figure.add_scatter(x=frequency, y=size, mode="lines", name="predicted at the next gains", line=line)
    mark_iso_zones(figure)
    known = [s.sensitivity.frequency for s in advice.sets if s.sensitivity is not None]
    if known:
        figure.update_xaxes(**labelled_axis("frequency, Hz", np.concatenate(known), log=True))
    figure.update_yaxes(title_text="|S|", rangemode="tozero")
    return styled(figure, 420)


def _set_rows(advice: Advice) -> list[tuple[str, ...]]:
    rows = []
    for i, (s, one, claimed) in enumerate(zip(advice.sets, advice.shown, advice.claimed, strict=True)):
        mark = " (keep)" if i == advice.keep else ""
        gains = tuple(digits(getattr(s.gains, n)) for n in advice.task.box.names)
        figures = _figures(one, claimed) if one else ("failed" if s.failed else "not told", *["–"] * 5)
        rows.append((", ".join(s.files) + mark, *gains, *figures))
    return rows


def _figures(one: Shown, claimed: Prediction) -> tuple[str, ...]:
    k, k_se, c, c_se = one.stiffness / 1e3, one.stiffness_se / 1e3, one.damping, one.damping_se
    coefficients = (_pm(k, k_se), _pm(c, c_se))
    m = one.margins
    names = ("peak_sensitivity", "gain_margin_high", "phase_margin")
    margins = [with_interval(getattr(m, n), *m.intervals[n]) for n in names] if m else ["–"] * 3
    return (*coefficients, *margins, with_interval(*vars(claimed.score).values()))


def _pm(value: float, se: float) -> str:
    return with_interval(value, value - NORMAL_95 * se, value + NORMAL_95 * se)


def _identified(value: float, se: float) -> str:
    """A value to the digits that its standard error leaves."""
    half = NORMAL_95 * se
    if not 0 < half < inf:
        return f"{value:.5g}"
    last = floor(log10(half)) - 1
    return f"{float(f'{value / 10.0**last:.0f}') * 10.0**last:.6g} ± {number(half, 2)}"


def _rig_rows(advice: Advice) -> list[tuple[str, ...]]:
    if advice.identified is None:
        return []
    rows = [
        (
            f"{name.replace('_', ' ')} {UNIT.get(name, 's' if name.endswith('time_constant') else '')}".strip(),
            _identified(v, e),
            f"{o:.5g}",
        )
        for name, (v, e, o) in advice.identified.told().items()
    ]
    return [*rows, ("misfit (1: noise and model error)", f"{advice.identified.misfit:.2g}", "")]


def _kept(advice: Advice) -> Prediction | None:
    return None if advice.keep is None else advice.claimed[advice.keep]


def _values_rows(advice: Advice, p: Prediction | None) -> list[tuple[str, ...]]:
    """Figures of gains; those of the goal with their limits."""
    if p is None:
        return []
    rows = [
        (words, number(v.value), f"{number(v.low)} .. {number(v.high)}")
        for name, words in WORDS.items()
        if not np.isnan((v := p.values[name]).value)
    ]
    goal = advice.task.layout.goal
    for one in goal.measured if goal else ():
        v, (scale, unit) = p.values[one.name], one.quantity.shown
        words = requirement_in_words(one) if one in goal.requirements else f"{one.quantity.words} (best) {unit}".strip()
        states = (("not met", p.missed), ("not surely met", p.unsure), ("in simulation only", p.simulated))
        state = next((f" – {words}" for words, names in states if one.name in names), "")
        ends = f"{number(scale * v.low)} .. {number(scale * v.high)} {unit}".strip()
        rows.append((words, f"{number(scale * v.value)} {unit}".strip() + state, ends))
    return rows


def _predicted_json(p: Prediction) -> dict[str, Any]:
    return {
        "score": p.score.value, "low": p.score.low, "high": p.score.high, "expected": p.expected, "reason": p.reason,
        "values": p.values, "met": p.met, "missed": p.missed, "unsure": p.unsure, "simulated": p.simulated,
    }  # fmt: skip
