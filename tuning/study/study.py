"""A study: one tuner on one rig, one experiment after another, with a journal from which it can be resumed."""

import json
import os
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import reduce
from operator import add
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from maglev_env.recordings.result_folder import claim, locked
from maglev_env.task.task import Tuning, infos
from maglev_lanes.code_version import code_version
from tuning.tuner import Trials, Tuner

if TYPE_CHECKING:
    from maglev_lanes.schedule import Workers

SCHEMA = "maglev-study/1"
SPEC, JOURNAL = "study.json", "journal.jsonl"


@dataclass(frozen=True)
class Outcome:
    """Result of a study.

    Attributes:
        trials: All trials in order.
        reused: Number of them that an earlier run made.
        dropped: Whether the last record of the journal was incomplete, as after a kill while it was written; its
            experiments were repeated.
    """

    trials: Trials
    reused: int
    dropped: bool


def experiments(
    task: Tuning,
    episodes: Sequence[Any],
    points: np.ndarray,
    first: int | Sequence[int],
    threads: int | None = None,
    workers: "Workers | None" = None,
) -> Trials:
    """Run experiments at points (n, k) on n episodes.

    Threads and workers do not affect the results: an experiment is the same whatever runs beside it.

    Args:
        task: The task.
        episodes: One episode for each point.
        points: Points (n, k).
        first: Number of each experiment, from which its noise is drawn; or that of the first.
        threads: Number of threads; None for all cores.
        workers: Where to run.
    """
    counts = list(first) if isinstance(first, Sequence) else [first + i for i in range(len(points))]
    if workers is not None:
        shares = np.array_split(np.arange(len(points)), min(len(points), len(workers)))
        parts = [(task, [episodes[i] for i in own], points[own], [counts[i] for i in own]) for own in shares]
        return reduce(add, workers.map(_share, parts))
    found, observation = task.measure(episodes, points, counts, threads)
    down = np.isfinite(found.touchdown_time)
    score = np.where(down, 0.0, found.score)
    return Trials(np.asarray(points), score, observation, tuple(infos(task, found, points)), down)


def _share(part: tuple[Tuning, Sequence[Any], np.ndarray, Sequence[int]]) -> Trials:
    return experiments(*part, threads=1)


def run_study(
    folder: Path,
    task: Tuning,
    episode: Any,
    tuner: Tuner,
    made_by: dict[str, Any],
    budget: int,
    batch: int = 1,
    threads: int | None = None,
    progress: Callable[[int, bool], None] = lambda done, reused: None,
    workers: "Workers | None" = None,
) -> Outcome:
    """Run or resume a study in a folder until `budget` experiments are made, `batch` at a time.

    A tuner depends only on its seed and on what it was told. The journal's experiments are told again and not repeated,
    so an interrupted study equals an uninterrupted one. A larger budget goes on behind what the smaller one made.

    Args:
        folder: Folder of the study.
        task: The task.
        episode: The rig.
        tuner: The tuner.
        made_by: What else the result depends on (rig, method, arguments, seed), as JSON data.
        budget: Number of experiments.
        batch: Experiments at a time.
        threads: Number of threads; None for all cores.
        progress: Called with the number of new trials and whether all so far are reused.
        workers: Where to run.

    Raises:
        ValueError: The folder holds another study, or one of another version, or the tuner asks for other points than
            the journal holds, or a record of the journal is damaged that is not the last, or the
            budget ends among experiments that were made together.
        BlockingIOError: Another process works on it.
    """
    if budget < 1 or batch < 1:
        raise ValueError(f"budget = {budget}, batch = {batch}: give at least one experiment")
    with locked(folder):
        return _run(folder, task, episode, tuner, made_by, budget, batch, threads, progress, workers)


def _run(folder, task, episode, tuner, made_by, budget, batch, threads, progress, workers) -> Outcome:  # see run_study
    claim(folder / SPEC, {"schema": SCHEMA, "version": code_version(), "batch": batch, **made_by}, "study")
    kept, dropped = _read(folder / JOURNAL)
    trials: Trials | None = None
    reused = 0
    while (done := 0 if trials is None else len(trials)) < budget:
        # What a smaller budget had left of a batch is asked for as it was then.
        asked = kept[0][0] if kept else min(batch, budget - done)
        points = tuner.ask(asked)
        if kept:
            _, new = kept.pop(0)
            if done + len(new) > budget:
                to = f"{done + len(new)}" + (f" or {done}" if done else "")
                raise ValueError(
                    f"{folder}: experiments {done + 1} to {done + len(new)} were made together, and a budget of "
                    f"{budget} ends among them; use --budget {to}"
                )
            if new.points.shape != points.shape or not np.array_equal(new.points, points):
                raise ValueError(
                    f"{folder / JOURNAL}: at experiment {done + 1} this tuner asks for other gains than were tried "
                    "there; a study goes on with the budget step, libraries and seed that it was begun with"
                )
            reused += len(new)
        else:
            new = experiments(task, [episode] * len(points), points, done + 1, threads, workers)
            _append(folder / JOURNAL, new, asked)
        tuner.tell(new)
        trials = new if trials is None else trials + new
        progress(len(new), reused == len(trials))
    return Outcome(trials, reused, dropped)


def _read(path: Path) -> tuple[list[tuple[int, Trials]], bool]:
    """Records of a journal with the numbers of points asked for, and whether its last was broken, which is cut off.

    Raises:
        ValueError: A record before the last one is damaged, which no kill explains.
    """
    if not path.exists():
        return [], False
    kept: list[tuple[int, Trials]] = []
    lines = path.read_bytes().splitlines(keepends=True)
    for number, line in enumerate(lines, 1):
        try:
            record = json.loads(line) if line.endswith(b"\n") else None
            trials = _trials(record)
            if int(record["asked"]) < max(1, len(trials)):
                raise ValueError("more points than were asked for")
            kept.append((int(record["asked"]), trials))
        except (ValueError, KeyError, TypeError, AttributeError) as error:
            if number < len(lines):
                raise ValueError(
                    f"{path}: line {number} of {len(lines)} is damaged ({error!r}); put back the file as it was, or "
                    "delete this line and those behind it, and their experiments are made again"
                ) from None
            with path.open("r+b") as file:
                file.truncate(sum(map(len, lines[:-1])))
            return kept, True
    return kept, False


def _trials(record: dict[str, Any]) -> Trials:
    arrays = (np.array(record[name], dtype) for name, dtype in (("points", float), ("score", float)))
    points, score = arrays
    observation = np.array(record["observation"], np.float32)
    info = tuple({k: np.array(v) if isinstance(v, list) else v for k, v in one.items()} for one in record["info"])
    found = Trials(points, score, observation, info, np.array(record["touchdown"], bool))
    if {len(part) for part in (score, observation, info, found.touchdown)} != {len(points)}:
        raise ValueError("arrays of unequal length")
    if points.ndim != 2 or not (np.abs(points) <= 1).all():  # not a number is not within any bounds
        raise ValueError("points that are not in the box -1 .. 1")
    if score.ndim != 1 or not ((score >= 0) & (score <= 1)).all():
        raise ValueError("a score that is not in 0 .. 1")
    return found


def _append(path: Path, trials: Trials, asked: int) -> None:
    record = {
        "asked": asked,
        "points": trials.points.tolist(),
        "score": trials.score.tolist(),
        "observation": trials.observation.astype(float).tolist(),
        "info": [{k: v.tolist() if isinstance(v, np.ndarray) else v for k, v in one.items()} for one in trials.info],
        "touchdown": trials.touchdown.tolist(),
    }
    with path.open("ab") as file:
        file.write((json.dumps(record) + "\n").encode())
        file.flush()
        os.fsync(file.fileno())
