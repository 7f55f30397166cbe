"""What a policy meets in training: rigs drawn wide, targets, and effects that a real rig may have."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from maglev_env.loop.effect import Effects, effect, meaningful
from maglev_env.rig.rig import Rig
from maglev_env.task.gain_box import TUNED
from maglev_env.task.task import Task, make_task

# First parameter of each from hardly seen to what changes the best gains clearly, drawn log-uniformly.
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
    """Rigs drawn wide around `rig`, each with a target of its own, identified by the rig's full or quick protocol; with
    effects, groups of them have one of SIZES. An episode has `budget` experiments."""

    rig: Rig
    protocol: str = "quick"
    tuned: Sequence[str] = TUNED
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
        """The task of a group, and that on which the best gains of its rigs are searched for, which is always the quick
        one; the effect comes from rng."""
        names = [name for name in SIZES if meaningful(name, self.rig.capabilities)]
        chosen: Effects = {}
        if self.effects and names and rng.random() >= PLAIN:
            name = names[rng.integers(len(names))]
            chosen = effect(name, float(np.exp(rng.uniform(*np.log(SIZES[name])))))
        return self.task(chosen), self.task(chosen, "quick")
