"""Lost commands beside a lag.

On average, commands that are lost are a lag, and so is each of the blocks: any of them alone explains what two of them
do. Only the scatter that lost commands make tells how much of it they are, so that the pair is fitted wherever either
does alone.
"""

from collections.abc import Sequence

import numpy as np

from sim2real.compared.commands_seen import LOST
from sim2real.compared.problem import Problem
from sim2real.search.candidates import NO_GAP
from sim2real.search.exchanged import LAGS
from sim2real.search.fit import Fit
from sim2real.search.fitting import begin, iterate
from sim2real.search.screening import extended
from sim2real.search.singles import ITERATIONS

PART = 0.1  # of what would be lost without the lag, with which the pair begins


def lost_beside_lag(problem: Problem, singles: Sequence[Fit], pairs: Sequence[Fit]) -> list[Fit]:
    """Fits of lost commands beside each lag, where both explain alone as much as the best effect does.

    Args:
        problem: The campaign.
        singles: Fits of single effects.
        pairs: Fits of pairs; what is among them is not fitted again.
    """
    alone = {f.hypothesis.effects: f for f in singles}
    enough = min((f.cost for f in singles), default=np.inf) + NO_GAP
    lost = alone.get((LOST,))
    if lost is None or not lost.cost < enough:
        return []
    known = {frozenset(f.hypothesis.effects) for f in pairs}
    lags = [alone[name,] for name in LAGS if (name,) in alone and {LOST, name} not in known]
    begun = []
    for f in (f for f in lags if f.cost < enough):
        own, h = len(f.hypothesis.coordinates), f.hypothesis.instead(LOST, *f.hypothesis.effects)
        begun.append((h, extended(h, np.concatenate([PART * lost.u[:1], f.u[:own]]), f)))
    fits = begin([h for h, _ in begun], [u for _, u in begun], problem.data, problem.simulate)
    iterate(fits, problem.data, problem.simulate, ITERATIONS)
    return fits
