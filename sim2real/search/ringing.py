"""Pairs with a resonance that rings.

Alone, a resonance is the best explanation of another effect at values at which nothing rings: so strongly damped it
takes up what changes slowly over frequency, and what rings is left to a further mode of its form. Beside that effect it
begins there, and may stay.
"""

from collections.abc import Sequence

import numpy as np

from sim2real.compared.problem import Problem
from sim2real.search.fit import Fit
from sim2real.search.fitting import begin, differentiate, iterate
from sim2real.search.hypotheses import NO_RESONANCE, RESONANCES
from sim2real.search.screening import extended, kept, screened
from sim2real.search.singles import FIRST, ITERATIONS, begin_at
from sim2real.search.starts import starts

TRIED = 2  # best pairs with a resonance that is none, which is sought again


def ringing(problem: Problem, pairs: Sequence[Fit]) -> list[Fit]:
    """The pairs, the best of those that had ended with a resonance that is none with one that is.

    It is sought at every frequency, beside the other effect as it is in the pair. What does not ring is not named, so
    that any that rings takes its place.
    """
    again: dict[int, Fit] = {}
    dull = [f for f in pairs if np.isfinite(f.cost) and len(f.hypothesis.effects) == 2 and len(_too_damped(f)) == 1]
    for f in sorted(dull, key=lambda f: f.cost)[:TRIED]:
        (resonance,) = _too_damped(f)
        (other,) = (name for name in f.hypothesis.effects if name != resonance)
        rings = [new for new in _sought(problem, f, other, resonance) if not _too_damped(new)]
        again |= {id(f): min(rings, key=lambda new: new.cost)} if rings else {}
    return [again.get(id(f), f) for f in pairs]


def _sought(problem: Problem, pair: Fit, other: str, resonance: str) -> list[Fit]:
    """Fits of a pair that begin at the most promising frequencies of its resonance."""
    alone = pair.hypothesis.instead(other)
    own = pair.u[[i for i, c in enumerate(pair.hypothesis.coordinates) if c.effect == other]]
    (seed,) = begin([alone], [extended(alone, own, pair)], problem.data, problem.simulate)
    if not np.isfinite(seed.cost):
        return []
    differentiate([seed], problem.data, problem.simulate, True)
    h = alone.instead(other, resonance)
    tried = [extended(h, np.concatenate([own, start]), seed) for start in starts(resonance, h.scales)]
    ranked = screened(problem, [(seed, h, u) for u in tried])
    fits = begin_at(problem, kept(ranked), ranked)
    iterate(fits, problem.data, problem.simulate, FIRST + ITERATIONS)
    return [f for f in fits if np.isfinite(f.cost)]


def _too_damped(f: Fit) -> list[str]:
    """Resonances of a fit that are none."""
    own = zip(f.hypothesis.coordinates, f.u, strict=False)
    ratios = [(c, float(u)) for c, u in own if c.effect in RESONANCES and c.parameter == "damping_ratio"]
    return [c.effect for c, u in ratios if c.value(u) >= NO_RESONANCE]
