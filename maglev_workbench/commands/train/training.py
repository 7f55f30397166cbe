"""Reinforcement learning for `maglev train`, and the test of a trained policy on held-out rigs."""

from collections.abc import Callable
from typing import Any

import numpy as np

from maglev_env.task.task import make_task
from tuning.comparison.rigs import held_out
from tuning.learned.policy import HistoryPolicy
from tuning.learned.tuner import LearnedTuner
from tuning.learned.worlds import World
from tuning.lockstep import course, judged, side_by_side

TASKS = 16  # groups of rigs that differ in their effect, side by side in ppo and sac
CHECKPOINTS = (1, 2, 3, 5, 10)  # numbers of experiments after which a policy is tested


def reinforced(
    world: World, by: str, experiments: int, seed: int, init: HistoryPolicy | None, advance: Callable[[str, int], None]
) -> tuple[HistoryPolicy, list[dict[str, float]]]:
    """A policy trained by ppo or sac on rigs drawn from the world, and the log of its training.

    Args:
        world: from which rigs are drawn.
        by: "ppo" or "sac".
        experiments: total number.
        seed: of all random choices.
        init: initial policy; None: a random one.
        advance: called with a description and the number of experiments since the last call.
    """
    from tuning.learned.reinforcement import train_by_reinforcement

    rng, done = np.random.default_rng(seed), 0

    def told(made: int) -> None:
        nonlocal done
        advance(by, made - done)
        done = made

    tasks = [world.draw(rng)[0] for _ in range(TASKS)]
    return train_by_reinforcement(tasks, by, experiments, seed, init, progress=told)


def judge(world: World, policy: HistoryPolicy, rigs: int, seed: int) -> dict[str, Any]:
    """Mean score with standard error of the best gains so far after CHECKPOINTS experiments, and touchdowns.

    The rigs are drawn widely with the preset's target and no effect, as by `maglev compare`.
    """
    task = make_task(
        world.rig, world.tuned, randomization="wide", protocol=world.protocol, sensor=world.sensor,
        budget=CHECKPOINTS[-1],
    )  # fmt: skip
    _, lanes, seeds = held_out(task, rigs, 1, seed)
    tuners = [LearnedTuner(task, e, policy, s) for e, s in zip(lanes, seeds, strict=True)]
    found = course(side_by_side(task, lanes, tuners, CHECKPOINTS[-1]))
    score, touchdowns, _ = judged(task, lanes, found, CHECKPOINTS, seed)
    se = score.std(axis=0, ddof=1) / np.sqrt(rigs)
    return {
        "rigs": rigs, "after": list(CHECKPOINTS), "score": score.mean(axis=0).tolist(), "se": se.tolist(),
        "touchdowns": int(touchdowns[:, -1].sum()),
    }  # fmt: skip
