"""Whether a delay lies on the other side of a tick of the controller.

A held command that comes within one period or within the next one is another recursion. The cost may have a minimum on
either side, and a ridge between them that no fit crosses.
"""

from collections.abc import Sequence

import numpy as np

from sim2real.compared.problem import Problem
from sim2real.search.fit import Fit
from sim2real.search.fitting import begin, iterate
from sim2real.search.singles import ITERATIONS

DELAY = "delay"


def across_ticks(problem: Problem, fits: Sequence[Fit]) -> list[Fit]:
    """The fits, a delay alone on that side of the nearest tick where it explains more."""
    rate = problem.parts[0].record.experiment.rig.control_rate
    found = list(fits)
    for i, f in enumerate(fits):
        if f.hypothesis.effects != (DELAY,) or not np.isfinite(f.cost):
            continue
        time = f.hypothesis.coordinates[0]
        ticks = time.value(float(f.u[0])) * rate
        if not (tick := round(ticks)):
            continue
        other = f.u.copy()
        other[0] = time.at((2 * tick - ticks) / rate)
        (new,) = begin([f.hypothesis], [f.hypothesis.bounded(other)], problem.data, problem.simulate)
        if np.isfinite(new.cost):
            iterate([new], problem.data, problem.simulate, ITERATIONS)
            found[i] = min(f, new, key=lambda fit: fit.cost)
    return found
