"""A tuner in ten lines: raise kp when too soft, raise kd when too lightly damped or too sensitive."""

import gymnasium as gym
import numpy as np

import maglev_env  # noqa: F401  registers the environments


def tune(seed: int = 0, render_mode: str | None = None) -> list[float]:
    """Scores of one episode on a rig drawn wide around the nominal one, in the order of its experiments."""
    env = gym.make("maglev/HMBFree-v0", randomization="wide", render_mode=render_mode)
    names = env.unwrapped.observation_names
    kp, kd = names.index("kp"), names.index("kd")
    observation, _ = env.reset(seed=seed)
    scores, over = [], False
    while not over:
        see = dict(zip(names, observation, strict=True))
        action = observation[kp : kd + 1].copy()
        action[0] -= 0.5 * see["stiffness_over_target"]
        action[2] -= 0.5 * see["damping_over_target"] + 0.2 * min(0.0, see["peak_sensitivity"] - 0.4)
        observation, reward, terminated, truncated, _ = env.step(np.clip(action, -1, 1))
        scores.append(float(reward))
        over = terminated or truncated
    env.close()
    return scores


if __name__ == "__main__":
    print([f"{score:.3f}" for score in tune()])
