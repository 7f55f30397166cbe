"""Whether one cause without a name explains what is named as two effects.

A flexible correction absorbs every effect, so that it competes with none. But two effects together are flexible, too:
what no name describes is often met by one that comes near it and a second one that makes up for the rest. Two real
effects, each seen, are hardly met by one correction, of one quantity at one place of the loop.
"""

from collections.abc import Sequence

import numpy as np

from maglev_env.loop.effect import EFFECTS
from sim2real.compared.problem import Problem
from sim2real.free.fit import looked_at
from sim2real.free.kinds import CURVE, LINEAR, Freed, Kind, kinds, sizes_of
from sim2real.judgement.judge import Entry
from sim2real.judgement.on_holdout import together
from sim2real.search.candidates import ABOUT, Attribution
from sim2real.search.exchanged import LAGS
from sim2real.search.fit import Fit
from sim2real.search.fitting import begin, iterate
from sim2real.search.hypotheses import RESONANCES

WITH_MEMORY = frozenset({*RESONANCES, *LAGS, "dropped_samples"})
TRIED, STEPS = 3, 8  # pairs and kinds of corrections that are fitted, and steps of each fit


def explained_by_one(judged: Problem, attribution: Attribution, named: Sequence[Entry]) -> str | None:
    """Block of the one free correction that explains the fitted recordings and the holdout about as well as the best of
    named pairs of effects; None where none does, or where not all that is named are pairs.

    Args:
        judged: The holdout.
        attribution: The fitted candidates.
        named: Hypotheses that are named.
    """
    if min((len(e.effects) for e in named), default=0) < 2 or any(e.candidate is None for e in named):
        return None
    fits = [attribution.candidates[e.candidate].fit for e in named if e.candidate is not None][:TRIED]
    calibration = attribution.calibration.fit
    if min(len(f.hypothesis.effects) for f in fits) < 2 or not np.isfinite(calibration.cost):
        return None
    problem = attribution.problem
    sizes = sizes_of(problem, calibration.hypothesis.point(calibration.u))
    if sizes is None:
        return None
    able = [k for k in kinds(problem, sizes) if all(is_more_than(f.hypothesis.effects, k) for f in fits)]
    freed = [fit for _, fit in looked_at(problem, calibration, able, (), sizes)[:TRIED]] if able else []
    if not freed:
        return None
    iterate(freed, problem.data, problem.simulate, STEPS)
    if min(f.cost for f in freed) > min(f.cost for f in fits) + ABOUT:
        return None
    of_pairs = _of_all(problem, judged, fits)
    of_one = _of_all(problem, judged, freed)
    best = int(np.argmin(of_one))
    added = [kind for f in freed if isinstance(f.hypothesis, Freed) for kind in f.hypothesis.added]
    # As elsewhere, the simpler of about equal explanations is preferred.
    if not of_one[best] < min(of_pairs) + ABOUT:
        return None
    return added[best].block


def is_more_than(effects: Sequence[str], kind: Kind) -> bool:
    """Whether two effects do more together than a correction of this kind ever can: a lag or a mode is no curve, and
    what depends on the size of the motion is not linear. Else one correction would stand for two real effects."""
    if kind.shape == CURVE:
        return not WITH_MEMORY.isdisjoint(effects)
    return kind.shape == LINEAR and not all(EFFECTS[name].linear for name in effects)


def _of_all(problem: Problem, judged: Problem, fits: Sequence[Fit]) -> list[float]:
    """Expected cost of further records (Akaike 1974) of fits that are continued on all recordings together."""
    data, simulate = together(problem, judged)
    again = begin([f.hypothesis for f in fits], [f.u for f in fits], data, simulate)
    standing = [f for f in again if np.isfinite(f.cost)]
    iterate(standing, data, simulate, STEPS)
    return [f.cost + 2.0 * len(f.hypothesis.coordinates) for f in again]
