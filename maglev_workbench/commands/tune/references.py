"""Recommended gains beside references: what linear controllers of the same model reach, and what none can reach."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from maglev_env.evaluation.goal_score import in_words, misses
from maglev_env.loop.gains import as_table
from maglev_env.loop.linear_controller import LinearController
from maglev_env.recordings.formats.json_data import plain
from maglev_env.rig.goal import QUANTITIES, Goal, Requirement
from maglev_env.task.episodes import Episode
from maglev_env.task.task import Task
from maglev_workbench import goal_page
from maglev_workbench.console import progress_bar
from maglev_workbench.page import note, number, table
from tuning.reference.kinds import KINDS
from tuning.reference.reference import ROUND, ROUNDS, Reference, limits_of, reference
from tuning.study.recommendation import OTHERWISE, Recommendation, Verdict

if TYPE_CHECKING:
    import rich.table
    from plotly.graph_objects import Figure

ALWAYS = ("peak_sensitivity", "phase_margin", "gain_margin", "compliance", "noise_current")  # whatever the goal is
TITLE = "Beside linear controllers of this model"
HOW_TO_READ = (
    "References are no recommended controllers: each is designed from the linear model of the rig, with its effects, "
    "by weights that a search of its own chose for this goal, and measured by the same experiments. Values are medians "
    "under fresh noise. The best of any: what no linear controller of the reading, of any order, can better in this "
    "quantity alone; together with the other requirements it may be far out of reach."
)


@dataclass(frozen=True)
class Beside:
    """What recommended gains are held against.

    Args:
        references: The references.
        limits: What no linear controller can better, by quantity.
    """

    references: Sequence[Reference]
    limits: Mapping[str, float]


def made(task: Task, episode: Episode, kinds: Sequence[str], seed: int, threads: int | None) -> Beside:
    """The references of these kinds, with their progress on the terminal; errors as in `reference.reference`."""
    found = []
    for kind in dict.fromkeys(kinds):
        with progress_bar() as bar:
            line = bar.add_task(f"reference {kind}", total=ROUNDS * ROUND)
            found.append(reference(task, episode, kind, seed, threads, lambda n, b=bar, at=line: b.advance(at, n)))
    return Beside(found, limits_of(task, episode))


def reference_table(goal: Goal, advice: Recommendation, beside: Beside) -> "rich.table.Table":
    """The table for a terminal."""
    from rich import box
    from rich.table import Table

    grid = Table(box=box.SIMPLE_HEAD, collapse_padding=True, pad_edge=False, title=TITLE)
    head, rows = _rows(goal, advice, beside)
    for i, name in enumerate(head):
        grid.add_column(name, justify="left" if i == 0 else "right")
    for row in rows:
        grid.add_row(*row)
    return grid


def reference_sections(goal: Goal, advice: Recommendation, beside: Beside) -> "list[tuple[str, str | Figure]]":
    """Sections of the page."""
    words = reference_in_words(goal, advice, beside)
    return [(TITLE, table(*_rows(goal, advice, beside))), ("", note(words)), ("", note(HOW_TO_READ))]


def reference_json(goal: Goal, beside: Beside) -> dict[str, Any]:
    """The references and the limits of all linear controllers, for the JSON of a study."""
    told = [
        {
            "kind": one.kind,
            "weights": one.weights,
            "controller": as_table(one.controllers),
            "tried": one.tried,
            "score": one.verdict.score,
            "score_se": one.verdict.score_se,
            "reason": one.verdict.reason,
            "requirements": goal_page.requirements_json(goal, one.verdict.required),
            "loop": one.verdict.loop,
            "intervals": one.verdict.intervals,
        }
        for one in beside.references
    ]
    return plain({"references": told, "linear_limits": dict(beside.limits)})


def reference_in_words(goal: Goal, advice: Recommendation, beside: Beside) -> str:
    """Whether requirements are unmeetable or only unmet, and what the references have of what is made best."""
    parts = []
    impossible = [r for r in goal.requirements if _short(r, beside.limits.get(r.name, np.nan))]
    for r in impossible:
        parts.append(f"No linear controller of this model meets {in_words(r)}: the best of any is "
                     f"{_shown(r.name, beside.limits[r.name])}.")  # fmt: skip
    chosen = advice.chosen
    missed = _missed(goal, chosen) if chosen else list(goal.requirements)
    if missed:
        meeting = [one for one in beside.references if not _missed(goal, one.verdict)]
        names = ", ".join(r.quantity.words for r in missed) if chosen else "the goal"
        if meeting:
            reached = " and ".join(_words(one) for one in meeting)
            verb = "meets" if len(meeting) == 1 else "meet"
            parts.append(f"Missed is {names}, which can be met: {reached} {verb} every requirement on this rig.")
        elif others := [r for r in missed if r not in impossible]:
            names = ", ".join(r.quantity.words for r in others)
            parts.append(f"No reference meets the goal either; that {names} cannot be met is not proved by that.")
    for one in beside.references:
        parts.append(_against(goal, chosen, one))
    return " ".join(filter(None, parts))


def _against(goal: Goal, chosen: Verdict | None, one: Reference) -> str:
    """A sentence on one reference."""
    lacking = _missed(goal, one.verdict)
    what = f"misses {', '.join(r.quantity.words for r in lacking)}" if lacking else "meets every requirement"
    text = f"{_words(one)} (order {_order(one)}) {what}"
    if goal.best:
        own, other = (_value(v, goal.best.name) for v in (one.verdict, chosen))
        text += f", {goal.best.quantity.words} {_shown(goal.best.name, own)}"
        text += f", where the recommended gains have {_shown(goal.best.name, other)}" if chosen else ""
    if one.verdict.reason:
        text += f"; it would be refused: {one.verdict.reason}"
    return text + "."


def _rows(goal: Goal, advice: Recommendation, beside: Beside) -> tuple[tuple[str, ...], list[tuple[str, ...]]]:
    """Head and rows, one for each quantity, and the score."""
    sets = [("recommended", advice.chosen)] if advice.chosen else []
    sets += [(_words(one), one.verdict) for one in beside.references]
    head = ("requirement", "limit", *(name for name, _ in sets), "best of any")
    limits = {r.name: r for r in goal.requirements}
    rows = []
    for name in dict.fromkeys([*(r.name for r in goal.measured), *ALWAYS]):
        q, r = QUANTITIES[name], limits.get(name)
        unit = f", {q.shown[1]}" if q.shown[1] else ""
        cells = [number(_value(v, name) * q.shown[0]) + (" (missed)" if r and r in _missed(goal, v) else "")
                 for _, v in sets]  # fmt: skip
        limit = f"{'at most' if q.most else 'at least'} {r.limit * q.shown[0]:.4g}" if r else ""
        best = beside.limits.get(name, np.nan) * q.shown[0]
        rows.append((q.words + unit, limit, *cells, number(best) if np.isfinite(best) else ""))
    rows.append(("score", "", *(f"{v.score:.3f}" for _, v in sets), ""))
    return head, rows


def _words(one: Reference) -> str:
    return KINDS[one.kind].words


def _order(one: Reference) -> int:
    own = one.controllers[0] if isinstance(one.controllers, tuple) else one.controllers
    return own.order if isinstance(own, LinearController) else 0


def _value(v: Verdict | None, name: str) -> float:
    """The median of a quantity; nan where it is not known."""
    if v is None:
        return np.nan
    return v.required.get(goal_page.PREFIX + name, v.loop.get(OTHERWISE.get(name, name), np.nan))


def _shown(name: str, value: float) -> str:
    scale, unit = QUANTITIES[name].shown
    return f"{number(value * scale)} {unit}".rstrip()


def _missed(goal: Goal, v: Verdict) -> list[Requirement]:
    return [r for r in goal.requirements if misses(r, np.array([_value(v, r.name)]))[0] > 0]


def _short(r: Requirement, limit: float) -> bool:
    """Whether what no controller can better misses a requirement."""
    return bool(np.isfinite(limit) and misses(r, np.array([limit]))[0] > 0)
