"""A gain sweep through the environment: 64 gain sets per step, each scored by an identification experiment."""

import gymnasium as gym
import numpy as np

import maglev_env  # noqa: F401  registers the environments

ENVS = 64


def sweep(steps: int = 4, seed: int = 0) -> tuple[float, dict[str, float]]:
    """The best score over steps x 64 random gain sets, and its gains (A/m, A/m, A s/m)."""
    env = gym.make_vec("maglev/HMBFree-v0", num_envs=ENVS, budget=steps, protocol="quick")
    env.reset(seed=seed)
    env.action_space.seed(seed)
    best, gains = -np.inf, {}
    for _ in range(steps):
        _, reward, _, _, info = env.step(env.action_space.sample())
        i = int(np.argmax(reward))
        if reward[i] > best:
            best, gains = float(reward[i]), {name: float(info[name][i]) for name in ("kp", "ki", "kd")}
    env.close()
    return best, gains


if __name__ == "__main__":
    print(sweep())
