"""Runs of one tuner in a comparison: many rigs side by side, timed, and stored in parts as they are finished."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from time import perf_counter
from typing import TYPE_CHECKING

import numpy as np

from maglev_env.recordings.result_folder import load_arrays, save_arrays
from maglev_env.task.episodes import Episode
from maglev_env.task.task import Task
from tuning.lockstep import course, side_by_side
from tuning.methods import make_tuner
from tuning.study.study import experiments
from tuning.tuner import Trials, Tuner, close

if TYPE_CHECKING:
    from maglev_lanes.schedule import Workers
    from tuning.learned.policy import HistoryPolicy

CHUNK = 50  # runs whose experiments are simulated together and stored together


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
        close(self._tuner)


@dataclass(frozen=True, eq=False)
class Runs:
    """One tuner on several lanes, each with its own seed."""

    task: Task
    method: str
    lanes: Sequence[Episode]
    seeds: Sequence[int]
    budget: int
    policy: "HistoryPolicy | None"


def stored_parts(
    runs: Runs, folder: Path, workers: "Workers | None", progress: Callable[[int], None]
) -> list[dict[str, np.ndarray]]:
    """Results of `_experiments` for every CHUNK lanes, in order; each is stored as soon as it is finished."""
    folder.mkdir(parents=True, exist_ok=True)
    jobs, paths = [], []
    for i in range(0, len(runs.lanes), CHUNK):
        part = replace(runs, lanes=runs.lanes[i : i + CHUNK], seeds=runs.seeds[i : i + CHUNK])
        paths.append(folder / f"{i:06d}.npz")
        if paths[-1].exists():
            progress(len(part.lanes) * runs.budget)
        else:
            jobs.append((part, paths[-1]))
    todo = [part for part, _ in jobs]
    done = enumerate(map(_experiments, todo)) if workers is None else workers.each(_on_worker, todo)
    for j, found in done:
        part, path = jobs[j]
        save_arrays(path, found)
        progress(len(part.lanes) * runs.budget)
    return [load_arrays(path) for path in paths]


def _on_worker(runs: Runs) -> dict[str, np.ndarray]:
    return _experiments(runs, threads=1)


def _experiments(runs: Runs, threads: int | None = None) -> dict[str, np.ndarray]:
    """The arrays of a Course, and clock (budget, 2): s since the first experiment of all lanes, and s of the tuners."""
    spent, clock = [0.0], []
    tuners = [
        _Timed(make_tuner(runs.method, runs.task, e, s, runs.budget, runs.policy), spent)
        for e, s in zip(runs.lanes, runs.seeds, strict=True)
    ]
    # Load compiled code first, so that its time is not counted.
    experiments(runs.task, runs.lanes[:1], runs.lanes[0].start[None], 0, threads)
    started = perf_counter()
    trials = side_by_side(
        runs.task, runs.lanes, tuners, runs.budget, threads=threads,
        progress=lambda _: clock.append((perf_counter() - started, spent[0])),
    )  # fmt: skip
    return {**vars(course(trials)), "clock": np.array(clock)}
