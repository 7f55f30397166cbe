"""Comparison of tuners with equal budgets on the same unseen rigs; results per tuner are stored and reused."""

from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, fields
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from maglev_env.recordings.formats.json_data import plain
from maglev_env.recordings.result_folder import claim, is_empty, load_arrays, locked, save_arrays
from maglev_env.task.episodes import Episode
from maglev_env.task.task import Task
from maglev_lanes.code_version import code_version
from maglev_lanes.price import check_experiments
from tuning.comparison.rigs import held_out
from tuning.comparison.runs import CHUNK, Runs, stored_parts
from tuning.lockstep import Course, judged, optima, rescored
from tuning.methods import LEARNED, make_tuner, method_of, policy_digest

if TYPE_CHECKING:
    from maglev_lanes.schedule import Workers
    from tuning.learned.policy import HistoryPolicy

SCHEMA = "maglev-compare-folder/1"
SPEC, RIGS, PARTS = "comparison.json", "rigs.npz", "parts"
SEARCH = 600  # experiments that search for the best score of each rig
BETWEEN = (1, 3, 10, 30, 100, 300, 1000, 3000)  # numbers of experiments that are evaluated besides the budgets


@dataclass(frozen=True, eq=False)
class Result:
    """Results of one tuner at m checkpoints; nan beyond the largest that its `Method.longest` allows.

    Attributes:
        score: Score of its best gains under fresh noise, (rigs, repeats, m).
        touchdowns: Number of touchdowns so far, (rigs, repeats, m).
        met: Whether these gains meet every requirement, (rigs, repeats, m): 1 or 0; nan without a goal of requirements.
        seconds: Time for all rigs together, (m,), s.
        tuner_seconds: Part of that time that the tuner itself took to ask and be told, (m,), s.
        reused: Whether an earlier run made the results.
    """

    score: np.ndarray
    touchdowns: np.ndarray
    met: np.ndarray
    seconds: np.ndarray
    tuner_seconds: np.ndarray
    reused: bool


@dataclass(frozen=True, eq=False)
class Comparison:
    """A comparison of tuners.

    Attributes:
        checkpoints: Numbers of experiments (m,).
        budgets: Those of them that were requested.
        best: Best known score of each rig under the noise of each repeat, (rigs, repeats).
        results: Results by method.
        made_by: Everything that they depend on, as JSON data.
    """

    checkpoints: tuple[int, ...]
    budgets: tuple[int, ...]
    best: np.ndarray
    results: dict[str, Result]
    made_by: dict[str, Any]

    def reached(self, budget: int) -> list[str]:
        """The tuners that were run up to this budget."""
        return [m for m, r in self.results.items() if np.isfinite(r.seconds[self.checkpoints.index(budget)])]

    def regret(self, method: str, budget: int) -> np.ndarray:
        """Simple regret (rigs, repeats): best known score of the rig minus that of the tuner's gains, at least 0."""
        return self.best - self.results[method].score[..., self.checkpoints.index(budget)]


def compare(
    task: Task,
    methods: Sequence[str],
    n_rigs: int,
    budgets: Sequence[int],
    repeats: int,
    seed: int,
    folder: Path,
    progress: Callable[[str, int], None] = lambda name, experiments: None,
    policy: "HistoryPolicy | None" = None,
    workers: "Workers | None" = None,
    affected: bool = False,
) -> Comparison:
    """Run every tuner on the same rigs, and score its gains under fresh noise that is the same for all.

    Finished runs of a tuner are kept in the folder and not repeated, whichever other tuners are requested.

    Args:
        task: The task that draws the rigs.
        methods: Names of the tuners.
        n_rigs: Number of rigs.
        budgets: Increasing numbers of experiments.
        repeats: Repetitions with other noise and tuner seeds.
        seed: Seed of rigs, noise and tuners.
        folder: Folder of the results.
        progress: Called with the name of what advances and the number of experiments finished.
        policy: Policy of the learned tuner; None for that of this package.
        workers: Where it runs, which affects the times only.
        affected: Whether every other rig has an effect (see `held_out`).

    Raises:
        ValueError: Unknown methods, numbers out of range, a policy that does not fit, or a folder of another
            comparison.
        BlockingIOError: Another process works in the folder.
    """
    methods, budgets = tuple(dict.fromkeys(methods)), tuple(budgets)
    check_comparison(methods, n_rigs, budgets, repeats)
    check_policy(task, methods, policy)
    checkpoints = tuple(sorted({*budgets, *(n for n in BETWEEN if n < budgets[-1])}))
    made_by = {
        "rigs": n_rigs, "budgets": budgets, "repeats": repeats, "seed": seed, "search": SEARCH,
        "randomization": task.randomization, "effects": task.effects, "affected": affected, "sensor": task.sensor,
        "rig": asdict(task.rig),
        "target": asdict(task.target), "draw_target": task.draw_target, "box": asdict(task.box),
    }  # fmt: skip
    made_by = {"schema": SCHEMA, "version": code_version(), **plain(made_by)}
    with locked(folder):
        _claim(folder, made_by)
        rigs, lanes, seeds = held_out(task, n_rigs, repeats, seed, affected)
        shape = (n_rigs, repeats, -1)
        searched = _best_by_search(folder / RIGS, task, rigs, lanes, seed, progress, workers)
        best = searched.reshape(n_rigs, repeats)
        results = {}
        for method in methods:
            path = folder / f"{_label(method, policy, task)}.npz"
            if reused := path.exists():
                found = load_arrays(path)
                progress(method, len(lanes) * budget_of(method, budgets))
            else:
                own = policy if method == LEARNED else None
                runs = Runs(task, method, lanes, seeds, budget_of(method, budgets), own)
                parts = stored_parts(runs, folder / PARTS / path.stem, workers, lambda n, m=method: progress(m, n))
                found = _result(runs, parts, checkpoints, seed)
                save_arrays(path, found)
            found = {k: v.reshape(shape) if v.ndim == 2 else v for k, v in found.items()}
            results[method] = Result(**found, reused=reused)
    reached = np.max([np.nanmax(r.score, axis=2) for r in results.values()], axis=0)
    return Comparison(checkpoints, budgets, np.maximum(best, reached), results, {**made_by, "methods": list(methods)})


def check_comparison(methods: Sequence[str], n_rigs: int, budgets: Sequence[int], repeats: int) -> None:
    """Check the arguments of a comparison.

    Raises:
        ValueError: Methods are unknown, budgets do not increase from 1 or more, or there are no rigs or repeats.
    """
    for name in methods:
        method_of(name)
    if not methods:
        raise ValueError("no method is given")
    if not budgets or budgets[0] < 1 or any(b <= a for a, b in pairwise(budgets)):
        raise ValueError(f"budgets = {', '.join(map(str, budgets))}: give increasing numbers of experiments, 1 or more")
    if n_rigs < 1 or repeats < 1:
        raise ValueError(f"rigs = {n_rigs}, repeats = {repeats}: give at least one of each")
    check_experiments(n_rigs * max(SEARCH, repeats * budgets[-1]), 0, "rigs, repeats and budgets")


def check_policy(task: Task, methods: Sequence[str], policy: "HistoryPolicy | None") -> None:
    """Check that the learned tuner has a policy that fits the task.

    Raises:
        ValueError: It has none, or a policy is given without the learned tuner.
    """
    if LEARNED in methods and policy is None:
        policy_digest(task, None)  # where none of this package fits, another tuner would stand in for it
    elif LEARNED in methods:
        make_tuner(LEARNED, task, task.draw(np.random.default_rng(0)), 0, 1, policy)
    elif policy is not None:
        raise ValueError(f"a policy is given and method {LEARNED} is not; name it too, or leave the policy out")


def budget_of(method: str, budgets: Sequence[int]) -> int:
    """Number of experiments of a tuner on a rig: the largest budget that it takes, or else the smallest."""
    longest = method_of(method).longest
    return max((b for b in budgets if longest is None or b <= longest), default=budgets[0])


def _result(
    runs: Runs, parts: Sequence[dict[str, np.ndarray]], checkpoints: Sequence[int], seed: int
) -> dict[str, np.ndarray]:
    """The arrays of a Result, with all runs in one row."""
    whole = Course(*(np.concatenate([part[f.name] for part in parts]) for f in fields(Course)))
    reach = [n for n in checkpoints if n <= runs.budget]
    score, touchdowns, meets = judged(runs.task, runs.lanes, whole, reach, seed)
    seconds, own = np.sum([part["clock"] for part in parts], axis=0)[np.array(reach) - 1].T
    found = {"score": score, "touchdowns": touchdowns, "met": meets, "seconds": seconds, "tuner_seconds": own}
    beyond = len(checkpoints) - len(reach)
    return {k: np.pad(v, [*[(0, 0)] * (v.ndim - 1), (0, beyond)], constant_values=np.nan) for k, v in found.items()}


def _label(method: str, policy: "HistoryPolicy | None", task: Task) -> str:
    """The name of a tuner's results in a folder."""
    return f"{method}-{policy_digest(task, policy)[:12]}" if method == LEARNED else method


def _best_by_search(
    path: Path,
    task: Task,
    rigs: Sequence[Episode],
    lanes: Sequence[Episode],
    seed: int,
    progress: Callable[[str, int], None],
    workers: "Workers | None",
) -> np.ndarray:
    """Score (lanes,) of the best gains that a long search finds on each rig, under the noise that scores the tuners."""
    if path.exists():
        progress("best of each rig", SEARCH * len(rigs))
        return load_arrays(path)["score"]
    jobs = [(task, rigs[i : i + CHUNK], seed + i, SEARCH) for i in range(0, len(rigs), CHUNK)]
    found = {}
    here = enumerate(optima(*job)[0] for job in jobs)
    for i, points in here if workers is None else workers.each(_searched, jobs):
        found[i] = points
        progress("best of each rig", SEARCH * len(points))
    points = np.concatenate([found[i] for i in range(len(jobs))])
    score = rescored(task, lanes, np.repeat(points, len(lanes) // len(rigs), axis=0), seed)
    save_arrays(path, {"points": points, "score": score})
    return score


def _searched(job: tuple[Task, Sequence[Episode], int, int]) -> np.ndarray:
    return optima(*job, threads=1)[0]


def _claim(folder: Path, made_by: dict[str, Any]) -> None:
    if not is_empty(folder) and not (folder / SPEC).exists():
        raise ValueError(f"{folder} is not empty and holds no comparison; choose another folder")
    claim(folder / SPEC, made_by, "comparison")
