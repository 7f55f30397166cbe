"""Where a fit begins if the rotor falls in the simulation by the nominal rig."""

from itertools import product

import numpy as np

from sim2real.compared.problem import Problem
from sim2real.search.fit import Fit
from sim2real.search.fitting import begin
from sim2real.search.hypotheses import Hypothesis

LAW = "actuator_gain", "negative_stiffness"
# Relative changes of gain and stiffness that are tried: first those of a large motion, which a few percent of the pull
# hold, then those of a law that is stated wrong.
BESIDE = (-0.3, -0.2, -0.1, 0.0, 0.1, 0.2, 0.3), (-0.65, -0.5, -0.35, -0.15, 0.0, 0.3, 0.6, 1.0)


def where_it_stands(problem: Problem, h: Hypothesis) -> Fit | None:
    """The best start of a hypothesis whose gain or stiffness is free; None: the rotor falls at all of them."""
    changed = [(i, c) for i, c in enumerate(h.coordinates) if c.effect in LAW]
    for sizes in BESIDE:
        starts = []
        for changes in product(sizes, repeat=len(changed)):
            u = np.zeros(h.size)
            for (i, c), change in zip(changed, changes, strict=True):
                u[i] = c.to_bounds(c.at(change))
            starts.append(u)
        best = min(begin([h] * len(starts), starts, problem.data, problem.simulate), key=lambda fit: fit.cost)
        if np.isfinite(best.cost):
            return best
    return None
