"""The rigs of a comparison, which no tuner has seen."""

from dataclasses import replace

import numpy as np

from maglev_env.task.episodes import Episode
from maglev_env.task.task import Task
from tuning.learned.worlds import drawn_effect

HELD_OUT = 271828  # mixed into the seed so that comparison rigs never coincide with rigs drawn elsewhere
EFFECT = 161803  # the same, of their effects


def held_out(
    task: Task, n_rigs: int, repeats: int, seed: int, affected: bool = False
) -> tuple[list[Episode], list[Episode], list[int]]:
    """Unseen rigs with their noise.

    Each rig depends on the seed and its number, so fewer rigs are the first of more.

    Args:
        task: The task that draws the rigs.
        n_rigs: Number of rigs.
        repeats: Repetitions of each with other noise.
        seed: Seed of all.
        affected: Whether every other rig has an effect, drawn as for training (`learned.worlds.drawn_effect`).

    Returns:
        rigs: Episodes of n_rigs rigs.
        lanes: n_rigs * repeats episodes, rig by rig, that differ in their noise.
        seeds: Seeds of the tuners.
    """
    rigs, lanes, seeds = [], [], []
    for i in range(n_rigs):
        rng = np.random.default_rng((HELD_OUT, seed, i))
        drawn = task.draw(rng)
        if affected and i % 2:
            effects = drawn_effect(drawn.rig, np.random.default_rng((EFFECT, seed, i)))
            drawn = replace(drawn, rig=replace(drawn.rig, effects={**drawn.rig.effects, **effects}))
        rigs.append(drawn)
        lanes += [replace(rigs[-1], seed=int(s)) for s in rng.integers(2**63, size=repeats)]
        seeds += rng.integers(2**31, size=repeats).tolist()
    return rigs, lanes, seeds
