"""A rotor judged by a goal: each quantity at every speed, mode and plane, the worst of it, and the score."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from maglev_env.design.goals import engineer
from maglev_env.evaluation.goal_score import goal_score, goal_terms
from maglev_env.rig.goal import ENGINEER, QUANTITIES, Goal, parse_goal
from maglev_env.rotor.large_signal import large_signal_quantities
from maglev_env.rotor.loop_quantities import PLANES, Found, joined, linear_quantities
from maglev_env.rotor.rotor import Rotor
from maglev_env.rotor.run_up import RunUp, Seeds, checked_speeds, run_up, seeds_of


@dataclass(frozen=True)
class RotorGoalEvaluation:
    """n rotors judged by a goal.

    Attributes:
        goal: The goal.
        run_up: Their simulated run-up.
        found: By name the linear loop's quantities, those of the run-up, and those of the goal's events, of each; empty
            for a rotor whose linear loop is unstable at a speed.
        terms: Score terms, of the worst speed and place, (n,).
        score: 0 to 1, (n,).
        feasible: Stable at every speed, without a touchdown, (n,).
        touchdown_time: Time of the first contact in the run-up, s, nan without one, (n,).
    """

    goal: Goal
    run_up: RunUp
    found: tuple[Mapping[str, Found], ...]
    terms: dict[str, np.ndarray]
    score: np.ndarray
    feasible: np.ndarray
    touchdown_time: np.ndarray

    def required(self, name: str) -> np.ndarray:
        """The worst of a quantity over speeds and places, (n,); nan where it is not known."""
        return np.array([worst(one[name], name)[0] if name in one else np.nan for one in self.found])


def rotor_goal(rotor: Rotor, text: str) -> Goal:
    """The goal of a text: requirements, or `engineer`, whose limits are those of the rotor's axis and its own mass.

    Raises:
        ValueError: The text is not understood, asks for rigs within tolerance, or for a lift-off from where the rotor
            cannot be.
    """
    own = replace(rotor.axis, mass=rotor.body.mass)
    goal = engineer(own) if text.strip() == ENGINEER else parse_goal(text)
    if goal.rigs:
        raise ValueError(f"goal: 'worst of {goal.rigs} rigs' is for rigs of one axis; leave it out for a rotor, whose "
                         "recommended gains are always tried on rotors within tolerance")  # fmt: skip
    lift = goal.events.get("lift_off")
    if lift and not lift.size < rotor.axis.clearance:
        raise ValueError(
            f"goal: lift_off_time from {lift.size:g} m: the rotor's clearance is {rotor.axis.clearance:g} m"
        )
    return goal


def worst(found: Found, name: str) -> tuple[float, float, str]:
    """The worst value of a quantity, and its speed (rpm) and place; nan where no speed and place has any."""
    cost = found.values if QUANTITIES[name].most else -found.values
    cost = np.where(np.isnan(cost), -np.inf, cost)
    i, j = np.unravel_index(int(cost.argmax()), cost.shape)
    return float(found.values[i, j]), found.speeds[i], found.places[j]


def evaluate_goal(
    rotors: Sequence[Rotor], goal: Goal, speeds: np.ndarray, seed: Seeds = 0, threads: int | None = None
) -> RotorGoalEvaluation:
    """Judge rotors under their own gains by a goal, at every speed.

    Margins, compliance, coefficients and noise are those of the linear loop where it runs; displacements, currents and
    what follows from a blow, a load or a lift-off are simulated with noise, unbalance and converters.

    Args:
        rotors: n of them.
        goal: The goal.
        speeds: rpm.
        seed: One for all, or one for each.
        threads: Number of threads; results do not depend on it.

    Raises:
        ValueError: No rotors, or speeds that are not finite.
    """
    if not rotors:
        raise ValueError("rotors: give at least one")
    speeds, seeds = checked_speeds("speeds", speeds), seeds_of(seed, len(rotors))
    up = run_up(rotors, speeds, [(*s, 0) for s in seeds], threads)
    events = large_signal_quantities(goal, rotors, speeds, seeds, threads)
    asked = {r.name: r for r in goal.measured}
    band = asked["compliance"].band if "compliance" in asked else (0.0, np.inf)
    found = []
    for i, rotor in enumerate(rotors):
        parts = [linear_quantities(rotor, float(v), band) for v in speeds]
        if any(part is None for part in parts):
            found.append({})
            continue
        at = tuple(map(float, speeds))
        share = up.peak[i] / rotor.axis.clearance
        current = up.coil_whole_rms[i].reshape(-1, 2, 2).max(axis=-1)
        own = joined(parts) | events[i]  # pyright: ignore[reportArgumentType]
        own |= {"displacement": Found(at, PLANES, share), "current_rms": Found(at, PLANES, current)}
        found.append(own)
    time = np.fmin.reduce(up.first_contact, axis=(1, 2))
    feasible = np.array([bool(one) for one in found]) & np.isnan(time)
    draft = RotorGoalEvaluation(goal, up, tuple(found), {}, np.zeros(len(rotors)), feasible, time)
    terms = goal_terms(goal, {name: draft.required(name) for name in asked})
    terms = {name: np.where(feasible, term, 0.0) for name, term in terms.items()}
    return replace(draft, terms=terms, score=np.where(feasible, goal_score(terms), 0.0))
