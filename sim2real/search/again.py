"""The candidates of an earlier attribution under another noise or other nuisances, fitted from where they ended."""

from collections.abc import Sequence

import numpy as np

from sim2real.compared.problem import Problem
from sim2real.search.candidates import Attribution
from sim2real.search.fit import Fit
from sim2real.search.fitting import begin, iterate
from sim2real.search.singles import ITERATIONS

ADDS = 4.0  # cost that a pair must save beside one of its effects to be fitted again


def again(problem: Problem, earlier: Attribution, reach: np.ndarray | None = None) -> tuple[list[Fit], list[Fit]]:
    """The single effects and the pairs of an earlier attribution.

    Those that are farther behind the best than they reach, there and here, are only simulated: they keep their
    coordinates and have no Jacobian, and so no standard errors. What was near there is fitted in any case: the problem
    is opened at the parameters of the best, which another one has not followed yet. Pairs that save next to nothing
    beside one of their effects are only simulated, too: with an effect that explains the gap any other one makes such a
    pair, and to fit them all would take most of the time.

    Args:
        problem: The same recordings as those of the earlier attribution.
        earlier: That attribution.
        reach: Cost above the best of its candidates within which each is near (candidates,). None: all are.
    """
    known = [c.fit for c in earlier.candidates if c.effects]
    fits = begin([f.hypothesis for f in known], [f.u for f in known], problem.data, problem.simulate)
    far = np.full(len(fits), np.inf) if reach is None else reach[[bool(c.effects) for c in earlier.candidates]]
    there, here = (np.array([f.cost for f in own]) for own in (known, fits))
    near = (there <= min(there, default=np.inf) + far) | (here <= min(here, default=np.inf) + far)
    single = np.array([len(f.hypothesis.effects) == 1 for f in fits], bool)
    iterate([fits[i] for i in np.flatnonzero(near & single)], problem.data, problem.simulate, ITERATIONS)
    adding = (i for i in np.flatnonzero(near & ~single) if _adds(known[i], known) or _adds(fits[i], fits))
    iterate([fits[i] for i in adding], problem.data, problem.simulate, ITERATIONS)
    return [fits[i] for i in np.flatnonzero(single)], [fits[i] for i in np.flatnonzero(~single)]


def _adds(pair: Fit, fits: Sequence[Fit]) -> bool:
    """Whether a pair saves anything beside either of its effects alone, of which there are fits."""
    own = {(name,) for name in pair.hypothesis.effects}
    return pair.cost < min((f.cost for f in fits if f.hypothesis.effects in own), default=np.inf) - ADDS
