"""Each effect fitted alone, from its most promising starts."""

from collections.abc import Sequence

import numpy as np

from sim2real.compared.problem import Problem
from sim2real.compared.reached import current_reached
from sim2real.search.fit import Fit
from sim2real.search.fitting import begin, iterate, share_calibrations
from sim2real.search.screening import Start, beside, extended, formed, kept, place, screened
from sim2real.search.starts import starts, starts_elsewhere

FIRST, ITERATIONS = 3, 20  # steps of a fit from every start that is followed; further steps of the better one
SPARE = 30  # other starts of an effect that are tried when one makes the rotor touch down
MOVED = 1.0  # tolerances up to which calibration leaves the rig where it is
LEAST = 6.0  # cost below calibration that a single effect must promise to be fitted to the end


def fit_singles(problem: Problem, seeds: Sequence[Fit], names: Sequence[str]) -> list[Fit]:
    """Fit each effect alone, from its most promising starts.

    Starts are placed beside the untouched nominal rig and beside calibration alone, because a missing effect may have
    driven the calibration far away. Where it was not, one of both is enough. What promises no more than calibration is
    not followed.

    Returns:
        The best fit of each effect; where it may sit at other places (`place`), one in its plain form and one there.
        What is elsewhere has its form free, so that after a few steps it is ahead, and it may end in a minimum of its
        own. An effect with which the rotor falls at every start is among them, with an infinite cost: beside another
        one it may stand.
    """
    fits: list[Fit] = []
    kinds: dict[int, tuple] = {}
    unexplained, reached = seeds[-1].cost, current_reached(problem)
    if np.isfinite(unexplained) and np.max(abs(seeds[-1].u), initial=0.0) < MOVED:
        seeds = seeds[-1:]
    for seed in seeds:
        jobs = [
            (seed, h, extended(h, start, seed))
            for h in map(seed.hypothesis.instead, names)
            for start in starts(h.effects[0], h.scales)
        ]
        elsewhere = (each for name in names for each in starts_elsewhere(seed.hypothesis, name, reached))
        jobs += [(seed, h, beside(h, u[: len(h.coordinates)], seed, formed(h, u))) for h, u in elsewhere]
        ranked = screened(problem, jobs)
        begun = begin_at(problem, kept(ranked), ranked)
        share_calibrations(begun, seed)
        kinds |= {id(f): (f.hypothesis.effects, f.hypothesis.shaped, place(f.hypothesis, f.u)) for f in begun}
        fits += begun
    asked = unexplained - LEAST if np.isfinite(unexplained) else np.inf
    iterate(fits, problem.data, problem.simulate, FIRST, [asked] * len(fits))
    tried = dict.fromkeys(kinds.values())
    best = [min((f for f in fits if kinds[id(f)] == own), key=lambda f: f.cost) for own in tried]
    iterate(best, problem.data, problem.simulate, ITERATIONS, [asked] * len(best))
    standing = {f.hypothesis.effects for f in best}
    return best + [_fallen(problem, seeds[-1], name) for name in names if (name,) not in standing]


def _fallen(problem: Problem, seed: Fit, name: str) -> Fit:
    h = seed.hypothesis.instead(name)
    return Fit(h, extended(h, np.zeros(len(h.coordinates)), seed), problem.data, np.inf)


def begin_at(problem: Problem, chosen: Sequence[Start], ranked: Sequence[Start]) -> list[Fit]:
    """Fits at the chosen starts.

    Where a start passed on the screened record but touches down on another record, the best of the other starts of its
    effects, on all records, replaces it.
    """
    fits = begin([s.hypothesis for s in chosen], [s.u for s in chosen], problem.data, problem.simulate)
    fallen = {s.hypothesis.effects: i for i, s in enumerate(chosen) if not np.isfinite(fits[i].cost)}
    spare = {names: [s for s in ranked if s.hypothesis.effects == names][:SPARE] for names in fallen}
    others = [s for same in spare.values() for s in same]
    for f in begin([s.hypothesis for s in others], [s.u for s in others], problem.data, problem.simulate):
        i = fallen[f.hypothesis.effects]
        if f.cost < fits[i].cost:
            fits[i] = f
    return fits
