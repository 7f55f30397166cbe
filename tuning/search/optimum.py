"""The best point of one simulated rig, by a search that asks for a population at a time."""

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np

from maglev_env.task.task import Tuning
from tuning.study.study import experiments
from tuning.tuner import Tuner

WHOLE = 10**6  # larger than any population: asks for all of it


def searched_optimum(
    task: Tuning,
    episode: Any,
    search: Tuner,
    generations: int,
    start: np.ndarray,
    number: int = 0,
    place: Callable[[np.ndarray], np.ndarray] = lambda asked: asked,
) -> np.ndarray:
    """Best-scoring point (k,) on one rig over several populations of a search; `start` if none scores.

    Args:
        task: The task.
        episode: The rig.
        search: The search.
        generations: Number of populations.
        start: Point to return when none scores.
        number: Number of the experiments, from which their noise is drawn.
        place: Maps what the search asks for to points.
    """
    best, score = start, -1.0
    for _ in range(generations):
        asked = search.ask(WHOLE)
        points = place(asked)
        found = experiments(task, [episode] * len(points), points, [number] * len(points))
        search.tell(replace(found, points=asked))
        if found.score[found.best] > score:
            best, score = points[found.best], float(found.score[found.best])
    search.close()
    return best
