"""Many studies side by side: every tuner asks, all experiments run as one batch of lanes, every tuner is told."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, fields, replace
from typing import Any

import numpy as np

from maglev_env.evaluation.goal_score import met
from maglev_env.task.task import Tuning
from tuning.search.evolution import DifferentialEvolution
from tuning.study.recommendation import with_hidden
from tuning.study.study import experiments
from tuning.tuner import Trials, Tuner, close

AGAIN = 8  # fresh repetitions that score what a tuner would recommend


@dataclass(frozen=True)
class Course:
    """The experiments of one tuner on n rigs, in order.

    Attributes:
        points: Points that it asked for, (n, budget, k).
        score: Scores that it was told, (n, budget).
        touchdown: Touchdowns that it was told, (n, budget).
    """

    points: np.ndarray
    score: np.ndarray
    touchdown: np.ndarray


def side_by_side(
    task: Tuning,
    episodes: Sequence[Any],
    tuners: Sequence[Tuner],
    budget: int,
    batch: int = 1,
    threads: int | None = None,
    progress: Callable[[int], None] = lambda n: None,
) -> list[Trials]:
    """Trials of every tuner on its own episode: `budget` experiments each, at most `batch` at a time."""
    done: list[Trials | None] = [None] * len(tuners)
    while open_ := [i for i, t in enumerate(done) if t is None or len(t) < budget]:
        counts = [0 if done[i] is None else len(done[i]) for i in open_]
        asked = [tuners[i].ask(min(batch, budget - n)) for i, n in zip(open_, counts, strict=True)]
        lanes = [episodes[i] for i, points in zip(open_, asked, strict=True) for _ in points]
        numbers = [n + 1 + j for n, points in zip(counts, asked, strict=True) for j in range(len(points))]
        found = experiments(task, lanes, np.concatenate(asked), numbers, threads)
        at = 0
        for i, points in zip(open_, asked, strict=True):
            new = _part(found, slice(at, at + len(points)))
            at += len(points)
            tuners[i].tell(new)
            done[i] = new if done[i] is None else done[i] + new
        progress(at)
    for tuner in tuners:
        close(tuner)
    return done


def course(trials: Sequence[Trials]) -> Course:
    """Trials of n rigs, of equal number, as arrays."""
    return Course(*(np.stack([getattr(t, f.name) for t in trials]) for f in fields(Course)))


def judged(
    task: Tuning, episodes: Sequence[Any], found: Course, checkpoints: Sequence[int], seed: int
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Evaluate what a tuner would recommend after certain numbers of experiments.

    Returns:
        score: Score of the best gains so far, measured again under noise from seed, (n, checkpoints).
        touchdowns: Number of touchdowns so far, (n, checkpoints).
        met: Whether these gains meet every requirement of the goal, (n, checkpoints): 1 or 0; nan without a goal.
    """
    best, down, meets = np.zeros((3, len(episodes), len(checkpoints)))
    for j, n in enumerate(checkpoints):
        chosen = found.score[:, :n].argmax(axis=1)
        again = _again(task, episodes, found.points[np.arange(len(episodes)), chosen], seed)
        best[:, j] = again.score.reshape(-1, AGAIN).mean(axis=1)
        meets[:, j] = _meets(task, again)
        down[:, j] = found.touchdown[:, :n].sum(axis=1)
    return best, down, meets


def rescored(
    task: Tuning, episodes: Sequence[Any], points: np.ndarray, seed: int, threads: int | None = None
) -> np.ndarray:
    """Mean score (n,) of one point (n, k) on each episode, over AGAIN repetitions with their own noise."""
    return _again(task, episodes, points, seed, threads).score.reshape(-1, AGAIN).mean(axis=1)


def _again(task: Tuning, episodes: Sequence[Any], points: np.ndarray, seed: int, threads: int | None = None) -> Trials:
    """AGAIN repetitions of one point (n, k) on each episode, one episode after the other."""
    rng = np.random.default_rng(seed)
    fresh = [replace(e, seed=int(rng.integers(2**63))) for e in episodes for _ in range(AGAIN)]
    return experiments(task, fresh, np.repeat(points, AGAIN, axis=0), [0] * len(fresh), threads)


def _meets(task: Tuning, again: Trials) -> np.ndarray:
    """Whether the medians of AGAIN repetitions meet every requirement of the task's goal, (n,); nan without one.

    What a loop hides between the lines of its experiment counts, too.
    """
    goal = getattr(task.layout, "goal", None)
    if goal is None:
        return np.full(len(again) // AGAIN, np.nan)
    whole = with_hidden(again)
    values = {}
    for one in goal.requirements:
        read = np.array([row.get(f"required_{one.name}", np.nan) for row in whole.info], float).reshape(-1, AGAIN)
        # Of a touchdown in an event, infinity; of what the lines do not hold, nan.
        with np.errstate(invalid="ignore"):
            values[one.name] = np.median(read, axis=1)
    held = np.array([bool(row.get("feasible", True)) for row in whole.info]).reshape(-1, AGAIN).all(axis=1)
    return (held & met(goal, values)).astype(float)


def optima(
    task: Tuning, episodes: Sequence[Any], seed: int, budget: int = 600, threads: int | None = None
) -> tuple[np.ndarray, np.ndarray]:
    """Near-optimal points (n, k) of each rig and their scores (n,) under fresh noise, by a long search."""
    k = len(task.box.names)
    tuners = [DifferentialEvolution(k, seed + i, 10, e.start) for i, e in enumerate(episodes)]
    trials = side_by_side(task, episodes, tuners, budget, 10 * k, threads)
    points = np.stack([t.points[t.best] for t in trials])
    return points, rescored(task, episodes, points, seed, threads)


def _part(trials: Trials, at: slice) -> Trials:
    t = trials
    return Trials(t.points[at], t.score[at], t.observation[at], t.info[at], t.touchdown[at])
