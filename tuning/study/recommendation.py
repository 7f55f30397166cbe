"""Recommendation among the gains tried: those that hold up under fresh noise and on rigs within tolerance."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import reduce
from operator import add
from typing import Any

import numpy as np

from maglev_env.design.goals import goal_of
from maglev_env.evaluation.goal_score import misses
from maglev_env.evaluation.requirements import LOOP
from maglev_env.rig.drawn import scaled_rig, tolerance_factors
from maglev_env.rig.goal import QUANTITIES
from maglev_env.task.episodes import Episode
from maglev_env.task.pump_episodes import RotorEpisode
from maglev_env.task.pump_goal import RotorGoalTask
from maglev_env.task.task import Task
from tuning.study.passed_over import PassedOver, passed_over
from tuning.study.study import experiments
from tuning.tuner import Trials

# Of the box; gains closer than this to refused ones are not judged separately; each refusal after the first doubles it.
NEAR, FARTHEST = 0.02, 0.3
FINALISTS, AGAIN = 4, 8  # distinct gains with the best scores that are told apart, by so many repetitions of each
LEVEL = 0.95  # of the interval over noise and tolerance that must stay out of the forbidden zone
_ENDS = (50 * (1 - LEVEL), 50 * (1 + LEVEL))
BETWEEN = "between_lines_"  # of what a loop has between the lines of its experiment, in the info
OTHERWISE = {"gain_margin": "gain_margin_high"}  # names of the lines' margins that differ from those of a goal
# Worst values that may be recommended: the end of zone B of ISO 14839-3, a share of the clearance under the excitation,
# and the usual margins of control.
PEAK_SENSITIVITY, DISPLACEMENT_SHARE, PHASE_MARGIN, GAIN_MARGIN = 4.0, 0.4, 20.0, 1.5
# Those of them that every experiment reads, and whether they are upper ones.
LIMITS = {
    "peak_sensitivity": (PEAK_SENSITIVITY, True),
    "phase_margin": (PHASE_MARGIN, False),
    "gain_margin_high": (GAIN_MARGIN, False),
}


@dataclass(frozen=True)
class Verdict:
    """Gains scored again.

    Attributes:
        point: (k,).
        score: Mean over fresh noise on the rig itself.
        score_se: Its standard error.
        intervals: (low, high) of score over rigs within tolerance; and, over these and fresh noise, of
            peak_sensitivity, phase_margin, gain_margin_high and displacement_share.
        reason: Why they are refused, or None.
        required: What the goal measures, by the names of the info: the median over fresh noise on the rig itself, and
            with _low and _high the ends over rigs within tolerance and fresh noise; empty for `match`.
        loop: Medians over fresh noise on the rig itself of LIMITS and the disk margin, whatever the goal measures.
    """

    point: np.ndarray
    score: float
    score_se: float
    intervals: dict[str, tuple[float, float]]
    reason: str | None
    required: dict[str, float] = field(default_factory=dict)
    loop: dict[str, float] = field(default_factory=dict)


@dataclass(frozen=True)
class Recommendation:
    """Which gains to use.

    Attributes:
        chosen: The first of the best-scored gains that are not refused; None where all are.
        refused: Those before it, best first.
        passed: Others that scored higher in their experiment.
    """

    chosen: Verdict | None
    refused: tuple[Verdict, ...]
    passed: PassedOver = field(default_factory=PassedOver)


def recommend(
    task: Task | RotorGoalTask,
    episode: Episode | RotorEpisode,
    trials: Trials,
    seed: int,
    candidates: int = 8,
    repeats: int = 16,
    rigs: int = 48,
) -> Recommendation:
    """Score the best distinct gains again and choose among them.

    The best of many scores is often that of a lucky reading: the first few are ranked by their means.

    Args:
        task: The task.
        episode: The rig.
        trials: What was tried.
        seed: Seed of the noise.
        candidates: Largest number of gains to score again.
        repeats: Repetitions on the rig itself with fresh noise.
        rigs: Number of rigs drawn within its data-sheet tolerance (1 sigma, normal).
    """
    rng = np.random.default_rng((seed, len(trials)))
    own = [replace(episode, seed=int(rng.integers(2**63))) for _ in range(repeats)]
    spread = [_within_tolerance(task, episode, rng) for _ in range(rigs)]
    fresh = [replace(episode, seed=int(rng.integers(2**63))) for _ in range(AGAIN)]
    refused: list[Verdict] = []
    lost: dict[str, float] = {}
    order, means = _ranked(task, trials, fresh)
    tried: list[int] = []
    skipped: list[int] = []
    for i in order:
        point = trials.points[i]
        if not trials.score[i] > 0 or len(refused) == candidates:
            break
        # A search that has converged tried hundreds of sets beside each other, which are refused for the same reason.
        apart = min(NEAR * 2 ** max(len(refused) - 1, 0), FARTHEST)
        away = [np.abs(v.point - point).max() for v in refused]
        if away and (min(away) <= apart or (away[-1] <= FARTHEST and _would_lose(trials.info[i], lost))):
            skipped.append(i)
            continue
        again = _again(task, point, own, spread)
        verdict = verdict_of(point, again, repeats, episode)
        if verdict.reason is None:
            return Recommendation(verdict, tuple(refused), passed_over(trials, i, means, tried, skipped))
        refused.append(verdict)
        tried.append(i)
        lost = _lost(again, repeats, verdict)
    return Recommendation(None, tuple(refused))


def judged_again(
    task: Task, episode: Episode, point: np.ndarray, seed: int, repeats: int = 16, rigs: int = 48
) -> Verdict:
    """The verdict on one point (k,), scored as those that `recommend` looks at; arguments as there."""
    rng = np.random.default_rng(seed)
    own = [replace(episode, seed=int(rng.integers(2**63))) for _ in range(repeats)]
    spread = [_within_tolerance(task, episode, rng) for _ in range(rigs)]
    return verdict_of(point, _again(task, point, own, spread), repeats, episode)


def _again(task: Task | RotorGoalTask, point: np.ndarray, *parts: Sequence[Episode | RotorEpisode]) -> Trials:
    """Trials of one point on the episodes of all parts, in this order."""
    return reduce(add, (experiments(task, e, np.tile(point, (len(e), 1)), [0] * len(e)) for e in parts))


def _lost(again: Trials, repeats: int, verdict: Verdict) -> dict[str, float]:
    """Factors by which refused gains came nearer to a limit within tolerance than on the rig itself, by figure."""
    found = {}
    for name in LIMITS:
        own = np.array([one.get(name, np.nan) for one in again.info[:repeats]], float)
        if name in verdict.intervals and not np.isnan(own).all():
            found[name] = verdict.intervals[name][1 if LIMITS[name][1] else 0] / float(np.nanmedian(own))
    return found


def _would_lose(info: Mapping[str, Any], lost: Mapping[str, float]) -> bool:
    """Whether gains that lose as much as those refused beside them would be refused, too, by their own reading."""
    for name, factor in lost.items():
        limit, most = LIMITS[name]
        there = info.get(name, np.nan) * factor
        if there > limit if most else there < limit:
            return True
    return False


def _ranked(
    task: Task | RotorGoalTask, trials: Trials, fresh: Sequence[Episode | RotorEpisode]
) -> tuple[list[int], dict[int, float]]:
    """Indices of the trials, the best first; FINALISTS that lie apart by their mean scores on fresh episodes.

    And these means by index.
    """
    order, first = [int(i) for i in np.argsort(-trials.score, kind="stable")], []
    for i in order:
        if len(first) == FINALISTS or not trials.score[i] > 0:
            break
        if all(np.abs(trials.points[j] - trials.points[i]).max() > NEAR for j in first):
            first.append(i)
    if len(first) < 2:
        return order, {}
    points = np.repeat(trials.points[first], len(fresh), axis=0)
    found = experiments(task, [*fresh] * len(first), points, [0] * len(points))
    means = found.score.reshape(len(first), len(fresh)).mean(axis=1)
    known = dict(zip(first, map(float, means), strict=True))
    first = [first[k] for k in np.argsort(-means, kind="stable")]
    return [*first, *(i for i in order if i not in first)], known


def _within_tolerance(
    task: Task | RotorGoalTask, episode: Episode | RotorEpisode, rng: np.random.Generator
) -> Episode | RotorEpisode:
    """The rig or rotor as another of its kind, with a seed of its own."""
    if isinstance(task, RotorGoalTask) or isinstance(episode, RotorEpisode):
        return task.draw(rng)
    rig = scaled_rig(episode.rig, tolerance_factors(episode.rig, rng))
    # These are the rigs within tolerance: a goal that draws rigs itself is judged on each of them alone.
    goal = task.layout.goal and replace(task.layout.goal, rigs=0)
    rig = replace(rig, target=replace(rig.target, goal=goal.text)) if goal else rig
    return replace(episode, rig=rig, seed=int(rng.integers(2**63)))


def verdict_of(point: np.ndarray, again: Trials, repeats: int, episode: Episode | RotorEpisode) -> Verdict:
    """Verdict on trials of one point: the first `repeats` on the rig itself, the others on rigs within tolerance."""
    whole = with_hidden(again)
    intervals, seen = _intervals(whole, repeats, episode), _intervals(again, repeats, episode)
    scores = again.score[:repeats]
    reason = _reason(again, seen)
    if reason is None and (hidden := _reason(whole, intervals) or _missed_between(again, whole, repeats, episode)):
        at = [one[f"{BETWEEN}peak_frequency"] for one in again.info if f"{BETWEEN}peak_frequency" in one]
        reason = f"between the lines at {np.median(at):.0f} Hz: {hidden}"
    se = float(scores.std(ddof=1) / np.sqrt(repeats)) if repeats > 1 else np.nan
    required, loop = _required(whole, repeats, _ENDS), _medians(whole, repeats)
    return Verdict(point, float(scores.mean()), se, intervals, reason, required, loop)


def with_hidden(again: Trials) -> Trials:
    """The trials with the margins of their loops at all frequencies, where a simulated loop hides some of them.

    Lines show nothing of a resonance that is narrower than their distance; see `Evaluation.between_lines`.
    """
    rows = []
    for one in again.info:
        row, by_goal = dict(one), any(name.startswith("required_") for name in one)
        for name in LOOP:
            if (hidden := one.get(BETWEEN + name)) is None:
                continue
            worse = np.fmax if QUANTITIES[name].most else np.fmin
            for own in (*([f"required_{name}"] if by_goal else []), OTHERWISE.get(name, name)):
                row[own] = float(worse(row.get(own, np.nan), hidden))
        rows.append(row)
    return replace(again, info=tuple(rows))


def _missed_between(again: Trials, whole: Trials, repeats: int, episode: Episode | RotorEpisode) -> str | None:
    """Which requirement of the rig's goal is met by the lines alone, so that the score counts it as met."""
    goal = None if isinstance(episode, RotorEpisode) else goal_of(episode.rig)
    for one in goal.requirements if goal else ():
        if one.name not in LOOP:
            continue
        read, is_so = (
            np.median([row.get(f"required_{one.name}", np.nan) for row in trials.info[:repeats]])
            for trials in (again, whole)
        )
        if misses(one, read) <= 0 < misses(one, is_so):
            most = "at most" if one.quantity.most else "at least"
            return f"{one.quantity.words} {is_so:#.3g}, and the goal asks for {most} {one.limit:.4g}"
    return None


def _intervals(again: Trials, repeats: int, episode: Episode | RotorEpisode) -> dict[str, tuple[float, float]]:
    """Intervals (low, high) of what a verdict looks at over fresh noise and tolerance; of the score over tolerance."""
    columns = {
        name: np.array([one.get(name, np.nan) for one in again.info], float)
        for name in ("peak_sensitivity", "phase_margin", "gain_margin_high")
    }
    peaks = np.array([one.get("peak_displacement", np.nan) for one in again.info], float)
    clearance = episode.rotor.axis.clearance if isinstance(episode, RotorEpisode) else episode.target.clearance
    columns["displacement_share"] = peaks / clearance
    columns["score"] = again.score[repeats:]
    return {n: tuple(map(float, np.nanpercentile(v, _ENDS))) for n, v in columns.items() if np.isfinite(v).any()}


def _medians(again: Trials, repeats: int) -> dict[str, float]:
    """Medians over the first trials of what every experiment reads of the loop, by name."""
    found = {}
    for name in (*LIMITS, "disk_margin"):
        values = np.array([one.get(name, np.nan) for one in again.info[:repeats]], float)
        found[name] = float(np.nanmedian(values)) if np.isfinite(values).any() else np.nan
    return found


def _required(again: Trials, repeats: int, ends: tuple[float, float]) -> dict[str, float]:
    """What the goal measures: medians over the first trials, and the ends (percentiles) over all.

    Noise raises a gain margin without bound and lowers it little, so that its mean is far above that of the loop. Of a
    quantity that is infinite in one of them, because the rotor touched down, so is the whole.
    """
    found = {}
    for name in dict.fromkeys(name for one in again.info for name in one):
        if name.startswith("required_") and not name.endswith(("_low", "_high")):
            values = np.array([one.get(name, np.nan) for one in again.info], float)
            known, own = values[~np.isnan(values)], values[:repeats]
            # A quantity of an event is infinite where the rotor touched down; between such values lies none.
            low, high = np.percentile(known, ends, method="closest_observation")
            own = own[~np.isnan(own)]
            middle = np.median if np.isfinite(own).all() else np.mean
            found[name] = float(middle(own)) if own.size else np.nan
            found |= {f"{name}_low": float(low), f"{name}_high": float(high)}
    return found


def _reason(again: Trials, intervals: dict[str, tuple[float, float]]) -> str | None:
    """Why gains are refused, in words with figures."""
    down = int(again.touchdown.sum())
    if down:
        return f"the rotor touches down in {down} of {len(again)} repetitions within tolerance"
    stable = np.array([bool(one.get("feasible", True)) for one in again.info])
    if unstable := int(((again.score <= 0) & ~stable).sum()):
        return f"the loop is unstable in {unstable} of {len(again)} repetitions within tolerance"
    if unseen := int((again.score <= 0).sum()):
        return (
            f"no stiffness and damping above 0 are identified in {unseen} of {len(again)} repetitions within "
            "tolerance: state a [target] band where the loop lies, or tune by requirements (--goal engineer)"
        )
    high = intervals.get("peak_sensitivity", (np.inf, np.inf))[1]
    if high > PEAK_SENSITIVITY:
        return f"peak sensitivity up to {high:.3g}, beyond zone B of ISO 14839-3 ({PEAK_SENSITIVITY:g})"
    high = intervals["displacement_share"][1]
    if high > DISPLACEMENT_SHARE:
        return f"displacement up to {high:.0%} of the clearance under the excitation, above {DISPLACEMENT_SHARE:.0%}"
    for name, least, unit in (("phase_margin", PHASE_MARGIN, " degrees"), ("gain_margin_high", GAIN_MARGIN, "")):
        low = intervals.get(name, (np.inf, np.inf))[0]
        if low < least:
            return f"{name.replace('_', ' ')} down to {low:.3g}{unit}, below {least:g}{unit}"
    return None
