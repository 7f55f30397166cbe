"""Two effects fitted together: the most promising pairs, found by a linear prediction."""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import replace

import numpy as np

from sim2real.compared.point import TOLERANCE_EFFECTS
from sim2real.compared.problem import Problem
from sim2real.compared.reached import current_reached
from sim2real.recorded.drifting import DRIFTING
from sim2real.search.along_law import along_law
from sim2real.search.exchanged import exchanged, resembling
from sim2real.search.fit import Fit
from sim2real.search.fitting import begin, differentiate, iterate, share_calibrations
from sim2real.search.hypotheses import Hypothesis, coordinates_of
from sim2real.search.joint import joint_pairs
from sim2real.search.ringing import ringing
from sim2real.search.screening import Start, beside, extended, formed, screened
from sim2real.search.singles import FIRST, ITERATIONS, begin_at
from sim2real.search.starts import starts, starts_elsewhere
from sim2real.search.where_it_stands import LAW, where_it_stands

SEEDS, PAIRS = 4, 8  # per round: best single effects to which a second one is added, and pairs that are fitted
PER_SEED = 5  # of these, beside the same effect: on the one recording that ranks them, one may seem good by itself
DRIFTS = 2  # per round: pairs with a drift that are fitted beside these, where a drift explains less alone than others
STRETCHED = 2  # best single effects beside which a stated parameter may become an effect
SWAPPED = 2  # best pairs of which either effect is tried with others
# Cost that a second effect must save to be more probable than its absence (see `Belief`), where the best single effect
# leaves no more than noise. Where it leaves more, what is random in that saves as many times more.
SECOND = 16.0
SEED_SHARE = 0.5  # of what the best single effect saves, which another one must save to be given a second one


def fit_pairs(
    problem: Problem, bases: Sequence[Fit], singles: Sequence[Fit], known: Sequence[Fit] = ()
) -> tuple[list[Fit], list[Fit]]:
    """Fit pairs, and the single effects again.

    A second effect is tried beside each of the best single ones, two are tried together where neither alone explains
    much, and then others beside either effect of the best pairs at its values in the pair: the single effect that best
    replaces two need not be one of them; and what acts like an effect of the best pair in its place. Then either effect
    of the best pairs is fitted alone from its values in the pair. Where no pair of the first rounds explains more than
    the best single effect, that is left out. Finally, what moved far beyond its tolerance beside one of the best single
    effects is tried as an effect itself.

    A single effect that contradicts a stated tolerance is no explanation, so pairs are neither built on it nor compared
    with it.

    Args:
        problem: The campaign.
        bases: Fits without effects: the untouched nominal rig and calibration.
        singles: Fits of single effects.
        known: Fits of pairs.

    Returns:
        pairs: Fits of pairs, the known ones among them.
        singles: The better fit of each single effect.
    """
    unexplained = bases[-1].cost
    possible = [f for f in singles if not f.hypothesis.contradicted(f.u)]
    least = min((f.cost for f in possible), default=np.inf)
    enough = least + (1 - SEED_SHARE) * (unexplained - least) if np.isfinite(unexplained) else np.inf
    able = (f for f in possible if np.isfinite(f.cost) and f.cost <= enough)
    found, second = [*known], saved_by_second(problem, singles)
    if not found:
        # Without what is seen apart from any simulation nothing explains, however little it explains alone.
        sure = [f for f in possible if np.isfinite(f.cost) and f.hypothesis.effects[0] in f.hypothesis.seen]
        found = _round(problem, singles, sure or sorted(able, key=lambda f: f.cost)[:SEEDS], ())
        found += _together(problem, bases, singles, found)
    if not min((f.cost for f in found), default=np.inf) < least - second:
        return found + _freed(problem, singles, {frozenset(f.hypothesis.effects) for f in found}), list(singles)
    steady = [f for f in found if DRIFTING not in f.hypothesis.effects]
    found += _round(problem, singles, _halves(problem, steady), {frozenset(f.hypothesis.effects) for f in found})
    found += _like_the_best(problem, singles, found)
    again = _halves(problem, [f for f in found if DRIFTING not in f.hypothesis.effects])
    iterate(again, problem.data, problem.simulate, ITERATIONS)
    best = {f.hypothesis.effects: f for f in sorted([*again, *singles], key=lambda f: -f.cost - f.occam)}
    better = [best[f.hypothesis.effects] for f in singles]
    found = along_law(problem, ringing(problem, found))
    return found + _freed(problem, better, {frozenset(f.hypothesis.effects) for f in found}), better


def saved_by_second(problem: Problem, singles: Sequence[Fit]) -> float:
    """Cost that a second effect must save beside single ones."""
    least = min((f.cost for f in singles if np.isfinite(f.cost)), default=0.0)
    return SECOND * max(1.0, least / (2.0 * problem.data.size))


def _freed(problem: Problem, singles: Sequence[Fit], known: Collection[frozenset[str]]) -> list[Fit]:
    """Fits of the best single effects, each with the effect of a stated parameter that moved too far beside it.

    One that contradicts a stated tolerance is tried, too: beside the effect it does not.
    """
    jobs, able = [], {f.hypothesis.effects[0] for f in singles}
    for f in sorted((f for f in singles if np.isfinite(f.cost)), key=lambda f: f.cost)[:STRETCHED]:
        for name in f.hypothesis.strained(f.u):
            other = TOLERANCE_EFFECTS.get(name)
            if other in able and {*f.hypothesis.effects, other} not in known:
                h, own = f.hypothesis.instead(*f.hypothesis.effects, other), len(f.hypothesis.coordinates)
                jobs.append((h, extended(h, np.pad(f.u[:own], (0, len(h.coordinates) - own)), f)))
    fits = begin([h for h, _ in jobs], [u for _, u in jobs], problem.data, problem.simulate)
    iterate(fits, problem.data, problem.simulate, FIRST + ITERATIONS)
    return fits


def _together(problem: Problem, bases: Sequence[Fit], singles: Sequence[Fit], known: Sequence[Fit]) -> list[Fit]:
    """Fits of pairs that no seed leads to, where they promise more than the known ones.

    Where the rotor falls by the nominal rig, gain and stiffness of its magnets may both be stated wrong.
    """
    base = next((f for f in bases if np.isfinite(f.cost) and f.jacobian is not None), None)
    if base is None:
        return _another_law(problem, bases[-1].hypothesis, singles)
    least = min((f.cost for f in known), default=np.inf)
    tried = {frozenset(f.hypothesis.effects) for f in known}
    second = saved_by_second(problem, singles)
    proposed = [p for p in joint_pairs(problem, base, singles, tried) if p.cost < least - second]
    fits = begin([p.hypothesis for p in proposed], [p.u for p in proposed], problem.data, problem.simulate)
    share_calibrations(fits, base)
    iterate(fits, problem.data, problem.simulate, FIRST + ITERATIONS)
    return fits


def _another_law(problem: Problem, h: Hypothesis, singles: Sequence[Fit]) -> list[Fit]:
    """The fit of gain and stiffness together, from where the rotor stands."""
    if not {(name,) for name in LAW} <= {f.hypothesis.effects for f in singles}:
        return []
    fit = where_it_stands(problem, h.instead(*LAW))
    if fit is None:
        return []
    iterate([fit], problem.data, problem.simulate, FIRST + ITERATIONS)
    return [fit]


def _like_the_best(problem: Problem, singles: Sequence[Fit], found: Sequence[Fit]) -> list[Fit]:
    """Fits of pairs with an effect of the best one replaced by one that acts alike."""
    best = min(found, key=lambda f: f.cost)
    wanted = {*exchanged(best.hypothesis.effects)} - {frozenset(f.hypothesis.effects) for f in found}
    if not wanted:
        return []
    return _round(problem, singles, _halves(problem, [best]), (), wanted)


def _beside_which(h: Hypothesis, alone: Mapping[str, float]) -> float:
    """Least cost of the single effects of a pair; that of the one that is seen, where one is."""
    return min(alone[name] for name in ([name for name in h.effects if name in h.seen] or h.effects))


def alone_again(problem: Problem, singles: Sequence[Fit], pairs: Sequence[Fit]) -> list[Fit]:
    """Single effects fitted from their values and their forms in the best pairs.

    The form of an effect has minima of its own, and beside an effect that does nothing another one may be found.
    """
    least = min((f.cost for f in singles), default=np.inf)
    found = _halves(problem, [f for f in pairs if f.cost < least - saved_by_second(problem, singles)])
    iterate(found, problem.data, problem.simulate, FIRST + ITERATIONS)
    return found


def _halves(problem: Problem, pairs: Sequence[Fit]) -> list[Fit]:
    """Either effect of the best pairs alone, at its values in the pair; without those that touch down."""
    halves: dict[str, tuple[Hypothesis, np.ndarray]] = {}
    able = (f for f in pairs if np.isfinite(f.cost))
    for f in sorted(able, key=lambda f: f.cost)[:SWAPPED]:
        n, both = len(coordinates_of(f.hypothesis.effects[0], f.hypothesis.scales)), len(f.hypothesis.coordinates)
        for name, u in zip(f.hypothesis.effects, (f.u[:n], f.u[n:both]), strict=True):
            alone = f.hypothesis.instead(name)
            halves.setdefault(name, (alone, extended(alone, u, f)))
    fits = begin([h for h, _ in halves.values()], [u for _, u in halves.values()], problem.data, problem.simulate)
    return [f for f in fits if np.isfinite(f.cost)]


def _round(
    problem: Problem,
    singles: Sequence[Fit],
    seeds: Sequence[Fit],
    known: Collection[frozenset[str]],
    only: Collection[frozenset[str]] | None = None,
) -> list[Fit]:
    """Fit the most promising new pairs, found by a linear prediction: any effect beside the effect of a seed, or those
    of `only`."""
    differentiate(seeds, problem.data, problem.simulate, True)
    jobs, reached = [], current_reached(problem)
    for seed in seeds:
        first = seed.hypothesis.effects[0]
        n = len(seed.hypothesis.coordinates)
        for other in singles:
            name = other.hypothesis.effects[0]
            if name == first or {first, name} in known or (only is not None and {first, name} not in only):
                continue
            h = seed.hypothesis.instead(first, name)
            if not other.hypothesis.coordinates:  # on this rig it has a form alone, which only a fit of it knows
                h = replace(h, shaped=(*h.shaped, name))
            own, forms_of = len(other.hypothesis.coordinates), formed(other.hypothesis, other.u)
            tried = [(start, forms_of) for start in starts(name, h.scales)]
            if np.isfinite(other.cost):
                tried.append((other.u[:own], forms_of))
            if not own:  # where it sits beside another effect need not be where it explained most alone
                elsewhere = starts_elsewhere(seed.hypothesis, name, reached)
                tried += [(u[:0], formed(free, u)) for free, u in elsewhere]
            jobs += [(seed, h, beside(h, np.concatenate([seed.u[:n], at]), seed, forms)) for at, forms in tried]
    drifts = PAIRS if any(DRIFTING in seed.hypothesis.effects for seed in seeds[:1]) else DRIFTS
    chosen: dict[frozenset[str], Start] = {}
    ranked = screened(problem, jobs, apart=False)
    for start in ranked:
        pair = frozenset(start.hypothesis.effects)
        # In the mean a drift is another gain: unless it explains most alone, its pairs have places of their own.
        most = len(only) if only is not None else drifts if DRIFTING in pair else PAIRS
        same = sum(other.hypothesis.effects[0] == start.hypothesis.effects[0] for other in chosen.values())
        if only is None and len(seeds) > 1 and same >= PER_SEED:
            continue
        if sum((DRIFTING in other) == (DRIFTING in pair) for other in chosen) < most:
            chosen.setdefault(pair, start)
    alike = {other for pair in list(chosen)[:SWAPPED] for other in resembling(pair)}
    for start in ranked:
        if (pair := frozenset(start.hypothesis.effects)) in alike:
            chosen.setdefault(pair, start)
    fits, of = begin_at(problem, list(chosen.values()), ranked), {f.hypothesis.effects[0]: f for f in seeds}
    alone = {f.hypothesis.effects[0]: f.cost for f in singles}
    for f in fits:
        share_calibrations([f], of[f.hypothesis.effects[0]])
    second = saved_by_second(problem, singles)
    below = [_beside_which(f.hypothesis, alone) - second for f in fits]
    iterate(fits, problem.data, problem.simulate, FIRST + ITERATIONS, below)
    return fits
