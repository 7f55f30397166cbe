"""How a setting stands to the goal: at once by the linear model, and by the experiment with its large-signal test."""

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from estimation.gain_margin import gain_factors
from maglev_env.design.goals import engineer, goal_of
from maglev_env.evaluation.evaluate import evaluate
from maglev_env.evaluation.goal_score import in_words, misses
from maglev_env.evaluation.requirements import events_of
from maglev_env.experiment import Experiment
from maglev_env.kernel.blocks import own_lanes
from maglev_env.kernel.events import simulated_events
from maglev_env.rig.goal import Goal, Requirement
from maglev_env.rig.rig import Rig
from maglev_workbench.explore.curves import LoopCurves
from maglev_workbench.explore.quantities import UnitSystem
from maglev_workbench.goal_page import PREFIX, value_in_words

FOLLOWED = {"step": "load", "lift_off": "lift_off"}  # events that are drawn, and their panels
DRAWN = 400  # points of an event's curve


@dataclass(frozen=True)
class Bar:
    """One requirement.

    Args:
        name: of the quantity.
        value: with unit and, where it is known, its interval.
        share: of the limit that is used; above 1 it is missed.
        met: whether it is met.
    """

    name: str
    value: str
    share: float
    met: bool


@dataclass(frozen=True)
class Tested:
    """The experiment and its large-signal test.

    Args:
        row: quantities of the goal with their intervals, named as the columns of a sweep.
        events: times (n,), s, and displacements from where the rotor hovers (n,), m, by panel.
    """

    row: Mapping[str, float]
    events: Mapping[str, tuple[np.ndarray, np.ndarray]]


def shown_goal(rig: Rig) -> Goal:
    """The goal of a rig, or what an engineer asks for where it has none; on the rig itself, however many it names."""
    return replace(goal_of(rig) or engineer(rig), rigs=0)


def followed(rig: Rig) -> dict[str, Requirement]:
    """Requirements that state the events to draw, by panel: the goal's, else the engineer's."""
    own = goal_of(rig)
    events = engineer(rig).events | (own.events if own else {})
    return {panel: events[kind] for kind, panel in FOLLOWED.items() if kind in events}


def linear_row(found: LoopCurves) -> dict[str, float]:
    """What the linear model knows of a stable loop, without simulating, named as the columns of a sweep."""
    if found.margins is None or found.sensitivity is None:
        return {}
    m = found.margins
    values = {name: m[name] for name in ("peak_sensitivity", "phase_margin", "disk_margin")}
    values["gain_margin"] = float(np.fmin(*gain_factors(found.frequency, found.sensitivity, m)))
    if found.in_target is not None:
        values["stiffness"], values["damping"] = found.in_target
    return {PREFIX + name: value for name, value in values.items()}


def requirement_words(one: Requirement, units: UnitSystem) -> str:
    """A requirement with its limit; in the units of files as a goal is written there."""
    return in_words(one) if units == "bench" else one.text


def bars(
    goal: Goal, row: Mapping[str, float], found: LoopCurves | None = None, units: UnitSystem = "bench"
) -> list[Bar]:
    """The requirements whose quantities a row has; of `found`, the compliance at the lines that each one names."""
    row = dict(row)
    rows = []
    for one in goal.requirements:
        if one.name == "compliance" and found is not None and found.compliance is not None:
            low, high = one.band
            assert found.lines is not None  # of the same frequencies
            row[PREFIX + one.name] = float(found.compliance[(found.lines >= low) & (found.lines <= high)].max())
        if PREFIX + one.name not in row:
            continue
        missed = float(misses(one, np.array([row[PREFIX + one.name]]))[0])
        shown = one.quantity.shown if units == "bench" else (1.0, one.quantity.unit)
        rows.append(Bar(one.name, value_in_words(one, row, shown), float(np.exp(missed)), missed <= 0))
    return rows


def simulated_goal(experiment: Experiment, goal: Goal, axis: int) -> Tested:
    """Simulate an experiment for what the goal measures, and the events of `followed`.

    Args:
        experiment: a stable loop under the rig's protocol.
        goal: of `shown_goal`; on an x-y rig the worse axis counts.
        axis: of the curves.

    Raises:
        ValueError: A time of the goal is too long for the experiment.
    """
    rig = replace(experiment.rig, target=replace(experiment.rig.target, goal=goal.text))
    found = evaluate([replace(experiment, rig=rig)], threads=1, bands=np.array([rig.target.band], dtype=float))
    row: dict[str, float] = {}
    for end, values in (("", found.required), ("_low", found.required_low), ("_high", found.required_high)):
        row |= {f"{PREFIX}{name}{end}": float(value[0]) for name, value in values.items()}
    of_panel = followed(experiment.rig)
    if not of_panel:
        return Tested(row, {})
    hover, events = events_of(Goal(tuple(of_panel.values())), experiment)
    hovering, *series = simulated_events(own_lanes([experiment]), hover, events, threads=1)
    rest = hovering[0, 0, axis].mean()
    curves = {}
    for event, one in zip(events, series, strict=True):
        drawn = np.linspace(0, event.samples - 1, min(DRAWN, event.samples)).astype(int)
        curves[FOLLOWED[event.kind]] = drawn / experiment.rig.control_rate, one[0, 0, axis][drawn] - rest
    return Tested(row, curves)
