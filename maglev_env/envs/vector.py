"""Many environments at a time: every step is one batch of the lane simulator."""

from collections.abc import Callable, Sequence
from operator import index
from typing import Any

import gymnasium as gym
import numpy as np
from gymnasium import logger
from gymnasium.utils import seeding
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space

from maglev_env.envs.single import RigEnv, all_or_nothing, check_arguments, checked_actions, spaces_of
from maglev_env.task.task import Tuning, infos, make_task, rewards

_STATE = ("_episodes", "_counts", "_done", "_histories", "_observations")  # what a step changes
_Outcome = tuple[np.ndarray, list[dict[str, Any]], np.ndarray]


class RigVectorEnv(VectorEnv[np.ndarray, np.ndarray, np.ndarray]):
    """`num_envs` environments in one batch, with the results of `RigEnv` bit for bit.

    Args:
        num_envs: number of environments.
        render_mode: None or "rgb_array".
        autoreset_mode: NEXT_STEP (Gymnasium's default), SAME_STEP (`final_obs` and `final_info` in the infos) or
            DISABLED (reset with `options={"reset_mask": ...}`).
        threads: default: all cores; results do not depend on it.
        arguments: as `RigEnv`.

    Raises:
        ValueError: An argument is not valid; the message names it.
    """

    make_task: Callable[..., Tuning] = staticmethod(make_task)
    picture = staticmethod(RigEnv.picture)
    metadata = RigEnv.metadata | {"autoreset_mode": AutoresetMode.NEXT_STEP}

    def __init__(
        self,
        num_envs: int = 1,
        render_mode: str | None = None,
        autoreset_mode: AutoresetMode | str = AutoresetMode.NEXT_STEP,
        threads: int | None = None,
        **arguments: Any,
    ) -> None:
        if isinstance(num_envs, bool) or not isinstance(num_envs, int) or num_envs < 1:
            raise ValueError(f"num_envs = {num_envs!r}; give a whole number, at least 1")
        if render_mode not in (None, "rgb_array"):
            raise ValueError(f"render_mode = {render_mode!r}; many environments render as 'rgb_array' only")
        if threads is not None and (isinstance(threads, bool) or not isinstance(threads, int) or threads < 1):
            raise ValueError(f"threads = {threads!r}; give a whole number, at least 1, or None for all cores")
        check_arguments(arguments, self.make_task)
        self.task: Tuning = self.make_task(**arguments)
        self.num_envs, self.render_mode, self.threads = num_envs, render_mode, threads
        self.metadata = RigEnv.metadata | {"autoreset_mode": AutoresetMode(autoreset_mode)}
        self.single_action_space, self.single_observation_space = spaces_of(self.task)
        self.action_space = batch_space(self.single_action_space, num_envs)
        self.observation_space = batch_space(self.single_observation_space, num_envs)
        self._rngs: list[np.random.Generator] = []
        self._episodes: list[Any] = [None] * num_envs
        self._counts = np.zeros(num_envs, int)
        self._done = np.zeros(num_envs, bool)
        self._histories: list[list] = [[] for _ in range(num_envs)]
        self._size = len(self.task.box.names)
        self._observations = np.zeros((num_envs, len(self.task.layout.names)), np.float32)

    @property
    def observation_names(self) -> tuple[str, ...]:
        """Name of each element of one environment's observation."""
        return self.task.layout.names

    @property
    def mode(self) -> AutoresetMode:
        """When an environment that has ended starts again."""
        return self.metadata["autoreset_mode"]

    def reset(
        self, *, seed: int | Sequence[int | None] | None = None, options: dict[str, Any] | None = None
    ) -> tuple[np.ndarray, dict[str, Any]]:
        """Start new episodes.

        Args:
            seed: environment i has the seed seed + i, or seed[i] of a sequence.
            options: "reset_mask" (num_envs,) bool selects the environments; default: all.
        """
        mask = np.ones(self.num_envs, bool)
        if options and "reset_mask" in options:
            mask = np.asarray(options["reset_mask"])
            if mask.shape != (self.num_envs,) or mask.dtype != np.bool_ or not mask.any():
                raise ValueError(f"reset_mask: give {self.num_envs} booleans, at least one of them true")
        self._seed(seed, mask)
        with all_or_nothing(self, _STATE, self._rngs):
            _, told, _ = self._measure(np.flatnonzero(mask), fresh=mask, actions=np.zeros((self.num_envs, self._size)))
        return self._observations.copy(), self._gathered(np.flatnonzero(mask), told)

    def step(self, actions: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, dict[str, Any]]:
        """One experiment in every environment; with NEXT_STEP those that had ended restart, whatever their action."""
        if any(e is None for e in self._episodes):
            raise gym.error.ResetNeeded("call reset before the first step")
        everyone = np.arange(self.num_envs)
        fresh = self._done & (self.mode is AutoresetMode.NEXT_STEP)
        checked = checked_actions(actions, self.single_action_space, self.num_envs, fresh)
        if self._done.any() and self.mode is AutoresetMode.DISABLED:
            raise gym.error.ResetNeeded("an environment has ended: reset it with options={'reset_mask': ...}")
        with all_or_nothing(self, _STATE, self._rngs):
            reward, told, down = self._measure(everyone, fresh, checked)
            reward = np.where(fresh, 0.0, reward)
            terminated = down & ~fresh & self.task.terminate_on_touchdown
            truncated = (self._counts >= self.task.budget) & ~fresh
            self._done = terminated | truncated
            restart = self.mode is AutoresetMode.SAME_STEP and self._done.any()
            info = self._restarted(told) if restart else self._gathered(everyone, told)
        return self._observations.copy(), reward, terminated, truncated, info

    def render(self) -> tuple[np.ndarray, ...] | None:
        """One frame per environment, as `RigEnv.render`."""
        if self.render_mode is None:
            logger.warn("render needs render_mode='rgb_array' when the environment is made")
            return None
        if any(e is None for e in self._episodes):
            raise gym.error.ResetNeeded("call reset before render")
        from maglev_env.envs.pictures.window import draw_frame

        pairs = zip(self._episodes, self._histories, strict=True)
        return tuple(draw_frame(self.picture(self.task, episode, history)) for episode, history in pairs)

    def _seed(self, seed: int | Sequence[int | None] | None, mask: np.ndarray) -> None:
        if seed is None or isinstance(seed, int | np.integer):
            seeds = [None if seed is None else int(seed) + i for i in range(self.num_envs)]
        else:
            seeds = [None if one is None else index(one) for one in seed]
        if len(seeds) != self.num_envs:
            raise ValueError(f"seed: {len(seeds)} seeds for {self.num_envs} environments; give one for each, or one")
        if not self._rngs:
            self._rngs = [seeding.np_random(s)[0] for s in seeds]
            return
        for i in np.flatnonzero(mask):
            if seeds[i] is not None:
                self._rngs[i] = seeding.np_random(seeds[i])[0]

    def _measure(self, members: np.ndarray, fresh: np.ndarray, actions: np.ndarray) -> _Outcome:
        """One experiment of each member.

        Args:
            members: indices of environments.
            fresh: (num_envs,), which of them start a new episode.
            actions: (num_envs, k).

        Returns:
            Rewards, infos and whether the rotor touched down, for each member.
        """
        tried = np.array(actions, dtype=np.float64)
        for i in members:
            if fresh[i]:
                self._episodes[i] = self.task.draw(self._rngs[i])
                self._counts[i], self._histories[i], tried[i] = 0, [], self._episodes[i].start
            else:
                self._counts[i] += 1
                tried[i] = self.task.tried(self._histories[i][-1][0], tried[i])
        episodes = [self._episodes[i] for i in members]
        found, observations = self.task.measure(episodes, tried[members], self._counts[members].tolist(), self.threads)
        told = infos(self.task, found, tried[members])
        for i, one in zip(members, told, strict=True):
            self._histories[i] = [*self._histories[i], (tried[i].copy(), dict(one))]
        self._observations[members] = observations
        self._done[members] = False
        return rewards(found), told, np.isfinite(found.touchdown_time)

    def _restarted(self, told: list[dict[str, Any]]) -> dict[str, Any]:
        """Restart ended episodes; their last observations and infos go to final_obs and final_info."""
        ended = np.flatnonzero(self._done)
        final_info: dict[str, Any] = {}
        final_obs = np.full(self.num_envs, None, dtype=object)
        for i in ended:
            final_obs[i] = self._observations[i].copy()
            final_info = self._add_info(final_info, told[i], int(i))
        done = self._done.copy()
        _, again, _ = self._measure(ended, done, np.zeros((self.num_envs, self._size)))
        latest = list(told)
        for i, one in zip(ended, again, strict=True):
            latest[i] = one
        info = self._gathered(np.arange(self.num_envs), latest)
        return info | {"final_obs": final_obs, "_final_obs": done, "final_info": final_info, "_final_info": done.copy()}

    def _gathered(self, members: np.ndarray, told: list[dict[str, Any]]) -> dict[str, Any]:
        info: dict[str, Any] = {}
        for i, one in zip(members, told, strict=True):
            info = self._add_info(info, one, i)  # copies the values
        return info
