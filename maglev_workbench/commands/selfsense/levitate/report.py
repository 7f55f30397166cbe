"""Comparison of self-sensing and probe in a levitation loop: console table, page and JSON."""

from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np

from estimation.iso_14839 import iso_14839_3_zone
from estimation.normal import NORMAL_95
from maglev_env.evaluation.evaluation import Evaluation
from maglev_env.evaluation.score import WEIGHTS
from maglev_workbench.commands.selfsense.levitate.experiments import SEEDS, SENSORS, Comparison
from maglev_workbench.commands.selfsense.levitate.figures import NAMES, coefficients, cost_map, piece, sensitivity
from maglev_workbench.commands.selfsense.levitate.numbers import (
    ERRORS,
    ESTIMATED,
    MODELLED,
    QUANTITIES,
    levitates,
    values,
    worse_axis,
)
from maglev_workbench.commands.selfsense.loop_facts import loop_facts, mean_in_words
from maglev_workbench.page import note, number, page, table, with_interval
from selfsense.demodulation import ripple_amplitude

if TYPE_CHECKING:
    import rich.table
    from plotly.graph_objects import Figure


def levitate_table(c: Comparison) -> "rich.table.Table":
    """The comparison in 80 columns."""
    from rich import box
    from rich.table import Table

    result = Table(box=box.SIMPLE_HEAD, pad_edge=False, title=f"{c.rig.name} at its preset gains")
    for name in ("", "probe", "self-sensing", "difference"):
        result.add_column(name, justify="left" if not name else "right")
    for name, (label, factor) in QUANTITIES.items():
        result.add_row(label, *(_one(c.preset[s], name, factor) for s in SENSORS), _difference(c, name, factor))
    for name, (label, factor) in ERRORS.items():
        result.add_row(label, "", mean_in_words(values(c.preset["self_sensing"], name) * factor), "")
    result.caption = f"±, [ ]: 95 %. Differences, gap errors and lags: means of {SEEDS} experiments."
    return result


def levitate_summary(c: Comparison) -> str:
    """Sentences on the losses by self-sensing."""
    probe, sensed = (c.preset[s] for s in SENSORS)
    if not levitates(c, "self_sensing"):
        return f"{_failure(c)} {_counts(c)}"
    if not levitates(c, "probe"):
        return f"{c.rig.name} levitates with self-sensing, but not with the probe. {_counts(c)}"
    peaks = [values(e, "peak_sensitivity").mean() for e in (probe, sensed)]
    zones = [iso_14839_3_zone(peak) for peak in peaks]
    where = f"ISO 14839-3 zone {zones[0]}" + ("" if zones[0] == zones[1] else f" to {zones[1]}")
    return (
        f"{c.rig.name} levitates with self-sensing. It costs {mean_in_words(sensed.margin_lost)}° of "
        f"{number(np.nanmean(values(probe, 'phase_margin')))}° phase margin; peak |S| goes from {number(peaks[0])} to "
        f"{number(peaks[1])} ({where}), the score from {number(probe.score.mean())} to {number(sensed.score.mean())}; "
        f"the sensed gap is off by {number(1e6 * sensed.gap_error_rms.mean(), 2)} µm rms. {_counts(c)}"
    )


def levitate_page(c: Comparison) -> str:
    """The HTML of the comparison."""
    sections: list[tuple[str, str | Figure]] = []
    head = (
        "",
        "probe",
        "probe,\nlinear model",
        "self-sensing",
        "self-sensing,\nlinear model",
        "self-sensing\nless probe",
    )
    rows = []
    for name, (label, factor) in QUANTITIES.items():
        cells = []
        for s in SENSORS:
            cells.append(_one(c.preset[s], name, factor))
            cells.append(number(c.curves[s].model_margins.get(name)) if name in MODELLED else "")
        rows.append([label, *cells, _difference(c, name, factor)])
    sections.append((f"{c.rig.name} at its preset gains", table(head, rows)))
    low, high = c.rig.target.band
    text = f"One experiment with each sensor; ± and [ ]: 95 %. Stiffness and damping: {low:g} to {high:g} Hz. "
    text += f"Last column: mean of {SEEDS} pairs of experiments. A gain margin far from 1 lies where S hardly differs "
    text += "from 1 and is mostly noise: the linear model's is the better number."
    sections.append(("", note(text + _axes_note(c))))
    if levitates(c, "self_sensing"):
        added = c.preset["self_sensing"]
        rows = [[label, mean_in_words(values(added, name) * factor)] for name, (label, factor) in ERRORS.items()]
        sections.append(("What self-sensing adds", table(("", f"mean of {SEEDS}"), rows)))
        text = (
            "Gap error: reading less true displacement. Phase margin lost: what the loop would have with the probe's "
        )
        text += "lag in place of that which self-sensing showed, less what it had."
        sections.append(("", note(text)))
    head = ("", *(f"{name.replace('_', ' ')}\n{weight:.0%}" for name, weight in WEIGHTS.items()), "score")
    terms = []
    for s in SENSORS:
        e = c.preset[s]
        terms.append([NAMES[s], *(number(e.terms[t].mean()) for t in WEIGHTS), number(e.score.mean())])
    sections.append(("What the score is made of", table(head, terms)))
    sections.append(("", note(f"Terms from 0 to 1, 1 where the target is met; means of {SEEDS} experiments.")))
    sections.append(("Sensitivity |S| of both loops", sensitivity(c.curves)))
    text = "Dots: injection lines with 95 % intervals. Lines: the linear model. What the peak gains by self-sensing is "
    text += "distance to instability lost. Dashed across: where the zones of ISO 14839-3 meet."
    sections.append(("", note(text)))
    sections.append(("Stiffness and damping against frequency", coefficients(c.preset)))
    text = "Maximum likelihood in sliding bands at their centres; shaded: 95 %. Where the bands part, self-sensing has "
    sections.append(("", note(text + "changed the support. A steep end may leave the panel: double-click shows all.")))
    sections.append((f"Position and what was read, {c.piece.why}", piece(c.piece)))
    text = "The reading lags behind the position and carries the noise of the coil current."
    text = text if levitates(c, "self_sensing") else "A flat reading is an end of the estimator's range."
    sections.append(("", note(text)))
    sections.append(("What it costs over kp and kd", cost_map(c)))
    text = f"{_counts(c)} The other gains stay at the preset (star). Orange: gain sets that only the probe holds. "
    text += "Colours end at the 2nd and 98th percentile. One experiment per cell and sensor: near the borders, where "
    text += "|S| is large, noise shows. Phase margins are the linear model's, for few lines measure them where kd is "
    text += "large; white: no crossover."
    sections.append(("", note(text)))
    return page(f"Self-sensing in the loop of {c.rig.name}", levitate_summary(c), sections, _made_by(c))


def _one(e: Evaluation, name: str, factor: float) -> str:
    """The first experiment's value with its own interval where there is one."""
    value = values(e, name)[0] * factor
    if name in ESTIMATED:
        return with_interval(value, getattr(e, f"{name}_low")[0] * factor, getattr(e, f"{name}_high")[0] * factor)
    if name == "peak_sensitivity":
        half = NORMAL_95 * e.peak_sensitivity_se[0]
        return with_interval(value, value - half, value + half)
    return number(value)


def _difference(c: Comparison, name: str, factor: float) -> str:
    if not all(levitates(c, s) for s in SENSORS):
        return "–"
    return mean_in_words((values(c.preset["self_sensing"], name) - values(c.preset["probe"], name)) * factor)


def _failure(c: Comparison) -> str:
    e = c.preset["self_sensing"]
    touched = e.touchdown_time[np.isfinite(e.touchdown_time)]
    how = f"the rotor touches down after {1e3 * touched.min():.3g} ms" if touched.size else "the loop is unstable"
    if c.quiet_holds:
        own = c.sensors[0]
        ripple = 1e3 * float(ripple_amplitude(own.coil, own.supply, own.gap))
        noise, count = 1e3 * own.acquisition.noise, 1e3 * own.acquisition.resolution
        why = (
            f"Without noise and rounding of the coil current it would: its ripple of {number(ripple)} mA (mean) stands "
        )
        why += f"beside noise of {number(noise)} mA rms and counts of {number(count)} mA; both must be smaller."
    else:
        why = "Without noise it would not either."
    return f"{c.rig.name} does not levitate with self-sensing at its preset gains: {how}. {why}"


def _counts(c: Comparison) -> str:
    probe, sensed = (c.map[s].feasible for s in SENSORS)
    return (
        f"Of {probe.size} gain sets over kp and kd the probe holds {probe.sum()} and self-sensing {sensed.sum()}; "
        f"only the probe holds {(probe & ~sensed).sum()}."
    )


def _axes_note(c: Comparison) -> str:
    if c.rig.axes == 1:
        return ""
    probe, sensed = (worse_axis(c, s) for s in SENSORS)
    return f" Of both axes the one with the lower score: {probe} with the probe, {sensed} with self-sensing."


def _made_by(c: Comparison) -> Mapping[str, object]:
    spacing = "logarithmic" if c.log else "linear"
    of_map = f"{spacing}, {len(c.gains['kp'])} x {len(c.gains['kd'])}"
    return loop_facts(c.rig, c.sensors[0], Map=of_map, Seed=c.seed)
