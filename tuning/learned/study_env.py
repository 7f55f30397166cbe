"""Studies of rigs as a vectorised environment of Stable-Baselines3, for training a policy by reinforcement."""

from collections.abc import Sequence
from dataclasses import dataclass
from types import SimpleNamespace
from typing import Any

import numpy as np
from gymnasium import spaces
from gymnasium.vector import AutoresetMode
from stable_baselines3.common.vec_env import VecEnv, VecEnvWrapper, VecMonitor

from maglev_env.envs.sb3 import SB3VecEnv
from maglev_env.envs.vector import RigVectorEnv
from maglev_env.task.task import Tuning
from tuning.learned.policy import Shape, stack


def study_env(tasks: Sequence[Tuning], shape: Shape, num_envs: int) -> VecEnv:
    """Studies of rigs of the tasks, side by side; an observation is `policy.stack` of all observations of a study.

    Raises:
        ValueError: The tasks differ in observations, gains or budget, or leave nothing to choose.
    """
    if len({(tuple(t.layout.names), tuple(t.box.names), t.budget) for t in tasks}) > 1:
        raise ValueError("tasks: they must share their observations, gains and budget")
    if tasks[0].budget < 2:
        raise ValueError(f"tasks: budget = {tasks[0].budget}; after the safe start nothing is left to choose")
    env = _StudyEnv(num_envs, autoreset_mode=AutoresetMode.SAME_STEP, tasks=tasks)
    return _Stacked(VecMonitor(SB3VecEnv(env)), shape.history)


@dataclass(frozen=True, eq=False)
class _Drawn:
    task: int
    episode: Any
    start: np.ndarray


class _Studies:
    """Several tasks as one, run like a study.

    The start is experiment 1 of the budget, points are taken as given, and a touchdown does not end a study. The infos
    hold only the gains of the first task.
    """

    terminate_on_touchdown = False

    def __init__(self, tasks: Sequence[Tuning]) -> None:
        first = tasks[0]
        self.name, self.box, self.layout, self.budget = first.name, first.box, first.layout, first.budget - 1
        self._tasks = tasks

    def tried(self, last: np.ndarray, actions: np.ndarray) -> np.ndarray:
        return actions

    def draw(self, rng: np.random.Generator) -> _Drawn:
        task = int(rng.integers(len(self._tasks)))
        episode = self._tasks[task].draw(rng)
        return _Drawn(task, episode, episode.start)

    def measure(self, episodes: Sequence[_Drawn], actions: np.ndarray, counts: Sequence[int], threads: int | None):
        found = SimpleNamespace(touchdown_time=np.zeros(len(episodes)), score=np.zeros(len(episodes)), terms={})
        observations = np.zeros((len(episodes), len(self.layout.names)), np.float32)
        for number, task in enumerate(self._tasks):
            if own := [i for i, e in enumerate(episodes) if e.task == number]:
                told, observations[own] = task.measure(
                    [episodes[i].episode for i in own], actions[own], [counts[i] + 1 for i in own], threads
                )
                found.touchdown_time[own], found.score[own] = told.touchdown_time, told.score
        return found, observations

    def told(self, found: Any) -> dict[str, np.ndarray]:
        return {}


class _StudyEnv(RigVectorEnv):
    make_task = _Studies


class _Stacked(VecEnvWrapper):
    """Stacks the observations of each environment's episode as a HistoryPolicy reads them."""

    def __init__(self, env: VecEnv, history: int) -> None:
        size = history * (env.observation_space.shape[0] + 1)
        super().__init__(env, observation_space=spaces.Box(-1.0, 1.0, (size,), np.float32))
        self._history = history
        self._seen: list[list[np.ndarray]] = []

    def reset(self) -> np.ndarray:
        observations = self.venv.reset()
        self._seen = [[] for _ in observations]
        return np.stack([self._after(i, one) for i, one in enumerate(observations)])

    def step_wait(self) -> tuple[np.ndarray, np.ndarray, np.ndarray, list[dict[str, Any]]]:
        observations, rewards, done, told = self.venv.step_wait()
        for i in np.flatnonzero(done):
            told[i]["terminal_observation"] = self._after(i, told[i]["terminal_observation"])
            told[i]["TimeLimit.truncated"] = False  # the end of the budget is the end of the task
            self._seen[i] = []
        return np.stack([self._after(i, one) for i, one in enumerate(observations)]), rewards, done, told

    def _after(self, i: int, observation: np.ndarray) -> np.ndarray:
        self._seen[i].append(observation.copy())
        return stack(np.stack(self._seen[i][-self._history :])[None], self._history)[0]
