"""Whether the noise of the recordings makes the ripple under which an effect was fitted.

Under ripple a hysteresis forgets so fast that little but a lag in time is left of it. Nothing of a fit then tells it
from anything else that lags, but for one thing: the noise of these recordings must be that ripple. With the plain
formula in a simulation with this noise, nothing is free that could make any lag of it.
"""

from dataclasses import replace
from itertools import product

import numpy as np

from maglev_env.loop.effect import EFFECTS
from sim2real.compared.problem import Problem
from sim2real.search.fit import Fit
from sim2real.search.fitting import begin, iterate
from sim2real.search.hypotheses import Hypothesis
from sim2real.search.screening import extended
from sim2real.search.starts import DITHERS

STEPS = 15  # of the fit with noise


def ripple_is_noise(problem: Problem, fit: Fit, name: str, most: float) -> bool:
    """Whether the plain formula of an effect explains about as much in a simulation with noise.

    Args:
        problem: The recordings.
        fit: A hypothesis with the effect.
        name: An effect which is another one altogether under ripple (`DITHERS`); False for all others.
        most: Cost that this may leave beyond that of the fit.
    """
    h = fit.hypothesis
    if h.shapes.keys().isdisjoint(DITHERS.get(name, ())):
        return False
    plain = replace(h, dithered=True, shaped=tuple(other for other in h.shaped if other != name))
    starts = _starts(plain, extended(plain, fit.u[: len(h.coordinates)], fit), name)
    best = min(begin([plain] * len(starts), starts, problem.data, problem.simulate), key=lambda f: f.cost)
    iterate([best], problem.data, problem.simulate, STEPS)
    return bool(best.cost <= fit.cost + fit.occam + most)


def _starts(h: Hypothesis, u: np.ndarray, name: str) -> list[np.ndarray]:
    """The coordinates, and with every size of the effect that is no share of it at each of its starts: under a ripple
    of any size, a width of any size had made the same lag."""
    at = [(i, c) for i, c in enumerate(h.coordinates) if c.effect == name and c.scale is None]
    found = [u]
    for values in product(*(EFFECTS[name].parameters[c.parameter].on(h.scales).starts for _, c in at)):
        moved = u.copy()
        moved[[i for i, _ in at]] = [c.at(value) for (_, c), value in zip(at, values, strict=True)]
        found.append(moved)
    return found
