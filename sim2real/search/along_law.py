"""Fits of the law of a pull from other places along its valley.

Exponent and offset of a law change its steepness together; how it curves tells them apart, and hardly. A fit that
begins in one place of that valley, or where another effect was still missing, ends beside it with a stiffness far from
what the rig states, although farther along the valley nothing is strained.
"""

from collections.abc import Sequence

import numpy as np

from maglev_env.loop.effect import effect_value
from maglev_env.loop.magnets.kinds import force_law
from maglev_env.loop.magnets.law import ForceLaw
from maglev_env.rig.rig import axis_rig
from sim2real.compared.problem import Problem
from sim2real.search.fit import Fit
from sim2real.search.fitting import begin, iterate
from sim2real.search.singles import ITERATIONS

EFFECT = "force_law"
OFFSETS = (0.0, 3.0)  # in gaps: a power law, and what is nearly an exponential one
TRIED, NEAR = 2, 100.0  # best fits that are repeated, and cost above the best of all within which they are


def along_law(problem: Problem, fits: Sequence[Fit]) -> list[Fit]:
    """The fits, the best ones of those with this effect at the better end of its valley."""
    least = min((f.cost for f in fits), default=np.inf)
    own = [f for f in fits if EFFECT in f.hypothesis.effects and np.isfinite(f.cost) and f.cost < least + NEAR]
    tried = sorted(own, key=lambda f: f.cost)[:TRIED]
    jobs = [(f, u) for f in tried for u in _elsewhere(problem, f)]
    begun = begin([f.hypothesis for f, _ in jobs], [u for _, u in jobs], problem.data, problem.simulate)
    iterate(begun, problem.data, problem.simulate, ITERATIONS)
    better = {id(f): f for f in tried}
    for (f, _), new in zip(jobs, begun, strict=True):
        if new.cost < better[id(f)].cost:
            better[id(f)] = new
    return [better.get(id(f), f) for f in fits]


def _elsewhere(problem: Problem, fit: Fit) -> list[np.ndarray]:
    """Coordinates at other offsets with the exponent that leaves the law as steep."""
    rig = problem.parts[0].record.nominal
    law = force_law(axis_rig(rig, 0))
    power, distance = law.exponent + (2.0 if isinstance(law, ForceLaw) else 0.0), 1 + law.coil_gap / law.gap
    at = {c.parameter: (i, c) for i, c in enumerate(fit.hypothesis.coordinates) if c.effect == EFFECT}
    here = {EFFECT: {key: c.value(float(fit.u[i])) for key, (i, c) in at.items()}}
    if at.keys() != {"exponent", "offset"}:
        return []
    steep = (power + effect_value(here, EFFECT, "exponent")) / (distance + effect_value(here, EFFECT, "offset"))
    found = []
    for offset in OFFSETS:
        u = fit.u.copy()
        for key, value in (("exponent", steep * (distance + offset) - power), ("offset", offset)):
            i, c = at[key]
            u[i] = c.at(value)
        found.append(u)
    return found
