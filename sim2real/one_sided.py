"""How far a time may lie from where a fit found it, where it and the times beside it are not negative.

The curvature at a fit says nothing of bounds. A delay and a lag of the sensor change a slow record in the same way, so
that one may grow by anything as the other falls: but no lag falls below zero. Where the fit ends with both at zero, the
curvature leaves a delay of any size, and the bounds leave what both together may have.
"""

from itertools import chain, combinations

import numpy as np
from scipy import optimize, stats

from sim2real.search.fit import Fit, inverse

REACH = float(stats.norm.isf(0.025))  # standard errors to the end of a 95 % interval
FARTHEST = 1e6  # coordinates: what lies beyond is not bounded


def bounded_spread(fit: Fit, spread: np.ndarray) -> np.ndarray:
    """Standard errors (size,) of a fit, of coordinates that are not negative by how far their bounds let them go.

    Args:
        fit: with its Jacobian.
        spread: by the curvature alone (size,).
    """
    one_sided = [i for i, c in enumerate(fit.hypothesis.coordinates) if c.scale is not None and c.low == 0 < c.high]
    found, normal = np.array(spread), fit.normal
    lowest = {i: -float(fit.u[i]) for i in one_sided}
    for i in one_sided:
        others = {j: low for j, low in lowest.items() if j != i}

        def beyond(moved: float, i: int = i, others: dict[int, float] = others) -> float:
            return _least(normal, {i: moved}, others) - REACH**2

        up = FARTHEST if beyond(FARTHEST) < 0 else float(optimize.brentq(beyond, 0.0, FARTHEST))
        down = -lowest[i]  # a lower end at zero needs no more than to reach it
        if beyond(-down) > 0 and down:
            down = float(optimize.brentq(lambda moved, beyond=beyond: beyond(-moved), 0.0, down))
        found[i] = max(up, down) / REACH
    return found


def _least(normal: np.ndarray, held: dict[int, float], lowest: dict[int, float]) -> float:
    """Least rise of the cost over all coordinates, with some held and some no lower than a bound.

    What pulls a time below zero is a contradiction and no knowledge, so the slope of the cost at a bound is left out.
    """
    least = np.inf
    for at_bound in chain.from_iterable(combinations(lowest, n) for n in range(len(lowest) + 1)):
        fixed = held | {j: lowest[j] for j in at_bound}
        x = np.zeros(len(normal))
        x[list(fixed)] = list(fixed.values())
        free = [j for j in range(len(normal)) if j not in fixed]
        x[free] = -inverse(normal[np.ix_(free, free)]) @ (normal @ x)[free]
        if all(x[j] >= low for j, low in lowest.items() if j not in at_bound):
            least = min(least, float(x @ normal @ x))
    return least
