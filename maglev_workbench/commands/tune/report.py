"""A study as tables, page and JSON: tried gains, the recommendation, and refused gains with reasons."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict
from importlib.metadata import version
from typing import TYPE_CHECKING, Any

import numpy as np

from estimation.normal import NORMAL_95
from maglev_env.evaluation.goal_score import scale_in_words
from maglev_env.loop.gains import unit_of_gain
from maglev_env.recordings.formats.json_data import plain
from maglev_env.rig.goal import Goal
from maglev_env.task.gain_box import GainBox
from maglev_env.task.pump_goal import RotorGoalTask
from maglev_env.task.task import Task
from maglev_workbench import goal_page
from maglev_workbench.commands.tune.advised import (
    farther_in_words,
    gains_in_words,
    kept_gains,
    missed_on_rig,
    misses_within,
    passed_in_words,
    tolerance_in_words,
    unstated_noise,
)
from maglev_workbench.commands.tune.figures import course_figure, where_figure
from maglev_workbench.commands.tune.next_recording import digits
from maglev_workbench.page import (
    effects_in_words,
    note,
    number,
    page,
    rig_facts,
    table,
)
from tuning.study.recommendation import Recommendation, Verdict
from tuning.study.study import Outcome

if TYPE_CHECKING:
    import rich.table
    from plotly.graph_objects import Figure

BEST = 8
LEAST_SHOWN = 0.001  # of a score, whose spread by noise is not shown below
IDENTIFIED = (  # of every experiment, in SI, where it is known
    "stiffness", "stiffness_low", "stiffness_high", "damping", "damping_low", "damping_high",
    "peak_sensitivity", "phase_margin", "gain_margin_low", "gain_margin_high", "peak_displacement", "current_rms",
)  # fmt: skip
NONE = "None of the gains tried is recommended: "
GOAL_HEAD = ("experiment", "score", "met", "tightest")
STANDS = ("requirement", "median", "limit", "95 % within tolerance", "")
HEAD = ("experiment", "score", "stiffness kN/m", "damping N s/m", "peak |S|", "phase margin °", "peak µm")


def summary(task: Task | RotorGoalTask, found: Outcome, advice: Recommendation) -> str:
    """Sentences on the recommended gains with their spread, and on the number of refused ones with a higher score."""
    if advice.chosen is None:
        why = advice.refused[0].reason if advice.refused else "no experiment gave a stable loop"
        return NONE + why + "."
    c = advice.chosen
    low, high = c.intervals["score"]
    others = "rigs within its tolerance" if task.rig.tolerance else "repetition (the rig states no [tolerance])"
    spread = NORMAL_95 * c.score_se
    noise = f"{spread:.1g}" if spread >= LEAST_SHOWN else f"less than {LEAST_SHOWN:g}"
    left = kept_gains(task)
    own = (*task.box.names, *left)
    kept = ", ".join(f"{n} = {digits(g)} {unit_of_gain(n, own)}".strip() for n, g in left.items())
    text = (
        f"Take {gains_in_words(task, c.point)}{kept and f' (as before: {kept})'}: score {c.score:.3f} ± {noise} under "
        f"fresh noise on this rig, {low:.2f} .. {high:.2f} on {others}."
    )
    if goal := task.layout.goal:
        text += f" On this rig it {goal_page.missed_in_words(goal, c.required)}."
        text += tolerance_in_words(task, goal, c.required) + unstated_noise(task, goal)
        reached = c.required.get(goal_page.PREFIX + goal.best.name, np.nan) if goal.best else np.nan
        text += f" {scale_in_words(goal, reached)}".rstrip()
    if advice.refused:
        text += f" {len(advice.refused)} that scored higher were refused."
    text += passed_in_words(advice.passed)
    return text + farther_in_words(task, c.point, bool(goal) and missed_on_rig(goal, c.required))


def gain_heads(box: GainBox) -> list[str]:
    """Heads of columns of gains: the name, and its SI unit in a second line."""
    return [f"{name}\n{unit}" for name, unit in zip(box.names, box.units, strict=True)]


def tune_tables(
    task: Task | RotorGoalTask, found: Outcome, advice: Recommendation
) -> "Iterable[str | rich.table.Table]":
    """Tables for a terminal."""
    from rich import box
    from rich.table import Table

    goal, rows = task.layout.goal, _best_rows(task, found)
    gain_names = gain_heads(task.box)
    head = (*gain_names, *(GOAL_HEAD if goal else HEAD)[1:])
    grid = Table(box=box.SIMPLE_HEAD, collapse_padding=True, pad_edge=False, title=f"Best of {len(found.trials)}")
    for name in head:
        short = name.replace("_", " ").replace("translation", "transl.")
        grid.add_column(short, justify="right", min_width=max(map(len, short.split())) if name in gain_names else None)
    for row in rows:
        grid.add_row(*row[1:])
    yield grid
    if goal and advice.chosen:
        stands = Table(box=box.SIMPLE_HEAD, collapse_padding=True, pad_edge=False, title="The recommended gains")
        for i, name in enumerate(STANDS):
            stands.add_column(name, justify="left" if i in (0, 4) else "right")
        for row in _stands(goal, advice.chosen):
            stands.add_row(*row)
        yield stands
    for verdict in advice.refused:
        yield f"refused {gains_in_words(task, verdict.point)}: {verdict.reason}"
    yield summary(task, found, advice)


def tune_page(
    task: Task | RotorGoalTask,
    found: Outcome,
    advice: Recommendation,
    data: dict[str, Any],
    more: "Sequence[tuple[str, str | Figure]]" = (),
    facts: Mapping[str, str] | None = None,
) -> str:
    """The HTML page of a study, with more sections behind those of the goal, and facts in place of the rig's."""
    refused = [(gains_in_words(task, v.point), v.reason) for v in advice.refused]
    goal = task.layout.goal
    head = GOAL_HEAD if goal else HEAD
    sections = [
        ("Score of every experiment", course_figure(task, found)),
        ("Where it looked", where_figure(task, found, advice)),
        ("Best experiments", table(("experiment", *gain_heads(task.box), *head[1:]), _best_rows(task, found))),
        ("Refused", table(("gains", "why"), refused) if refused else note("Nothing was refused.")),
    ]
    if advice.chosen:
        sections.insert(
            0, ("Recommended", table(("figure", "95 % of noise and tolerance"), _spread(advice.chosen, goal)))
        )
    if goal:
        sections[1 if advice.chosen else 0 : 0] = [*_goal_sections(task, goal, found, advice), *more]
    by = data["made_by"]
    if facts is None:
        facts = {**rig_facts(by["rig"]), "Effects": effects_in_words(by["effects"]), "Sensor": by["sensor"]}
    made = {**facts, "Method": by["method"], "Seed": by["seed"]}
    return page(f"Tuning of {task.name}", summary(task, found, advice), sections, made)


def tune_json(
    task: Task | RotorGoalTask, found: Outcome, advice: Recommendation, made_by: dict[str, Any], seconds: float
) -> dict[str, Any]:
    """JSON data of schema maglev-tune/1."""
    trials = found.trials

    def told(v: Verdict) -> dict[str, Any]:
        gains = dict(zip(task.box.names, task.box.gains(v.point), strict=True))
        return {"gains": gains, "kept_gains": kept_gains(task),
                "score": v.score, "score_se": v.score_se, "intervals": v.intervals, "reason": v.reason,
                **({"requirements": goal_page.requirements_json(goal, v.required)} if goal else {})}  # fmt: skip

    goal = task.layout.goal
    gains = task.box.gains(trials.points)
    return plain(
        {
            "schema": "maglev-tune/1",
            "version": version("maglev-workbench"),
            "made_by": made_by,
            "box": {name: [*ends, log] for name, *ends, log in zip(*_box(task), strict=True)},
            "recommended": told(advice.chosen) if advice.chosen else None,
            "refused": [told(v) for v in advice.refused],
            "passed_over": asdict(advice.passed),
            "experiments": [
                {
                    "gains": dict(zip(task.box.names, g, strict=True)),
                    "score": s,
                    "touchdown": bool(t),
                    "identified": {name: info[name] for name in IDENTIFIED if name in info},
                    **({"requirements": goal_page.requirements_json(goal, info)} if goal else {}),
                }
                for g, s, t, info in zip(gains, trials.score, trials.touchdown, trials.info, strict=True)
            ],
            "touchdowns": int(trials.touchdown.sum()),
            "reused": found.reused,
            "seconds": seconds,
            **({"goal": goal.text} if goal else {}),
        }
    )


def _box(task: Task | RotorGoalTask) -> tuple[Iterable[Any], ...]:
    """Names of the gains, their bounds, and whether a tuner sees them on a logarithmic scale."""
    return task.box.names, task.box.low, task.box.high, task.box.log.tolist()


def _best_rows(task: Task | RotorGoalTask, found: Outcome) -> list[tuple[str, ...]]:
    t = found.trials
    rows = []
    for i in np.argsort(-t.score, kind="stable")[:BEST]:
        info, goal = t.info[i], task.layout.goal
        gains = tuple(digits(g) for g in task.box.gains(t.points[i]))
        if goal:
            rows.append((str(i + 1), *gains, f"{t.score[i]:.3f}", *goal_page.standing(goal, info)))
            continue
        shown = (
            info.get("stiffness", np.nan) / 1e3, info.get("damping", np.nan), info.get("peak_sensitivity", np.nan),
            info.get("phase_margin", np.nan), info.get("peak_displacement", np.nan) * 1e6,
        )  # fmt: skip
        rows.append((str(i + 1), *gains, f"{t.score[i]:.3f}", *map(number, shown)))
    return rows


def _goal_sections(
    task: Task | RotorGoalTask, goal: Goal, found: Outcome, advice: Recommendation
) -> "list[tuple[str, str | Figure]]":
    t = found.trials
    names = goal_page.shown_names(goal)
    values = {
        name: np.array([one.get(goal_page.PREFIX + name, np.nan) for one in t.info], dtype=float) for name in names
    }
    feasible = t.score > 0
    sets: list[tuple[str, Any]] = []
    if advice.chosen:
        sets.append(("recommended", advice.chosen.required))
    if feasible[0]:
        sets.append(("start", t.info[0]))
    best = None
    if advice.chosen:
        best = int(np.abs(t.points - advice.chosen.point).max(axis=1).argmin())
    hover = [f"{i + 1}: {gains_in_words(task, point)}" for i, point in enumerate(t.points)]
    first, second = (r.quantity.words for r in goal_page.pair_of(goal))
    sections: list[tuple[str, str | Figure]] = []
    if sets and goal.requirements:
        sections.append(("Requirements", goal_page.requirement_bars(goal, sets)))
        text = "Lines: 95 %; of the recommended gains over noise and rigs within tolerance."
        sections.append(("", note(text + f" Start: {gains_in_words(task, t.points[0])}." * bool(feasible[0]))))
    if advice.chosen:
        sections.append(("", table(STANDS, _stands(goal, advice.chosen))))
    drawn = goal_page.front_figure(goal, values, feasible, best, hover, "recommended")
    sections.append((f"{first} against {second}".capitalize(), drawn))
    sections.append(("", note("Dashed: the limits. A set on the front is bettered by no other set in both.")))
    return sections


def _stands(goal: Goal, v: Verdict) -> list[tuple[str, str, str, str, str]]:
    """How gains stand to every requirement: the median on the rig, the limit, the range over tolerance, the verdict."""
    rows = []
    for r, (words, _, limit, verdict) in zip(goal.measured, goal_page.requirement_rows(goal, v.required), strict=True):
        name, scale = goal_page.PREFIX + r.name, r.quantity.shown[0]
        low, high = (v.required.get(f"{name}_{end}", np.nan) * scale for end in ("low", "high"))
        if verdict == "met" and misses_within(r, v.required):
            verdict = "met, not by all"
        middle = f"{number(v.required.get(name, np.nan) * scale)} {r.quantity.shown[1]}".strip()
        rows.append((words, middle, limit, f"{number(low)} .. {number(high)}", verdict))
    return rows


def _spread(v: Verdict, goal: Goal | None) -> list[tuple[str, str]]:
    """What every recommendation is judged by, with its range; not what the requirements of the goal show anyway."""
    shown = {"displacement_share": "displacement", "gain_margin_high": "gain_margin"}
    asked = {r.name for r in goal.measured} if goal else set()
    words = {"displacement_share": "peak displacement over clearance", "gain_margin_high": "upper gain margin"}
    return [
        (words.get(name, name.replace("_", " ")), f"{number(low)} .. {number(high)}")
        for name, (low, high) in v.intervals.items()
        if shown.get(name, name) not in asked
    ]
