"""The fit of free corrections: a linear look at all kinds, then the best ones in closed loop."""

from collections.abc import Sequence

import numpy as np

from sim2real.compared.problem import Problem
from sim2real.free.kinds import Freed, Kind, Sizes, freed, kinds, sizes_of
from sim2real.search.fit import Fit
from sim2real.search.fitting import begin, differentiate, iterate

TRIED, FIRST, STEPS = 5, 3, 12  # kinds that are fitted, steps of all of them, and steps of the two best
FOLLOWED = 2
SIGNIFICANT = 8.0  # standard deviations of the noise's cost that a gap must exceed
SIMPLER = 0.03  # share of what the best kind saves that a kind with fewer coefficients may save less
AGAIN, NOTABLE = 0.3, 0.1  # shares of what is left, and of the whole gap, that a second correction must save
MOST = 2  # corrections together


def lacks(fit: Fit) -> bool:
    """Whether a fit leaves clearly more than noise."""
    return bool(np.isfinite(fit.cost)) and fit.excess > SIGNIFICANT * np.sqrt(4.0 * fit.residual.size)


def corrected(problem: Problem, base: Fit) -> Fit | None:
    """The best free corrections beside a fit; None where it leaves no more than noise, or nothing helps.

    Args:
        problem: The problem that was fitted.
        base: A fit with its Jacobian.
    """
    if not lacks(base):
        return None
    sizes = sizes_of(problem, base.hypothesis.point(base.u))
    if sizes is None:
        return None
    able, best = kinds(problem, sizes), base
    for _ in range(MOST):
        added = best.hypothesis.added if isinstance(best.hypothesis, Freed) else ()
        found = _next(problem, best, [k for k in able if k not in added], added, sizes)
        least = max(AGAIN * best.excess, NOTABLE * base.excess)
        if found is None or best.cost - found.cost < least:
            break
        best = found
        if not lacks(best):
            break
    if best is base:
        return None
    differentiate([best], problem.data, problem.simulate, True)
    return best


def refined(problem: Problem, fit: Fit) -> Fit:
    """The fit, continued on the same recordings with another noise."""
    again = begin([fit.hypothesis], [fit.u], problem.data, problem.simulate)
    iterate(again, problem.data, problem.simulate, STEPS)
    differentiate(again, problem.data, problem.simulate, True)
    return again[0]


def _next(problem: Problem, base: Fit, able: Sequence[Kind], added: tuple[Kind, ...], sizes: Sizes) -> Fit | None:
    """The best fit with one more correction."""
    looks = looked_at(problem, base, able, added, sizes)
    if not looks:
        return None
    tried = [fit for _, fit in looks[:TRIED]]
    iterate(tried, problem.data, problem.simulate, FIRST)
    tried = sorted(tried, key=lambda f: f.cost)[:FOLLOWED]
    for fit in tried:
        fit.done = False
    iterate(tried, problem.data, problem.simulate, STEPS)
    return simplest(tried, base.cost)


def simplest(fits: Sequence[Fit], before: float) -> Fit:
    """The fit with the fewest coefficients among those that save about as much as the best."""
    least = min(f.cost for f in fits)
    near = [f for f in fits if f.cost - least <= SIMPLER * max(before - least, 0.0)]
    return min(near, key=lambda f: (f.hypothesis.size, f.cost))


def looked_at(
    problem: Problem, base: Fit, able: Sequence[Kind], added: tuple[Kind, ...], sizes: Sizes
) -> list[tuple[float, Fit]]:
    """Fits that begin at the base, with their Jacobians, and the cost that a linear prediction promises; best first."""
    known = len(base.hypothesis.coordinates)
    whole = freed(base.hypothesis, (*added, *able), sizes)
    u = np.concatenate([base.u[:known], np.zeros(len(whole.coordinates) - known), base.u[known:]])
    (start,) = begin([whole], [u], problem.data, problem.simulate)
    if not np.isfinite(start.cost):
        return []
    differentiate([start], problem.data, problem.simulate, True)
    found = []
    for kind in able:
        h = freed(base.hypothesis, (*added, kind), sizes)
        own = whole.place_of(kind)
        rows = [*range(known), *range(own.start, own.stop), *range(len(whole.coordinates), whole.size)]
        fit = Fit(h, u[rows], start.residual, start.cost, start.jacobian[rows], fresh=True)
        gradient = fit.gradient
        promised = float(gradient @ np.linalg.lstsq(fit.normal, gradient, rcond=None)[0])
        found.append((start.cost - promised + 2.0 * (own.stop - own.start), fit))
    return sorted(found, key=lambda item: item[0])
