"""The vector environment for Stable-Baselines3, which does not accept Gymnasium's vector environments."""

from collections.abc import Sequence
from typing import Any

import gymnasium as gym
import numpy as np
from gymnasium.vector import AutoresetMode
from stable_baselines3.common.vec_env import VecEnv

from maglev_env.envs.vector import RigVectorEnv


class SB3VecEnv(VecEnv):
    """A `RigVectorEnv` in same-step autoreset as an SB3 `VecEnv`; wrap it in SB3's `VecMonitor` for episode returns.

    The infos are those of `RigEnv`; at the end of an episode they also have `terminal_observation` and
    `TimeLimit.truncated`.

    Raises:
        ValueError: The environment has another autoreset mode.
    """

    def __init__(self, env: RigVectorEnv) -> None:
        if env.metadata["autoreset_mode"] is not AutoresetMode.SAME_STEP:
            raise ValueError("autoreset_mode: SB3 needs AutoresetMode.SAME_STEP")
        self.env, self.render_mode = env, env.render_mode
        self._actions: np.ndarray | None = None
        super().__init__(env.num_envs, env.single_observation_space, env.single_action_space)

    def reset(self) -> np.ndarray:
        """Observations of new episodes, seeded by the last `seed(...)`."""
        seeds = list(self._seeds)
        observation, info = self.env.reset(seed=seeds if any(s is not None for s in seeds) else None)
        self.reset_infos = self._split(info)
        self._reset_seeds()
        self._reset_options()
        return observation

    def step_async(self, actions: np.ndarray) -> None:
        """Keep the actions for `step_wait`."""
        self._actions = actions

    def step_wait(self) -> tuple[np.ndarray, np.ndarray, np.ndarray, list[dict[str, Any]]]:
        """One experiment in every environment."""
        observation, reward, terminated, truncated, info = self.env.step(self._actions)
        done = terminated | truncated
        told = self._split(info)
        if done.any():
            last = self._split(info["final_info"])
            for i in np.flatnonzero(done):
                self.reset_infos[i] = told[i]
                told[i] = last[i] | {
                    "terminal_observation": info["final_obs"][i],
                    "TimeLimit.truncated": bool(truncated[i] and not terminated[i]),
                }
        return observation, reward.astype(np.float32), done, told

    def close(self) -> None:
        """Close the environments."""
        self.env.close()

    def get_images(self) -> Sequence[np.ndarray | None]:
        """A frame of every environment."""
        return self.env.render() or [None] * self.num_envs

    def get_attr(self, attr_name: str, indices: Any = None) -> list[Any]:
        """The attribute of the vector environment, once per environment asked for."""
        return [getattr(self.env, attr_name) for _ in self._get_indices(indices)]

    def set_attr(self, attr_name: str, value: Any, indices: Any = None) -> None:
        """Raises AttributeError: the environments of a batch share their attributes."""
        raise AttributeError(f"{attr_name}: the environments of a batch share their attributes; make another batch")

    def env_method(self, method_name: str, *args: Any, indices: Any = None, **kwargs: Any) -> list[Any]:
        """The result of a method of the vector environment, once per environment asked for."""
        result = getattr(self.env, method_name)(*args, **kwargs)
        return [result for _ in self._get_indices(indices)]

    def env_is_wrapped(self, wrapper_class: type[gym.Wrapper], indices: Any = None) -> list[bool]:
        """False: a batch has no wrappers."""
        return [False for _ in self._get_indices(indices)]

    def _split(self, info: dict[str, Any]) -> list[dict[str, Any]]:
        """The infos of a vector environment as one dictionary per environment."""
        names = [name for name in info if not name.startswith(("_", "final_"))]
        return [{n: info[n][i] for n in names if info[f"_{n}"][i]} for i in range(self.num_envs)]
