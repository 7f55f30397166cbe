"""Stable-Baselines3 on the batched environment: PPO learns to tune rigs it has not seen."""

import gymnasium as gym
from gymnasium.vector import AutoresetMode
from stable_baselines3 import PPO
from stable_baselines3.common.vec_env import VecMonitor

import maglev_env  # noqa: F401  registers the environments
from maglev_env.envs.sb3 import SB3VecEnv

TASK = {"randomization": "wide", "protocol": "quick", "move": 0.3}


def train(
    experiments: int = 20_000, num_envs: int = 64, rollout: int = 2048, seed: int = 0, log: str | None = None
) -> PPO:
    """A policy trained on so many experiments of rigs drawn wide; SB3's defaults but for the rollout's length.

    log: CSV file for the return of every episode, in SB3's monitor format.
    """
    env = gym.make_vec("maglev/HMBFree-v0", num_envs=num_envs, autoreset_mode=AutoresetMode.SAME_STEP, **TASK)
    model = PPO("MlpPolicy", VecMonitor(SB3VecEnv(env), log), n_steps=rollout // num_envs, seed=seed, device="cpu")
    return model.learn(experiments)


if __name__ == "__main__":
    model = train()
    print("mean return of the last episodes:", sum(e["r"] for e in model.ep_info_buffer) / len(model.ep_info_buffer))
