"""The task of tuning a rotor to a goal: an experiment is its linear loop and its simulated run-up and events."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from maglev_env.evaluation.goal_score import misses
from maglev_env.rig.goal import Goal
from maglev_env.rig.rig import Rig
from maglev_env.rotor.requirements import RotorGoalEvaluation, evaluate_goal, rotor_goal, worst
from maglev_env.rotor.rotor import Rotor, load_rotor
from maglev_env.rotor.run_up import checked_speeds
from maglev_env.task.gain_box import TUNED, GainBox
from maglev_env.task.pump import UNBALANCE
from maglev_env.task.pump_episodes import (
    RotorEpisode,
    controlled,
    draw_rotor_episode,
    gains_at,
    preset_of,
    rotor_box,
)  # fmt: skip

SPEEDS = tuple(range(0, 14_001, 2000))  # rpm


@dataclass(frozen=True)
class GoalLayout:
    """The goal, and the names of the observation: how far each requirement is from its limit."""

    goal: Goal

    @property
    def names(self) -> tuple[str, ...]:
        return tuple(r.name for r in self.goal.requirements)


@dataclass(frozen=True, eq=False)
class RotorGoalTask:
    """Checked arguments of `make_rotor_goal_task`; preset: the rotor's own gains as an action (k,)."""

    rotor: Rotor
    tuned: tuple[str, ...]
    box: GainBox
    preset: np.ndarray
    layout: GoalLayout
    speeds: np.ndarray
    budget: int
    terminate_on_touchdown: bool = False

    @property
    def name(self) -> str:
        """Name of the rotor."""
        return self.rotor.name

    @property
    def rig(self) -> Rig:
        """The rotor's axis, which states its tolerances."""
        return self.rotor.axis

    def tried(self, last: np.ndarray, actions: np.ndarray) -> np.ndarray:
        """Points of the box (..., k): the actions."""
        return actions

    def draw(self, rng: np.random.Generator) -> RotorEpisode:
        """A rotor within the axis' tolerances, with up to twice or half of the unbalance."""
        kind = "tolerances" if self.rotor.axis.tolerance else "none"
        return draw_rotor_episode(self.rotor, self.preset, kind, UNBALANCE, rng)

    def at(self, rotor: Rotor, point: np.ndarray) -> Rotor:
        """A rotor with the gains of a point (k,) of the box."""
        return gains_at(rotor, self.box.gains(point), self.tuned)

    def measure(
        self, episodes: Sequence[RotorEpisode], actions: np.ndarray, counts: Sequence[int], threads: int | None
    ) -> tuple[RotorGoalEvaluation, np.ndarray]:
        """One experiment of each of n episodes at actions (n, k), numbered by counts; and observations."""
        rotors = [self.at(e.rotor, action) for e, action in zip(episodes, actions, strict=True)]
        seeds: list[tuple[int, ...]] = [(e.seed, count) for e, count in zip(episodes, counts, strict=True)]
        found = evaluate_goal(rotors, self.layout.goal, self.speeds, seeds, threads)
        seen = [misses(r, found.required(r.name)) for r in self.layout.goal.requirements]
        return found, np.stack([*seen, np.zeros(len(rotors))], axis=-1)[:, :-1].astype(np.float32)

    def told(self, found: RotorGoalEvaluation) -> dict[str, np.ndarray]:
        """The worst of every quantity with its speed and place, what a recommendation asks for, and the score."""
        names = dict.fromkeys(name for one in found.found for name in one)
        columns = {f"required_{name}": found.required(name) for name in names}
        for name in names:
            where = [worst(one[name], name)[1:] if name in one else (np.nan, "") for one in found.found]
            columns[f"worst_speed_{name}"] = np.array([v for v, _ in where])
            columns[f"worst_place_{name}"] = np.array([place for _, place in where])
        of_all = {name: columns[f"required_{name}"] for name in ("peak_sensitivity", "phase_margin") if names}
        if names:
            of_all["gain_margin_high"] = columns["required_gain_margin"]
        peak = found.run_up.peak.max(axis=(1, 2))
        return (
            columns
            | of_all
            | {
                "peak_displacement": peak,
                "touchdown_time": found.touchdown_time,
                "feasible": found.feasible,
                "score": found.score,
            }
        )


def make_rotor_goal_task(
    rotor: str | Path | Rotor,
    goal: str,
    tuned: Sequence[str] | None = None,
    bounds: Mapping[str, Sequence[float]] | None = None,
    speeds: Sequence[float] = SPEEDS,
    budget: int = 400,
) -> RotorGoalTask:
    """The task of checked arguments: both controllers of a rotor are tuned, each with its own gains.

    Args:
        rotor: A preset's name, the path of a rotor TOML, or a rotor.
        goal: `engineer`, or requirements; see docs/goals.md.
        tuned: Gains of each controller; None: kp, ki, kd.
        bounds: (low, high) by name; otherwise the rotor's.
        speeds: Speeds at which everything is required, rpm.
        budget: Number of experiments.

    Raises:
        ValueError: An argument is not valid; the message names it.
        OSError: The rotor's file cannot be read.
    """
    loaded = rotor if isinstance(rotor, Rotor) else load_rotor(rotor)
    names = tuple(tuned or TUNED)
    kind = "planes" if tuple(loaded.gains) == ("a", "b") else "translation_tilt"
    box = rotor_box(controlled(loaded, kind), kind, names, bounds)
    ladder = checked_speeds("speeds", speeds)
    return RotorGoalTask(
        loaded, names, box, preset_of(loaded, names, box), GoalLayout(rotor_goal(loaded, goal)), ladder, budget
    )
