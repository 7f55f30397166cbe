"""Gains in words, and beside recommended ones: those that stay, ends of ranges, and what rigs within tolerance miss."""

from collections.abc import Mapping
from math import isfinite

import numpy as np

from maglev_env.evaluation.goal_score import misses
from maglev_env.loop.gain_card import stated_gains
from maglev_env.loop.gains import NO_CONTROLLER, gain_values, of_axis
from maglev_env.rig.goal import Goal, Requirement
from maglev_env.task.gain_box import TOP
from maglev_env.task.pump_goal import RotorGoalTask
from maglev_env.task.task import Task
from maglev_workbench.commands.tune.next_recording import digits
from maglev_workbench.goal_page import PREFIX
from maglev_workbench.page import number
from tuning.study.passed_over import PassedOver

AT_END = 0.005  # of a range, within which a gain stands at its end
BEYOND = 2.0  # factor by which a range that is proposed goes farther
FILTERS = ("td", "outer_td", "velocity_filter")  # of a derivative, which cost phase where margins are narrow


def gains_in_words(task: Task | RotorGoalTask, point: np.ndarray) -> str:
    """The gains of a point of the box, in SI."""
    return ", ".join(
        f"{n} = {digits(g)} {unit}".strip()
        for n, g, unit in zip(task.box.names, task.box.gains(point), task.box.units, strict=True)
    )


def kept_gains(task: Task | RotorGoalTask) -> dict[str, float]:
    """The gains that were not tuned, by name: without them the tuned ones cannot be set."""
    if isinstance(task, RotorGoalTask):
        own = {f"{gain}_{one}": v for one, gains in task.rotor.gains.items() for gain, v in gain_values(gains).items()}
    else:
        own = gain_values(of_axis(task.rig.gains or NO_CONTROLLER, 0))
    return {name: value for name, value in own.items() if name not in task.box.names}


def passed_in_words(passed: PassedOver) -> str:
    """A sentence on sets that scored higher in their experiment and were not taken; "" for none."""
    why = []
    if passed.lower:
        ends = dict.fromkeys(f"{one:.3f}" for one in (passed.lower[0], passed.lower[-1]))
        why.append(f"{len(passed.lower)} because the mean is lower under fresh noise ({' .. '.join(ends)})")
    if passed.beside:
        why.append(f"{passed.beside} beside sets that were measured again")
    if passed.beside_refused:
        why.append(f"{passed.beside_refused} beside refused ones")
    if not why:
        return ""
    count = len(passed.lower) + passed.beside + passed.beside_refused
    return (
        f" Of single readings {count} scored higher and {'is' if count == 1 else 'are'} passed over: {', '.join(why)}."
    )


def farther_in_words(task: Task | RotorGoalTask, point: np.ndarray, missed: bool = False) -> str:
    """Sentences on the gains that stand at an end of their range, and on how to search beyond it; "" for none.

    Args:
        task: The task.
        point: (k,).
        missed: Whether a requirement is missed there.

    A filter that was left alone is named, too, where a requirement is missed or a goal makes something best: it costs
    the phase that stiffness needs, and ranges of the other gains end where that is spent.
    """
    rotor, box = isinstance(task, RotorGoalTask), task.box
    cards = {} if rotor else {name: card for name, _, card in stated_gains(of_axis(task.rig.gains, 0))}
    at, ranges = [], {}
    for name, place, low, high in zip(box.names, point, box.low, box.high, strict=True):
        own = name.partition("_")[0] if rotor else name
        if 1 - abs(place) < 2 * AT_END:
            at.append(f"{name} ({'lower' if place < 0 else 'upper'} of {number(low)} .. {number(high)})")
            card, most = cards.get(own), TOP * task.rig.control_rate
            low, high = (low / BEYOND, high) if place < 0 else (low, high * BEYOND)
            if card:
                low, high = max(low, card.low), min(high, card.high, most if card.unit == "Hz" else high)
        others = ranges.get(own, (low, high))
        ranges[own] = min(low, others[0]), max(high, others[1])
    left = {name.partition("_")[0] if rotor else name for name in kept_gains(task)} & set(FILTERS)
    goal = task.layout.goal
    left = left if missed or (goal and (goal.best or at)) else set()
    if not at and not left:
        return ""
    options = [f"--tune {name}={digits(low)}:{digits(high)}" for name, (low, high) in ranges.items()]
    options += [f"--tune {name}" for name in sorted(left)]
    ends = f" At the end of its range: {', '.join(at)}." * bool(at)
    filters = f" Left as before: {', '.join(sorted(left))}, the filter of the derivative, whose lag costs phase."
    filters *= bool(left)
    return f"{ends}{filters} {'What is missed may be met' if missed else 'Better may lie'} beyond: {' '.join(options)}"


def missed_on_rig(goal: Goal, required: Mapping[str, float]) -> bool:
    """Whether the median on the rig itself misses a requirement of the goal."""
    return any(misses(r, np.array([required.get(PREFIX + r.name, np.nan)]))[0] > 0 for r in goal.requirements)


def misses_within(r: Requirement, required: Mapping[str, float]) -> bool:
    """Whether the worse end over noise and rigs within tolerance misses the limit of a requirement."""
    end = required.get(f"{PREFIX}{r.name}_{'high' if r.quantity.most else 'low'}", np.nan)
    return not np.isnan(end) and bool(misses(r, np.array([end]))[0] > 0)


def tolerance_in_words(task: Task | RotorGoalTask, goal: Goal, required: Mapping[str, float]) -> str:
    """A sentence on the requirements that some rigs within tolerance miss, and what to do; "" for none."""
    if not task.rig.tolerance:
        return ""
    met = [r for r in goal.requirements if misses(r, np.array([required.get(PREFIX + r.name, np.nan)]))[0] <= 0]
    lacking = [r for r in met if misses_within(r, required)]
    if not lacking:
        return ""
    words = []
    for r in lacking:
        scale, unit = r.quantity.shown
        end = required[f"{PREFIX}{r.name}_{'high' if r.quantity.most else 'low'}"]
        shown = f"{number(end * scale)} {unit}".rstrip() if isfinite(end) else "touchdown or below the lines"
        words.append(f"{r.quantity.words} ({shown})")
    out = "give the limits this reserve" if isinstance(task, RotorGoalTask) else "add 'worst of 16 rigs' to the goal"
    already = not isinstance(task, RotorGoalTask) and goal.rigs
    return f" Some rigs within its tolerance miss {', '.join(words)}" + (
        "." if already else f": {out} to meet it there."
    )


def unstated_noise(task: Task | RotorGoalTask, goal: Goal) -> str:
    """A sentence where a goal asks for a noise current, and the rig states no noise of what its controller reads."""
    if isinstance(task, RotorGoalTask) or task.rig.noise.displacement or task.sensor != "probe":
        return ""
    if all(r.name != "noise_current" for r in goal.measured):
        return ""
    return " The rig states no [noise] of its displacement: the noise current is that of its converters alone."
