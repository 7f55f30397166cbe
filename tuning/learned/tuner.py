"""A trained policy behind the tuners' contract."""

import numpy as np

from maglev_env.envs.task import Tuning
from tuning.learned.policy import HistoryPolicy
from tuning.search.tuner import Trials

JITTER = 0.03  # tells points apart that are asked for together, and repeats


class LearnedTuner:
    """Tries the episode's safe start, then what the policy makes of everything observed so far."""

    def __init__(self, task: Tuning, start: np.ndarray, policy: HistoryPolicy, seed: int) -> None:
        """ValueError when the policy was trained for other observations or gains than the task's."""
        shape = policy.shape
        for what, own, asked in (
            ("gains", shape.gains, task.box.names),
            ("observations", shape.names, task.layout.names),
        ):
            if tuple(own) != tuple(asked):
                raise ValueError(
                    f"the policy was trained for other {what}: {', '.join(own[:4])} ..., not {', '.join(asked[:4])} ..."
                )
        self._policy, self._start, self._seen = policy, np.asarray(start, float), np.empty((0, len(shape.names)))
        self._rng = np.random.default_rng(seed)

    def ask(self, n: int) -> np.ndarray:
        first = self._policy.act(self._seen[None])[0] if len(self._seen) else self._start
        points = first + JITTER * self._rng.standard_normal((n, first.size))
        if len(self._seen) < self._policy.shape.history:
            points[0] = first
        return np.clip(points, -1.0, 1.0)

    def tell(self, trials: Trials) -> None:
        self._seen = np.concatenate([self._seen, trials.observation])
