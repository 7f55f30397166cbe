"""An RL researcher: 32 rigs in one batch, random gains for an episode, and what the best of each rig reached."""

import numpy as np

from maglev_workbench import RigVectorEnv


def episode(rigs: int = 32, steps: int = 5, seed: int = 0) -> np.ndarray:
    env = RigVectorEnv(rigs, rig="hmb_free", randomization="wide", budget=steps, protocol="quick")
    env.reset(seed=seed)
    env.action_space.seed(seed)
    rewards = [env.step(env.action_space.sample())[1] for _ in range(steps)]
    env.close()
    return np.max(rewards, axis=0)


if __name__ == "__main__":
    best = episode()
    print(f"best score of {best.size} rigs after 5 experiments each: {best.mean():.2f} (worst {best.min():.2f})")
