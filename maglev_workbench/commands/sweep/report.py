"""Reports of a sweep: the best gain sets, a JSON summary, and one page of maps with the stability border."""

import json
from collections.abc import Iterator, Mapping, Sequence
from importlib.metadata import version
from typing import TYPE_CHECKING, Any

import numpy as np

from estimation.normal import NORMAL_95
from maglev_env.evaluation.score import WEIGHTS
from maglev_env.recordings.formats.json_data import plain
from maglev_env.rig.goal import MATCH, Goal, parse_goal
from maglev_workbench.commands.sweep.figures import best_bands, gains_in_words, over_gains, shown_gains
from maglev_workbench.goal_page import (
    BETWEEN,
    HEAD,
    PREFIX,
    front_figure,
    missed_in_words,
    pair_of,
    requirement_bars,
    requirement_rows,
    requirements_json,
    shown_names,
    values_of,
)
from maglev_workbench.page import effects_in_words, note, number, page, rig_facts, table, with_interval
from tuning.swept_sets import SweptSets

if TYPE_CHECKING:
    import rich.table
    from plotly.graph_objects import Figure

MOST_DRAWN = 20_000  # gain sets on a page: some 10 MB
_HEAD = ("score", "stiffness\nkN/m", "damping\nN s/m", "peak |S|\n",
         "phase\nmargin °", "gain\nmargins", "peak\nµm", "coil\nA rms")  # fmt: skip
_IN_TERMINAL = 5  # of _HEAD, behind the gains


def best_rows(sets: SweptSets, count: int = 10) -> list[dict[str, Any]]:
    """The best feasible gain sets, best first, as JSON data in SI; margins outside the excited lines are None.

    Each: experiment, gains, score, terms, stiffness and damping with *_ci (95 %, an unbounded end None),
    peak_sensitivity with _se, phase_margin (deg), gain_margin_low and _high, peak_displacement, current_rms; of a goal
    required_* with _low and _high; and where the lines hide a sharp resonance, between_lines_*.
    """
    gains = list(sets.shown)
    values = {name: sets[name] for name in (*sets.names, *gains, "experiment")}
    order = np.argsort(-np.where(values["feasible"], values["score"], -np.inf), kind="stable")
    direct = ("experiment", "score", "stiffness", "damping", "peak_sensitivity", "peak_sensitivity_se", "phase_margin",
              "gain_margin_low", "gain_margin_high", "peak_displacement", "current_rms")  # fmt: skip
    rows = []
    for i in order[: min(count, int(values["feasible"].sum()))]:
        row: dict[str, Any] = {name: values[name][i] for name in direct}
        row["gains"] = {name: values[name][i] for name in gains}
        row["terms"] = {name[5:]: values[name][i] for name in values if name.startswith("term_")}
        row |= {name: values[name][i] for name in values if name.startswith(PREFIX)}
        row |= {name: v[i] for name, v in values.items() if name.startswith(BETWEEN) and np.isfinite(v[i])}
        for name in ("stiffness", "damping"):
            row[f"{name}_ci"] = (values[f"{name}_low"][i], values[f"{name}_high"][i])
        rows.append(plain(row))
    return rows


def sweep_goal(sets: SweptSets) -> Goal | None:
    """The goal that the sets were scored by; None for `match`."""
    rig = json.loads(sets.attrs.get("rig", "{}"))
    text = rig.get("target", {}).get("goal", MATCH)
    return None if text == MATCH else parse_goal(text)


def sweep_tables(sets: SweptSets) -> "Iterator[str | rich.table.Table]":
    """Tables for a terminal: the best gain sets, and how the best one stands to the goal's requirements."""
    from rich import box
    from rich.table import Table

    yield sweep_table(sets)
    goal, best = sweep_goal(sets), best_rows(sets, 1)
    if goal and best:
        grid = Table(box=box.SIMPLE_HEAD, collapse_padding=True, pad_edge=False, title="The best set and its goal")
        for i, name in enumerate(HEAD):
            grid.add_column(name, justify="left" if i in (0, 3) else "right")
        for row in requirement_rows(goal, best[0]):
            grid.add_row(*row)
        yield grid


def sweep_table(sets: SweptSets, count: int = 10) -> "rich.table.Table":
    """Table of the best gain sets in 80 columns; margins, displacement and current are in the page and the dataset."""
    from rich import box
    from rich.table import Table

    rows = best_rows(sets, count)
    result = Table(box=box.SIMPLE_HEAD, collapse_padding=True, pad_edge=False, title=_counts(sets))
    head = _head(sets)
    columns = len(head) - len(_HEAD) + _IN_TERMINAL
    for name in head[:columns]:
        result.add_column(name, justify="right")
    for i, row in enumerate(rows):
        result.add_row(*_cells(sets, i, row)[:columns], style="bold" if i == 0 else "")
    result.caption = "± and [ ]: 95 % intervals; – : not within the excited lines" if rows else "nothing feasible"
    return result


def sweep_summary(sets: SweptSets, seconds: float, reused: int) -> dict[str, Any]:
    """The sweep as JSON data, schema maglev-sweep/1, gains in SI; reused: experiments read from the folder."""
    n, rows = len(sets), best_rows(sets, 1)
    goal, of_goal = sweep_goal(sets), {}
    if goal:
        of_goal = {"goal": goal.text, "requirements": requirements_json(goal, rows[0]) if rows else None}
    return {
        "schema": "maglev-sweep/1",
        "version": version("maglev-workbench"),
        "n": n,
        "stable": int((sets["pole_radius"] < 1).sum()),
        "feasible": int(sets["feasible"].sum()),
        "best": {n: v for n, v in rows[0].items() if not n.startswith(PREFIX)} if rows else None,
        **of_goal,
        "seconds": float(seconds),
        "experiments_per_second": (n - reused) / seconds if n > reused and seconds > 0 else None,
        "reused": int(reused),
    }


def sweep_page(sets: SweptSets) -> str:
    """The HTML of a sweep: best gain sets, maps (grid), lines (one swept gain) or points (scattered), best spectra."""
    rig = json.loads(sets.attrs.get("rig", "{}"))
    band = rig.get("target", {}).get("band")
    where = f" Stiffness and damping: maximum likelihood over {band[0]:g} to {band[1]:g} Hz." if band else ""
    rows, goal = best_rows(sets), sweep_goal(sets)
    sections: list[tuple[str, str | Figure]] = []
    if rows:
        best = dict(zip(_head(sets), _cells(sets, 0, rows[0]), strict=True))
        gains = ", ".join(f"{g} {best[_column(g, sets)]} {sets.shown[g][1]}".rstrip() for g in shown_gains(sets))
        summary = (
            f"{_counts(sets)}. Best: {gains} with score {best['score']}: stiffness {best[_HEAD[1]]} kN/m, damping "
            f"{best[_HEAD[2]]} N s/m, peak |S| {best[_HEAD[3]]}."
        )
        best = table(_head(sets), [_cells(sets, i, row) for i, row in enumerate(rows)])
        sections.append(("Best gain sets", f'<div class="best">{best}</div>'))
        sections.append(("", note("± and [ ] are 95 % intervals; – : not within the excited lines." + where)))
        if goal:
            sections += _goal_sections(sets, goal, rows)
        if goal and goal.requirements:
            summary += f" It {missed_in_words(goal, rows[0])}."
        sections += over_gains(drawn := _drawn(sets))
        if drawn is not sets:
            sections.append(("", note(f"Drawn: the best {MOST_DRAWN:,} of {len(sets):,} gain sets.")))
        sections.append(("Stiffness and damping against frequency, best three", best_bands(sets, rows[:3])))
        sections.append(
            (
                "",
                note(
                    "Maximum likelihood in sliding bands, drawn at their centres; shaded: 95 %. A steep end may "
                    "leave the panel: double-click shows all."
                ),
            )
        )
        weights = {} if goal else WEIGHTS
        named = [(name.replace("_", " "), weights.get(name)) for name in rows[0]["terms"]]
        head = ("", "score", *(f"{name}\n{weight:.0%}" if weight else name for name, weight in named))
        terms = [[str(i + 1), *(number(v, 2) for v in (r["score"], *r["terms"].values()))] for i, r in enumerate(rows)]
        sections.append(("What the scores are made of", table(head, terms)))
        how = "the score is their product, of which what is made best makes the upper half: docs/goals.md"
        text = "Terms from 0 to 1, 1 where the target is met; " + (how if goal else "below each name its weight") + "."
        sections.append(("", note(text)))
    else:
        near = int(sets["pole_radius"].argmin())
        summary = f"{_counts(sets)}: there is no best gain set."
        gains, radius = gains_in_words(sets)[near], float(sets["pole_radius"][near])
        why = "unstable" if radius >= 1 else "stable, yet the excitation makes it touch down"
        sections.append(
            (
                "Nearest to a stable loop",
                note(f"{gains}: largest pole radius {radius:.4f}, {why}."),
            )
        )
    return page(f"Gain sweep of {rig.get('name', 'a rig')}", summary, sections, _made_by(sets, rig))


def _drawn(sets: SweptSets) -> SweptSets:
    """The experiments that a page draws: all, or the best MOST_DRAWN, because more would make a page too large."""
    if len(sets) <= MOST_DRAWN:
        return sets
    score = np.where(sets["feasible"], sets["score"], -1.0)
    best = np.sort(np.argpartition(-score, MOST_DRAWN)[:MOST_DRAWN])
    return sets.some(best)


def _goal_sections(sets: SweptSets, goal: Goal, rows: Sequence[Mapping[str, Any]]) -> "list[tuple[str, str | Figure]]":
    sets = _drawn(sets)
    columns = {name: sets[name] for name in sets.names}
    values, feasible = values_of(columns, shown_names(goal)), sets["feasible"].astype(bool)
    best_three = [(f"{i + 1}", row) for i, row in enumerate(rows[:3])]
    hover = gains_in_words(sets)
    best = int(np.flatnonzero(sets["experiment"] == rows[0]["experiment"])[0])
    first, second = (r.quantity.words for r in pair_of(goal))
    bars = [("Requirements of the best three", requirement_bars(goal, best_three))] if goal.requirements else []
    return [
        *bars,
        ("" if bars else "The best set and its goal", table(HEAD, requirement_rows(goal, rows[0]))),
        (
            f"{first} against {second}".capitalize(),
            front_figure(goal, values, feasible, best, hover),
        ),
        ("", note("Dashed: the limits. A set on the front is bettered by no other set in both.")),
    ]


def gain_sets(n: int) -> str:
    """So many gain sets, in words."""
    return f"{n} gain set{'' if n == 1 else 's'}"


def _counts(sets: SweptSets) -> str:
    n, stable = len(sets), int(sets["feasible"].sum())
    touched = int((~np.isnan(sets["touchdown_time"])).sum())
    return (
        f"{stable} of {gain_sets(n)} {'is' if n == 1 else 'are'} feasible; {touched} "
        f"({100 * touched / n:.0f} %) touched down, "
        f"{n - stable - touched} more have an unstable loop"
    )


def _column(gain: str, sets: SweptSets) -> str:
    return f"{gain.replace('_', ' ')}\n{sets.shown[gain][1]}"


def _head(sets: SweptSets) -> tuple[str, ...]:
    return ("", *(_column(gain, sets) for gain in shown_gains(sets)), *_HEAD)


def _cells(sets: SweptSets, index: int, row: Mapping[str, Any]) -> list[str]:
    k, c = row["stiffness"], row["damping"]
    k_low, k_high = (None if end is None else end / 1e3 for end in row["stiffness_ci"])
    ms, se = row["peak_sensitivity"], row["peak_sensitivity_se"]
    half = np.nan if se is None else NORMAL_95 * se
    return [
        str(index + 1),
        *(number(row["gains"][name] * sets.shown[name][0]) for name in shown_gains(sets)),
        number(row["score"]),
        with_interval(k and k / 1e3, k_low, k_high),
        with_interval(c, *row["damping_ci"]),
        "–" if ms is None else with_interval(ms, ms - half, ms + half),
        number(row["phase_margin"]),
        f"{number(row['gain_margin_low'], 2)}; {number(row['gain_margin_high'], 2)}",
        number(row["peak_displacement"] * 1e6),
        number(row["current_rms"]),
    ]


def _made_by(sets: SweptSets, rig: Mapping[str, Any]) -> dict[str, object]:
    axes = []
    for name, axis in json.loads(sets.attrs.get("axes", "{}")).items():
        scale, unit = sets.shown[name]
        ends = f"{axis['low'] * scale:g} to {axis['high'] * scale:g} {unit}".rstrip()
        axes.append(f"{name} {ends}, {axis['points']} points")
    spacing = "logarithmic" if sets.attrs.get("log") == "true" else "linear"
    sobol = sets.attrs.get("sobol", "0")
    kind = f"{spacing} grid" if sobol == "0" else f"{sobol} Sobol points, {spacing}"
    effects = effects_in_words(json.loads(sets.attrs.get("effects", "{}")))
    sensor = sets.attrs.get("sensor", "probe").replace("_", "-")
    known = {"Sensor": sensor, "Effects": effects, "Swept": f"{kind}: {'; '.join(axes)}"}
    stated = {
        name.capitalize(): sets.attrs[name] for name in ("seed", "device", "version", "identity") if name in sets.attrs
    }
    return rig_facts(rig) | known | stated
