"""A comparison of tuners as tables, page, markdown and JSON."""

from importlib.metadata import version
from itertools import zip_longest
from typing import TYPE_CHECKING, Any

import numpy as np

from maglev_env.recordings.formats.json_data import plain
from maglev_env.rig.goal import MATCH
from maglev_workbench.commands.compare.figures import course_figure, improvement_figure, profile_figure
from maglev_workbench.commands.compare.numbers import THRESHOLDS, Table
from maglev_workbench.page import effects_in_words, markdown_table, note, number, page, rig_facts, table
from tuning.comparison.aggregates import LEAST
from tuning.comparison.compare import Comparison

if TYPE_CHECKING:
    import rich.table

TITLE = "Tuners compared"
HEAD = ("budget", "tuner", "median regret", "IQM of regret", "touch-\ndowns\nper 100", "s per\ntuning", "own\n%")
MET = "met\n%"  # behind the regrets, where a goal has requirements
OF_GOAL = (
    "The score is that of the goal of requirements. Met: share of the runs whose gains meet every requirement by the "
    "medians of the fresh experiments, also between their lines. "
)
HOW_TO_READ = (
    "Every tuner had the same budget of experiments, one at a time, on the same rigs, drawn wide around the nominal "
    "and seen by none before. Simple regret: the best score known of a rig (by a long search, or by any tuner here if "
    "that is higher, so that regrets may grow when a better tuner takes part), less the score of the tuner's "
    "best-scored gains when they are measured again under fresh noise; 0 is the best, 1 the worst. IQM: mean of the "
    "middle half. Intervals are 95 % by resampling rigs, with all repeats of each (after Agarwal et al. 2021): what "
    "other rigs drawn alike may give. s per tuning: wall time of one budget on one rig, with all rigs side by side; "
    "own: the share of it in which the tuner chooses, not the experiments. The grid is laid out for the largest "
    "budget; tpe and gp draw their first ten gain sets at random, as Optuna has it. @preset: begins at the rig's own "
    "gains, with small steps; @rule: likewise at the third step of the dissertation's rule, which begins at the rig's "
    "own gains; model begins at these, too, every other tuner between them and random gains. learned gives way to "
    "model where what it observes lies outside its training, and after as many experiments as it was trained for."
)


def compare_table(found: Comparison, of: Table) -> "rich.table.Table":
    """The table for a terminal."""
    from rich import box
    from rich.table import Table as Grid

    grid = Grid(box=box.SIMPLE_HEAD, collapse_padding=True, pad_edge=False, title=_title(found))
    for name in _head(found):
        grid.add_column(name, justify="left" if name == "tuner" else "right")
    rows = _rows(found, of)
    for row, after in zip_longest(rows, rows[1:]):
        front, iqm, rest = row[:3], row[3], row[4:]  # 80 columns have no room for a second interval
        grid.add_row(*front, iqm.split()[0], *rest, end_section=after is None or after[0] != row[0])
    return grid


def summary(found: Comparison, of: Table) -> str:
    """A sentence with the tuners of the least regret at each budget."""
    parts = []
    for n in filter(found.reached, found.budgets):
        best, *others = sorted(found.reached(n), key=lambda m: of[n, m].median[0])
        parts.append(f"after {n} by {best} ({_regret(of[n, best].median)})")
        if others:
            parts[-1] += f", then {others[0]} ({_regret(of[n, others[0]].median)})"
    few = "" if found.made_by["rigs"] >= LEAST else f" Fewer than {LEAST} rigs tell no 95 % interval of a median."
    return f"{_title(found)}. Least median regret: {'; '.join(parts)}.{few}"


def compare_page(found: Comparison, of: Table) -> str:
    """The HTML page of a comparison."""
    sections = [
        ("Results", table(_head(found), _rows(found, of))),
        ("", note(_how_to_read(found))),
        ("Regret against experiments", course_figure(found, of)),
        ("Performance profiles: share of rigs with a regret below", profile_figure(found, of, THRESHOLDS)),
        ("Probability that a tuner (row) does better on a rig than another (column)", improvement_figure(found, of)),
    ]
    made = found.made_by
    facts = {**rig_facts(made["rig"]), "Rigs": f"{made['rigs']}, drawn {made['randomization']}"}
    facts |= {"Goal": goal} if (goal := _goal(found)) else {}
    facts |= {"Effects": effects_in_words(made["effects"]), "Repeats": made["repeats"], "Seed": made["seed"]}
    return page(TITLE, summary(found, of), sections, facts)


def compare_markdown(found: Comparison, of: Table, command: str) -> str:
    """The same as markdown, without the plots; probabilities are given for every pair of tuners at each budget."""
    parts = [f"# {TITLE}", summary(found, of), _how_to_read(found), f"Made by `{command}`."]
    heads = [name.replace("-\n", "").replace("\n", " ") for name in _head(found)]
    parts.append(markdown_table(heads, _rows(found, of)))
    for n in found.budgets:
        names = found.reached(n)
        if len(names) < 2:
            continue
        rows = [(a, *(_chance(of[n, a].better.get(b)) for b in names)) for a in names]
        heading = f"## After {n} experiments: probability that a tuner (row) does better than another (column)"
        parts += [heading, markdown_table(("", *names), rows)]
    return "\n\n".join(parts) + "\n"


def compare_json(found: Comparison, of: Table) -> dict[str, Any]:
    """JSON data of schema maglev-compare/1. Intervals are (value, low, high); scores by rig, repeat and checkpoint."""
    results = [
        {
            "method": m,
            "score": r.score,
            "touchdowns": r.touchdowns,
            "met": r.met,
            "seconds": r.seconds,
            "tuner_seconds": r.tuner_seconds,
            "reused": r.reused,
            "at": [
                {"experiments": n, "regret": found.regret(m, n), **vars(of[n, m])}
                for n in found.checkpoints
                if (n, m) in of
            ],
        }
        for m, r in found.results.items()
    ]
    return plain(
        {
            "schema": "maglev-compare/1",
            "version": version("maglev-workbench"),
            "made_by": found.made_by,
            "budgets": found.budgets,
            "checkpoints": found.checkpoints,
            "thresholds": THRESHOLDS,
            "best": found.best,
            "results": results,
        }
    )


def _goal(found: Comparison) -> str:
    """The requirements by which gains were scored; "" for `match`."""
    goal = found.made_by["rig"]["target"]["goal"]
    return "" if goal == MATCH else goal


def _head(found: Comparison) -> tuple[str, ...]:
    return (*HEAD[:4], MET, *HEAD[4:]) if _goal(found) else HEAD


def _how_to_read(found: Comparison) -> str:
    return (OF_GOAL if _goal(found) else "") + HOW_TO_READ


def _title(found: Comparison) -> str:
    made = found.made_by
    rigs = "1 rig" if made["rigs"] == 1 else f"{made['rigs']} rigs"
    repeats = f", {made['repeats']} runs on each" if made["repeats"] > 1 else ""
    affected = ", every other with an effect" if made.get("affected") else ""
    under = " under a goal of requirements" if _goal(found) else ""
    return (
        f"{', '.join(found.results)}{under} on {rigs} drawn {made['randomization']} around {made['rig']['name']}"
        f"{affected}{repeats}"
    )


def _rows(found: Comparison, of: Table) -> list[tuple[str, ...]]:
    """Rows of every budget, sorted by regret."""
    rows = []
    for n in found.budgets:
        for m in sorted(found.reached(n), key=lambda m, n=n: of[n, m].median[0]):
            f = of[n, m]
            shown = (_regret(f.median), _regret(f.iqm), f"{f.touchdowns:.1f}", number(f.seconds, 2))
            if _goal(found):
                shown = (*shown[:2], f"{100 * f.met:.0f}", *shown[2:])
            rows.append((str(n), m, *shown, f"{100 * f.own:.0f}"))
    return rows


def _regret(r: np.ndarray) -> str:
    return f"{r[0]:.4f}" if np.isnan(r[1]) else f"{r[0]:.4f} [{r[1]:.4f}, {r[2]:.4f}]"


def _chance(p: np.ndarray | None) -> str:
    return "" if p is None else f"{p[0]:.2f} [{p[1]:.2f}, {p[2]:.2f}]"
