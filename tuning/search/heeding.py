"""Any tuner that is told what a recommendation refuses, as the model-corrected one knows it."""

from dataclasses import replace

import numpy as np

from maglev_env.task.episodes import Episode
from maglev_env.task.task import Task
from tuning.search.corrected.loops import LineModel
from tuning.search.corrected.tolerated import Tolerated
from tuning.study.limits import LIMITS, heeding
from tuning.tuner import Trials, Tuner, close


class Heeding:
    """A tuner to which gains score less where they would be refused, on the rig or on rigs within tolerance.

    What experiments read counts, and what the simulated loop hides between their lines. What the tolerances add to that
    is of the nominal rig, without the task's effects, which no tuner is told.
    """

    def __init__(self, tuner: Tuner, task: Task, episode: Episode) -> None:
        self._tuner, self._clearance = tuner, episode.target.clearance
        known = replace(task, effects={})
        self._tolerated = Tolerated([LineModel(known, axis, task.layout.goal) for axis in range(task.rig.axes)])
        self._tolerated.open(task.rig)

    @property
    def note(self) -> str | None:
        """What the tuner says of itself."""
        return getattr(self._tuner, "note", None)

    def ask(self, n: int) -> np.ndarray:
        return self._tuner.ask(n)

    def tell(self, trials: Trials) -> None:
        most = {one.name: one.quantity.most for one in LIMITS.requirements}
        nearer = {
            name: factors.max(axis=0) if most[name] else factors.min(axis=0)
            for name, factors in self._tolerated.factors(trials.points).items()
        }
        self._tuner.tell(heeding(trials, self._clearance, nearer))

    def close(self) -> None:
        """End the search."""
        close(self._tuner)
