"""Gymnasium environments: experiments per second of batches, and the overhead over the bare evaluation."""

import contextlib
from functools import partial
from time import perf_counter

import gymnasium as gym
import numpy as np

import maglev_env  # noqa: F401  registers the environments
from maglev_env.evaluation.evaluate import evaluate
from maglev_workbench.commands.bench.figures import Figure
from maglev_workbench.commands.bench.timing import Size, alternately

ID = "maglev/HMBFree-v0"
PEER = "Cont-SC-PermExDc-v0"  # of gym-electric-motor: speed control of a d.c. motor, one step per control sample
_PEER_STEPS = 2000


def environment_figures(size: Size) -> dict[str, Figure]:
    """Experiments per second of 1, 8, 64 and 512 environments, and ratios.

    The batch of 64 is compared with the evaluation of the same experiments without environments, and control samples
    per second with those of gym-electric-motor, if it is installed.
    """
    found = {}
    for n in (1, 8, 64, size.memory_sets[1]):
        env = gym.make_vec(ID, num_envs=n)
        env.reset(seed=0)
        actions = np.zeros(env.action_space.shape)
        works = {"env": partial(env.step, actions)}
        if n == 64:
            works["bare"] = _bare(env, actions)
        best = alternately(works, min(size.repeats, 3))
        found[f"env_experiments_per_second_{n}"] = Figure(n / best["env"], "1/s", "higher")
        if n == 64:
            found["env_over_bare_evaluation"] = Figure(best["env"] / best["bare"], "ratio", "lower")
            protocol, rate = env.task.rig.protocol, env.task.rig.control_rate
            samples = (protocol.periods + protocol.transient_periods) * rate / protocol.excitations[0].fundamental
            steps = n * samples / best["env"]
            found["env_control_samples_per_second"] = Figure(steps, "1/s", "higher")
    peer = _peer_rate()
    if peer is not None:
        found["gym_electric_motor_control_samples_per_second"] = Figure(peer, "1/s", "higher")
        found["env_times_gym_electric_motor"] = Figure(steps / peer, "ratio", "higher")
    return found


def _bare(env: gym.vector.VectorEnv, actions: np.ndarray) -> partial:
    """The batch's experiments at the same gains, simulated, estimated and scored without environments."""
    task, rng = env.task, np.random.default_rng(0)
    episodes = [task.draw(rng) for _ in range(len(actions))]
    gains = task.box.gains(actions)
    experiments = [task.experiment(e, g, 1) for e, g in zip(episodes, gains, strict=True)]
    return partial(evaluate, experiments, targets=[e.target for e in episodes], bands=task.layout.bands)


def _peer_rate() -> float | None:
    """Control samples per second of gym-electric-motor; None if it is not installed or does not run here."""
    with contextlib.suppress(Exception):  # the benchmark must not fail because another package does
        import gym_electric_motor

        env = gym_electric_motor.make(PEER)
        env.reset()
        start = perf_counter()
        for _ in range(_PEER_STEPS):
            *_, terminated, truncated, _ = env.step(env.action_space.sample())
            if terminated or truncated:
                env.reset()
        return _PEER_STEPS / (perf_counter() - start)
    return None
