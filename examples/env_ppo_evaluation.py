"""What PPO learned in 20,000 experiments, against random gains and the dissertation's, on 200 rigs it has not seen."""

from collections.abc import Callable
from time import perf_counter

import gymnasium as gym
import numpy as np
from env_sb3_ppo import TASK, train

RIGS, HELD_OUT = 200, 1_000_000


def mean_return(policy: Callable[[np.ndarray], np.ndarray], **task: float | None) -> tuple[float, float]:
    """Mean return over held-out episodes of ten experiments, and the half-width of its 95 % interval."""
    env = gym.make_vec("maglev/HMBFree-v0", num_envs=RIGS, **(TASK | task))
    observation, _ = env.reset(seed=HELD_OUT)
    total = np.zeros(RIGS)
    for _ in range(10):
        observation, reward, *_ = env.step(policy(observation))
        total += reward
    return float(total.mean()), float(1.96 * total.std(ddof=1) / np.sqrt(RIGS))


if __name__ == "__main__":
    started = perf_counter()
    model = train(log="ppo.monitor.csv")
    print(f"trained in {perf_counter() - started:.0f} s; mean return along the way:")
    returns = np.loadtxt("ppo.monitor.csv", delimiter=",", skiprows=2)[:, 0]
    print(*(f"{part.mean():.2f}" for part in np.array_split(returns, 10)))
    task, rng = gym.make("maglev/HMBFree-v0").unwrapped.task, np.random.default_rng(0)
    preset = task.box.point(task.rig.gains)
    print(
        "PPO           {:.2f} +- {:.2f}".format(*mean_return(lambda seen: model.predict(seen, deterministic=True)[0]))
    )
    print("random gains  {:.2f} +- {:.2f}".format(*mean_return(lambda _: rng.uniform(-1, 1, (RIGS, 3)), move=None)))
    print("dissertation  {:.2f} +- {:.2f}".format(*mean_return(lambda _: np.tile(preset, (RIGS, 1)), move=None)))
