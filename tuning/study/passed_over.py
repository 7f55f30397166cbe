"""Why gains that scored higher in their experiment than the recommended ones were not taken."""

from collections.abc import Collection, Mapping
from dataclasses import dataclass

import numpy as np

from tuning.tuner import Trials


@dataclass(frozen=True)
class PassedOver:
    """Experiments that scored higher than that of the recommended gains, besides those of refused gains.

    Attributes:
        lower: Mean scores under fresh noise of those that were measured again, which are lower than that of the chosen.
        beside: Number of those that lie beside gains that were measured again, and were not themselves.
        beside_refused: Number of those that lie beside refused gains, or would be refused for the same reason.
    """

    lower: tuple[float, ...] = ()
    beside: int = 0
    beside_refused: int = 0


def passed_over(
    trials: Trials, chosen: int, means: Mapping[int, float], refused: Collection[int], skipped: Collection[int]
) -> PassedOver:
    """Sort the experiments that scored higher by why they were not taken.

    Args:
        trials: All experiments.
        chosen: Index of the recommended one.
        means: Mean scores under fresh noise by index, of those that were measured again.
        refused: Indices of refused ones.
        skipped: Indices of those that were left out because of refused ones.
    """
    higher = {int(i) for i in np.flatnonzero(trials.score > trials.score[chosen])} - {*refused}
    left_out = higher & {*skipped}
    lower = tuple(sorted(means[i] for i in higher - left_out if i in means))
    return PassedOver(lower, len(higher) - len(left_out) - len(lower), len(left_out))
