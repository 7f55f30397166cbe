"""How much nearer to the limits of a recommendation rigs within tolerance are, by a linear model."""

from collections.abc import Sequence

import numpy as np

from maglev_env.rig.drawn import scaled_rig
from maglev_env.rig.rig import Rig
from tuning.search.corrected.loops import LineModel, OpenLoop
from tuning.study.limits import LIMITS, READ

# Standard deviations of the tolerances that a recommendation allows for: one of forty readings lies beyond at either
# end, and a quarter of these are made on the rig itself.
ALLOWED = 1.8


class Tolerated:
    """How much nearer to each of LIMITS rigs within tolerance are than a rig itself, to first order."""

    def __init__(self, models: Sequence[LineModel]) -> None:
        self._models = models
        self._loops: list[list[OpenLoop]] = []

    def open(self, rig: Rig) -> None:
        """Open the loops of the rig, and of those that differ from it by one tolerance (1 sigma) each."""
        around = [rig, *(scaled_rig(rig, {name: float(np.exp(s))}) for name, s in rig.tolerance.items() if s > 0)]
        self._loops = [[model.open(one) for model in self._models] for one in around]

    def factors(self, points: np.ndarray) -> dict[str, np.ndarray]:
        """Factors (axes, m) at points (m, k) by quantity, above 1 of what has an upper limit and below 1 of others.

        What has no value on the rig or on one beside it, such as a margin beyond the lines, has no part in it.
        """
        every = [[m.values(o, points) for m, o in zip(self._models, loops, strict=True)] for loops in self._loops]
        found = {}
        for one in LIMITS.requirements:
            with np.errstate(divide="ignore", invalid="ignore"):
                logs = np.log([[values[READ[one.name]] for values in axes] for axes in every])
            apart = np.nan_to_num(logs[1:] - logs[0], nan=0.0, posinf=0.0, neginf=0.0)
            worse = ALLOWED * np.sqrt((apart**2).sum(axis=0))
            found[one.name] = np.exp(worse if one.quantity.most else -worse)
        return found
