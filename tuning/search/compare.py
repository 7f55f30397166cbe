"""Tuners compared: equal budgets on the same rigs, which none of them has seen; per tuner on disk, resumable."""

import json
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, replace
from importlib.metadata import version
from itertools import pairwise
from pathlib import Path
from time import perf_counter
from typing import Any
from zipfile import BadZipFile

import numpy as np
from filelock import FileLock, Timeout

from maglev_env.envs.episodes import Episode
from maglev_env.envs.task import Task
from maglev_env.files import atomic_file, write_text_atomic
from tuning.page import plain
from tuning.search.lockstep import course, optima, rescored, side_by_side
from tuning.search.methods import METHODS, make_tuner
from tuning.search.study import LOCK, experiments
from tuning.search.tuner import Trials, Tuner

SCHEMA = "maglev-compare-folder/1"
SPEC, RIGS = "comparison.json", "rigs.npz"
HELD_OUT = 271828  # beside the seed: rigs that the same seed draws for anything else are others
SEARCH = 600  # experiments that look for the best each rig allows
BETWEEN = (1, 3, 10, 30, 100, 300, 1000, 3000)  # where a course is looked at beside the budgets


@dataclass(frozen=True, eq=False)
class Result:
    """One tuner after each of m checkpoints: score (rigs, repeats, m) of its best-scored gains under fresh noise;
    touchdowns (rigs, repeats, m) on the way; seconds (m,) of all its rigs together, and tuner_seconds (m,), those of
    them that it took itself to ask and to be told; reused: whether an earlier run had made it."""

    score: np.ndarray
    touchdowns: np.ndarray
    seconds: np.ndarray
    tuner_seconds: np.ndarray
    reused: bool


@dataclass(frozen=True, eq=False)
class Comparison:
    """checkpoints (m,), experiments; budgets, those of them that were asked for; best (rigs,) score known of each rig;
    results by method; made_by: all that they depend on, as JSON data."""

    checkpoints: tuple[int, ...]
    budgets: tuple[int, ...]
    best: np.ndarray
    results: dict[str, Result]
    made_by: dict[str, Any]

    def regret(self, method: str, budget: int) -> np.ndarray:
        """Simple regret (rigs, repeats): best known score of the rig less that of the tuner's gains; 0 or more."""
        return self.best[:, None] - self.results[method].score[..., self.checkpoints.index(budget)]


def compare(
    task: Task,
    methods: Sequence[str],
    n_rigs: int,
    budgets: Sequence[int],
    repeats: int,
    seed: int,
    folder: Path,
    progress: Callable[[str, int], None] = lambda name, experiments: None,
) -> Comparison:
    """Run every tuner on the same n_rigs rigs drawn by the task, `repeats` times with other noise and tuner seeds, one
    experiment at a time; its gains are scored by fresh noise, the same for all.

    A finished tuner is in the folder and not run again, whatever others are asked for beside it; progress is told the
    name and number of experiments finished. ValueError for unknown methods, numbers out of range, or a folder of
    another comparison; BlockingIOError while another process works there.
    """
    methods, budgets = tuple(dict.fromkeys(methods)), tuple(budgets)
    check_comparison(methods, n_rigs, budgets, repeats)
    checkpoints = tuple(sorted({*budgets, *(n for n in BETWEEN if n < budgets[-1])}))
    made_by = {
        "rigs": n_rigs, "budgets": budgets, "repeats": repeats, "seed": seed, "search": SEARCH,
        "randomization": task.randomization, "effects": task.effects, "sensor": task.sensor, "rig": asdict(task.rig),
        "target": asdict(task.target), "draw_target": task.draw_target, "box": asdict(task.box),
    }  # fmt: skip
    made_by = {"schema": SCHEMA, "version": version("maglev-workbench"), **plain(made_by)}
    folder.mkdir(parents=True, exist_ok=True)
    try:
        with FileLock(folder / LOCK, timeout=0):
            _claim(folder, made_by)
            rigs, lanes, seeds = held_out(task, n_rigs, repeats, seed)
            shape = (n_rigs, repeats, -1)
            best = _best_by_search(folder / RIGS, task, rigs, lanes, seed).reshape(n_rigs, repeats).mean(axis=1)
            progress("best of each rig", SEARCH * n_rigs)
            results = {}
            for method in methods:
                path = folder / f"{method}.npz"
                if reused := path.exists():
                    found = _load(path)
                    progress(method, len(lanes) * budgets[-1])
                else:
                    found = _run(task, method, lanes, seeds, checkpoints, seed, lambda n, m=method: progress(m, n))
                    _save(path, found)
                found = {k: v.reshape(shape) if v.ndim == 2 else v for k, v in found.items()}
                results[method] = Result(**found, reused=reused)
    except Timeout:
        raise BlockingIOError(f"{folder}: another process compares there; wait, or choose another folder") from None
    reached = np.max([r.score.max(axis=(1, 2)) for r in results.values()], axis=0)
    return Comparison(checkpoints, budgets, np.maximum(best, reached), results, {**made_by, "methods": list(methods)})


def check_comparison(methods: Sequence[str], n_rigs: int, budgets: Sequence[int], repeats: int) -> None:
    """ValueError unless methods are known, budgets increase from 1 or more, and there are rigs and repeats."""
    if unknown := [m for m in methods if m not in METHODS]:
        raise ValueError(f"method {unknown[0]!r} is unknown; use some of {', '.join(METHODS)}")
    if not methods:
        raise ValueError("no method is given")
    if not budgets or budgets[0] < 1 or any(b <= a for a, b in pairwise(budgets)):
        raise ValueError(f"budgets = {', '.join(map(str, budgets))}: give increasing numbers of experiments, 1 or more")
    if n_rigs < 1 or repeats < 1:
        raise ValueError(f"rigs = {n_rigs}, repeats = {repeats}: give at least one of each")


def held_out(task: Task, n_rigs: int, repeats: int, seed: int) -> tuple[list[Episode], list[Episode], list[int]]:
    """Episodes of n_rigs rigs; n_rigs * repeats of them, rig by rig, that differ in their noise; seeds of the tuners.

    Each rig comes from the seed and its number: fewer rigs are the first of more.
    """
    rigs, lanes, seeds = [], [], []
    for i in range(n_rigs):
        rng = np.random.default_rng((HELD_OUT, seed, i))
        rigs.append(task.draw(rng))
        lanes += [replace(rigs[-1], seed=int(s)) for s in rng.integers(2**63, size=repeats)]
        seeds += rng.integers(2**31, size=repeats).tolist()
    return rigs, lanes, seeds


class _Timed:
    """A tuner that adds the time it takes to spent[0]."""

    def __init__(self, tuner: Tuner, spent: list[float]) -> None:
        self._tuner, self._spent = tuner, spent

    def ask(self, n: int) -> np.ndarray:
        started = perf_counter()
        points = self._tuner.ask(n)
        self._spent[0] += perf_counter() - started
        return points

    def tell(self, trials: Trials) -> None:
        started = perf_counter()
        self._tuner.tell(trials)
        self._spent[0] += perf_counter() - started

    def close(self) -> None:
        if hasattr(self._tuner, "close"):
            self._tuner.close()


def _run(
    task: Task,
    method: str,
    lanes: Sequence[Episode],
    seeds: Sequence[int],
    checkpoints: Sequence[int],
    seed: int,
    progress: Callable[[int], None],
) -> dict[str, np.ndarray]:
    budget, spent, clock = checkpoints[-1], [0.0], []
    tuners = [_Timed(make_tuner(method, task, e, s, budget), spent) for e, s in zip(lanes, seeds, strict=True)]
    experiments(task, lanes[:1], lanes[0].start[None], 0)  # loads compiled code, which is nobody's time
    started = perf_counter()

    def told(n: int) -> None:
        clock.append((perf_counter() - started, spent[0]))
        progress(n)

    trials = side_by_side(task, lanes, tuners, budget, progress=told)
    found = course(task, lanes, trials, checkpoints, seed)
    seconds, own = np.array(clock)[np.array(checkpoints) - 1].T
    return {"score": found.best, "touchdowns": found.touchdowns, "seconds": seconds, "tuner_seconds": own}


def _best_by_search(path: Path, task: Task, rigs: Sequence[Episode], lanes: Sequence[Episode], seed: int) -> np.ndarray:
    """Score (lanes,) of what a long search finds on each rig, under the noise that scores the tuners."""
    if path.exists():
        return _load(path)["score"]
    points, _ = optima(task, rigs, seed, SEARCH)
    score = rescored(task, lanes, np.repeat(points, len(lanes) // len(rigs), axis=0), seed)
    _save(path, {"points": points, "score": score})
    return score


def _claim(folder: Path, made_by: dict[str, Any]) -> None:
    path = folder / SPEC
    if not path.exists():
        if others := [p.name for p in folder.iterdir() if p.name != LOCK and not p.name.startswith(".")]:
            raise ValueError(f"{folder} holds {others[0]} and no comparison; choose another folder")
        write_text_atomic(path, json.dumps(made_by, indent=1) + "\n")
        return
    try:
        found = json.loads(path.read_text())
    except ValueError:
        raise ValueError(f"{path} is not the description of a comparison; choose another folder") from None
    if different := [key for key in {**found, **made_by} if found.get(key) != made_by.get(key)]:
        key = different[0]
        both = "" if isinstance(found.get(key), dict) else f" ({found.get(key)!r}, not {made_by.get(key)!r})"
        raise ValueError(f"{folder} holds a comparison of another {key}{both}; choose another folder")


def _save(path: Path, arrays: dict[str, np.ndarray]) -> None:
    with atomic_file(path) as file:
        np.savez(file, **arrays)


def _load(path: Path) -> dict[str, np.ndarray]:
    try:
        with np.load(path, allow_pickle=False) as stored:
            return dict(stored)
    except (BadZipFile, ValueError, EOFError) as error:
        raise ValueError(f"{path} is damaged ({error}); delete it, and it is made again") from error
