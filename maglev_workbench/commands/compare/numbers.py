"""The numbers of a comparison of tuners: regrets, profiles and probabilities with their intervals."""

from dataclasses import dataclass

import numpy as np

from tuning.comparison.aggregates import improvement, interquartile_mean, median, performance_profile, resamples
from tuning.comparison.compare import Comparison

THRESHOLDS = np.geomspace(1e-3, 1, 61)  # values of regret at which the profiles are computed


@dataclass(frozen=True, eq=False)
class Figures:
    """Figures of one tuner at one budget; arrays (3, ...) are value, lower and upper end of the 95 % interval.

    They are: median and iqm (3,) of the regret; profile (3, THRESHOLDS), the share of rigs below a regret; better (3,)
    by other tuner, the probability of a lower regret on a rig; touchdowns per 100 experiments; met, the share of runs
    whose gains meet every requirement, nan without a goal of requirements; seconds per tuning of one rig; and own, the
    share of that time which the tuner itself takes.
    """

    median: np.ndarray
    iqm: np.ndarray
    profile: np.ndarray
    better: dict[str, np.ndarray]
    touchdowns: float
    met: float
    seconds: float
    own: float


Table = dict[tuple[int, str], Figures]  # by checkpoint and tuner


def figures(found: Comparison) -> Table:
    """All figures of a comparison; the bootstrap resamples the same rigs for every tuner."""
    draws = resamples(len(found.best), found.made_by["seed"])
    of: Table = {}
    for j, n in enumerate(found.checkpoints):
        regret = {m: found.regret(m, n) for m in found.reached(n)}
        for m in regret:
            result, runs = found.results[m], regret[m].size
            of[n, m] = Figures(
                median(regret[m], draws),
                interquartile_mean(regret[m], draws),
                performance_profile(regret[m], THRESHOLDS, draws),
                {o: improvement(regret[m], regret[o], draws) for o in regret if o != m},
                100 * float(result.touchdowns[..., j].sum()) / (runs * n),
                float(result.met[..., j].mean()),
                float(result.seconds[j]) / runs,
                float(result.tuner_seconds[j] / result.seconds[j]),
            )
    return of
