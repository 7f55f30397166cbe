"""Rigs for training: drawn over a wide range, with targets, and with effects that a real rig may have."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from maglev_env.loop.effect import Effects, effect, meaningful
from maglev_env.rig.rig import Rig
from maglev_env.task.task import Task, make_task

# Range of the first parameter of each effect, from hardly visible to a clear change of the best gains; log-uniform.
SIZES: Mapping[str, tuple[float, float]] = {
    "delay": (10e-6, 150e-6),
    "amplifier_lag": (10e-6, 150e-6),
    "sensor_lag": (10e-6, 150e-6),
    "eddy_current": (500.0, 10_000.0),
    "hysteresis": (0.02, 0.2),
    "friction": (0.005, 0.05),
}
PLAIN = 0.5  # share of the groups of rigs without an effect


@dataclass(frozen=True)
class World:
    """Rigs drawn over a wide range around `rig`, each with its own target.

    Attributes:
        rig: The centre.
        protocol: "full" or "quick" protocol of the rig.
        tuned: Names of the tuned gains; None: those that `gain_box` tunes by default.
        sensor: What reads the displacement.
        effects: Whether groups of rigs may have one of SIZES.
        budget: Number of experiments in an episode.
    """

    rig: Rig
    protocol: str = "quick"
    tuned: Sequence[str] | None = None
    sensor: str = "probe"
    effects: bool = True
    budget: int = 10

    def task(self, effects: Effects | None = None, protocol: str | None = None) -> Task:
        """The tuning task of one group."""
        return make_task(
            self.rig, self.tuned, randomization="wide", draw_target=True, effects=effects,
            protocol=protocol or self.protocol, sensor=self.sensor, budget=self.budget,
        )  # fmt: skip

    def draw(self, rng: np.random.Generator) -> tuple[Task, Task]:
        """The task of a group, and the task on which the best gains of its rigs are searched.

        The second always has the quick protocol; the effect is drawn from rng.
        """
        plain = not self.effects or rng.random() < PLAIN
        chosen = {} if plain else drawn_effect(self.rig, rng)
        return self.task(chosen), self.task(chosen, "quick")


def drawn_effect(rig: Rig, rng: np.random.Generator) -> Effects:
    """One of SIZES that the rig may have, of a random size; none if it may have none."""
    names = [name for name in SIZES if meaningful(name, rig.capabilities)]
    if not names:
        return {}
    name = names[rng.integers(len(names))]
    return effect(name, float(np.exp(rng.uniform(*np.log(SIZES[name])))))
