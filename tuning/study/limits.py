"""The limits of a recommendation as a search sees them: gains that would be refused are worth little to it."""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from maglev_env.evaluation.goal_score import goal_terms
from maglev_env.rig.goal import Goal, Requirement
from tuning.study.recommendation import (
    DISPLACEMENT_SHARE,
    GAIN_MARGIN,
    PEAK_SENSITIVITY,
    PHASE_MARGIN,
    with_hidden,
)
from tuning.tuner import Trials

LIMITS = Goal(
    (
        Requirement("peak_sensitivity", PEAK_SENSITIVITY),
        Requirement("phase_margin", PHASE_MARGIN),
        Requirement("gain_margin", GAIN_MARGIN),
        Requirement("displacement", DISPLACEMENT_SHARE),
    )
)
# By quantity of LIMITS: its name in the info of an experiment and among the values of a line model, by which a
# recommendation judges it.
READ = {
    "peak_sensitivity": "peak_sensitivity",
    "phase_margin": "phase_margin",
    "gain_margin": "gain_margin_high",
    "displacement": "peak_displacement",
}


def allowed(values: Mapping[str, np.ndarray]) -> np.ndarray:
    """The factor in (0, 1) of a score that LIMITS leave, of values (...,) by quantity within tolerance."""
    return np.prod(list(goal_terms(LIMITS, values).values()), axis=0)


def heeding(trials: Trials, clearance: float | np.ndarray, nearer: Mapping[str, np.ndarray]) -> Trials:
    """The trials with scores that are lower where gains would be refused by what was read, or is hidden between lines.

    Args:
        trials: n of them.
        clearance: Of each or all, m.
        nearer: By quantity of LIMITS, factors (n,) of what rigs within tolerance add to a reading.
    """
    values = {}
    for name, key in READ.items():
        read = np.array([row.get(key, np.nan) for row in with_hidden(trials).info], float)
        values[name] = read * nearer[name] / (clearance if name == "displacement" else 1.0)
    return replace(trials, score=trials.score * allowed(values))
