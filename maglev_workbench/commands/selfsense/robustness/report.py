"""Influence of wrong parameters on a self-sensor and its loop: console table, page and JSON."""

from dataclasses import asdict
from importlib.metadata import version
from typing import TYPE_CHECKING, Any

import numpy as np

from maglev_env.loop.gains import as_table
from maglev_env.recordings.formats.json_data import plain
from maglev_workbench.commands.selfsense.loop_facts import loop_facts, mean_with_half_width
from maglev_workbench.commands.selfsense.robustness.experiments import (
    AS_BELIEVED,
    REACH,
    SEEDS,
    Loop,
    Mismatch,
    Robustness,
    change_of,
)
from maglev_workbench.commands.selfsense.robustness.figures import robustness_figure
from maglev_workbench.page import note, number, page, table, with_interval

if TYPE_CHECKING:
    import rich.table

LOOPS = ("raw", "calibrated")
_LOST = "falls"


def robustness_table(r: Robustness) -> "rich.table.Table":
    """The mismatches in 80 columns; changes of margin and peak are in the page."""
    from rich import box
    from rich.table import Table

    title = f"Mismatches of {_rig(r)}"
    result = Table(box=box.SIMPLE_HEAD, padding=0, show_edge=False, title=title)
    result.add_column("", no_wrap=True)
    for head in ("error\nat rest\nµm", "\n\ngain", "rms\nerror\nµm", "cali-\nbra-\nted", "sup-\npres-\nsion"):
        result.add_column(f" {head}".replace("\n", "\n "), justify="right", no_wrap=True)
    for head in ("phase\nmargin\n°", "cali-\nbra-\nted", "peak\n|S|\n", "cali-\nbra-\nted"):
        result.add_column(f" {head}".replace("\n", "\n "), justify="right", no_wrap=True)
    for name, row in r.rows.items():
        loops = [_cell(getattr(row, of), quantity) for quantity in _LOOP for of in LOOPS]
        result.add_row(name, *_alone(row)[:5], *loops, style="bold" if name == AS_BELIEVED else "")
    result.caption = "Suppression: rms error of demodulation over the estimator's, both calibrated.\n"
    result.caption += f"Phase margin, peak |S|: of the levitation loop; {_LOST}: it does not levitate."
    return result


def robustness_summary(r: Robustness) -> str:
    """Sentences on the influence of wrong parameters and on the benefit of a calibration."""
    wrong = {name: row.errors for name, row in r.rows.items() if name != AS_BELIEVED}
    at_rest = max(wrong, key=lambda name: abs(wrong[name].offset))
    raw, mended = (max(wrong, key=lambda name: getattr(wrong[name], of)) for of in ("raw", "estimator"))
    text = (
        f"A wrong belief moves the gap of {_rig(r)} at rest by up to {_um(abs(wrong[at_rest].offset))} µm ({at_rest}). "
    )
    text += f"A static calibration takes the largest rms error from {_um(wrong[raw].raw)} µm ({raw}) to "
    text += f"{_um(wrong[mended].estimator)} µm ({mended}); without any mismatch it is "
    text += f"{_um(r.rows[AS_BELIEVED].errors.estimator)} µm, the estimator's lag."
    if not r.rows[AS_BELIEVED].raw.levitates.all():
        return f"{text} In the loop it does not levitate even without a mismatch: see maglev selfsense levitate."
    for of, words in zip(LOOPS, ("as the sensor reads", "calibrated"), strict=True):
        loops = {name: getattr(r.rows[name], of) for name in wrong}
        lost = [name for name, loop in loops.items() if not loop.levitates.all()]
        if lost:
            text += f" In the loop, {words}, it does not levitate with: {', '.join(lost)}."
            continue
        change = {name: change_of(r, loop, "phase_margin") for name, loop in loops.items()}
        worst = min(change, key=lambda name: change[name][0])
        taken, half = -change[worst][0], change[worst][1]
        cost = with_interval(taken, taken - half, taken + half)
        text += f" In the loop, {words}, the worst one takes {cost}° of phase margin ({worst})."
    return text


def robustness_json(r: Robustness) -> dict[str, Any]:
    """The mismatches as JSON data, schema maglev-selfsense-robustness/1, SI and degrees."""
    rows = []
    for name, row in r.rows.items():
        one = {"name": name, **asdict(row.errors), "suppression": row.errors.suppression}
        one["duty_suppression"] = row.errors.duty_suppression
        for of in LOOPS:
            loop = getattr(row, of)
            means = {
                quantity: mean_with_half_width(getattr(loop, quantity))[0] for quantity in ("gap_error_bias", *_LOOP)
            }
            changes = {f"{q}_change": change_of(r, loop, q) for q in _LOOP}
            pairs = {q: dict(zip(("mean", "half_width"), pair, strict=True)) for q, pair in changes.items()}
            one[f"loop_{of}"] = {"levitates": bool(loop.levitates.all()), **means, **pairs}
        rows.append(one)
    return plain(
        {
            "schema": "maglev-selfsense-robustness/1",
            "version": version("maglev-workbench"),
            "rig": r.plan.rig.name,
            "gains": as_table(r.plan.rig.gains),
            "seed": r.seed,
            "experiments": SEEDS,
            "sensors": [asdict(one[AS_BELIEVED]) for one in r.plan.tables],
            "assumed_core_length": r.plan.assumed_core,
            "rows": rows,
        }
    )


def robustness_page(r: Robustness) -> str:
    """The HTML of the mismatches."""
    head = ("", "error\nat rest\nµm", "gain\n", "rms\nerror\nµm", "rms,\ncali-\nbrated")
    head += ("suppres-\nsion", "of the\nduty\nalone")
    for of in ("in the loop:", "calibrated:"):
        head += (f"{of}\ngap bias\nµm", "phase\nmargin °\n(change)", "peak |S|\n(change)")
    rows = []
    for name, row in r.rows.items():
        cells = [name, *_alone(row)]
        for of in LOOPS:
            loop = getattr(row, of)
            bias = mean_with_half_width(loop.gap_error_bias)[0]
            cells += [_um(bias), *(_cell(loop, q) + _change(r, loop, q) for q in _LOOP)]
        rows.append(cells)
    reach = 1e6 * REACH * r.plan.tables[0][AS_BELIEVED].gap
    sections = [("Mismatches", table(head, rows)), ("", note(_HOW.format(reach=reach))), ("", note(_MENDS))]
    if r.plan.assumed_core:
        core = f"The rig's [self_sensing] gives no core_length: {1e6 * r.plan.assumed_core:.3g} µm are assumed,"
        sections.append(("", note(f"{core} and believed by the estimator.")))
    if _locked(r):
        sections.append(("", note(_LOCKED)))
    sections.append(("Error, phase margin and peak sensitivity", robustness_figure(r)))
    sections.append(("", note(_FIGURE)))
    made_by = loop_facts(r.plan.rig, r.plan.tables[0][AS_BELIEVED], Seed=r.seed)
    return page(f"Robustness of self-sensing on {_rig(r)}", robustness_summary(r), sections, made_by)


_LOOP = ("phase_margin", "peak_sensitivity")
_HOW = (
    "Left, the sensor by itself: the gap moves by ±{reach:g} µm at 100 Hz while the duty moves by ±0.1 about one half, "
    "without noise. Error at rest and gain: of the estimated gap, at half duty. Suppression: rms error of demodulation "
    "alone over that of the estimator, both statically calibrated; and of what the moving duty alone adds. Right, the "
    f"levitation loop at its preset gains, with noise, means of {SEEDS} experiments; gap bias: reading less "
    f"displacement, and the rotor stands off its centre by nearly as much; {_LOST}: it does not levitate. Dead time "
    "acts only where the current keeps its sign over a PWM period: not in a loop whose ripple exceeds its current."
)
_MENDS = (
    "A static calibration mends offset and gain at half duty: all that wrong constants of coil and supply do, and with "
    "them the loop gain. It cannot mend what moves with the duty or the frequency: eddy currents, which jump at every "
    "switching edge and delay the flux, a core whose slope moves with the current, and the estimator's lag. And it "
    "holds for the day on which it was made: supply voltage and a coil's resistance drift later."
)
_FIGURE = (
    "Dots away from the dashed line: what a mismatch does to the sensor as it reads. Diamonds away from it: what a "
    "static calibration leaves. Bars: 95 % of the change. Crosses at the left: does not levitate."
)
_LOCKED = (
    "The current is sampled a whole number of times per PWM period: eddy currents' jump at an edge is then seen by all "
    "periods or by none as the duty moves. A sample_rate of, say, 10.5 times the pwm_frequency averages it."
)


def _rig(r: Robustness) -> str:
    return r.plan.rig.name


def _um(value: float) -> str:
    """A gap (m) in µm to 10 nm, to 0.1 µm from 10 µm on."""
    text = f"{1e6 * value:.{1 if abs(value) >= 1e-5 else 2}f}"
    return "–" if np.isnan(value) else text.replace("-0.00", "0.00")


def _alone(row: Mismatch) -> list[str]:
    e = row.errors
    errors = [_um(e.offset), f"{e.gain:.3f}", _um(e.raw), _um(e.estimator)]
    return [*errors, number(e.suppression), number(e.duty_suppression)]


def _cell(loop: Loop, name: str) -> str:
    return number(np.mean(getattr(loop, name))) if loop.levitates.all() else _LOST


def _change(r: Robustness, loop: Loop, name: str) -> str:
    believed = r.rows[AS_BELIEVED]
    known = loop.levitates.all() and believed.raw.levitates.all()
    if not known or loop is believed.raw or loop is believed.calibrated:
        return ""
    places = 1 if name == "phase_margin" else 2
    return f" ({round(change_of(r, loop, name)[0], places) + 0.0:+.{places}f})"  # + 0.0: no -0.0


def _locked(r: Robustness) -> bool:
    s = r.plan.tables[0][AS_BELIEVED]
    ratio = s.acquisition.rate / s.supply.frequency
    return abs(ratio - round(ratio)) < 1e-9
