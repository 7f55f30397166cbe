"""Which effect explains the gap: candidate effects are fitted in closed loop, alone and in pairs."""

from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from maglev_env.loop.effect import EFFECTS
from sim2real.compared.problem import Problem
from sim2real.compared.reached import current_reached
from sim2real.compared.simulated import DITHERED, MAY_BE_DITHERED, tolerances, unseen_by_all
from sim2real.recorded.not_stable import not_stable
from sim2real.search.fitting import Fit, begin, differentiate, iterate, share_calibrations
from sim2real.search.hypotheses import (
    Hypothesis,
    coordinates_of,
    resembling,
    single_effects,
    starts,
    starts_elsewhere,
    usual_tolerances,
)
from sim2real.search.screening import Start, extended, kept, screened
from sim2real.search.shaping import shaped

FIRST, ITERATIONS = 3, 20  # steps of a fit from every start that is followed; further steps of the better one
SEEDS, PAIRS = 4, 8  # per round: best single effects to which a second one is added, and pairs that are fitted
SHAPED, SHAPED_PAIRS = 3, 2  # best single effects and pairs that are tried in other forms
SPARE = 30  # other starts of an effect that are tried when one makes the rotor touch down
BLURRED, BLURRED_SHARE = 4, 0.5  # best fits that are repeated with sensor noise, and share of the gap they may leave
BLURRED_TIE, LEFT_SD = 0.05, 3.0  # that share where the best leaves no more than so many standard deviations of noise
MOVED = 1.0  # tolerances up to which calibration leaves the rig where it is
SWAPPED = 2  # best pairs of which either effect is tried with others
LEAST = 6.0  # cost below calibration that a single effect must promise to be fitted to the end
SECOND = 16.0  # cost that a second effect must save to be more probable than its absence (see `Belief`)
SEED_SHARE = 0.5  # of what the best single effect saves, which another one must save to be given a second one
NO_GAP = 12.0  # if no single effect lowers the cost of calibration by more than this, no pair is tried
ABOUT = 30.0  # cost above the best within which a candidate of fewer effects is preferred
FREE = 20.0  # factor on the tolerances that makes them as good as no prior, for a refit of all parameters
CLOSE, CLOSE_SHARE = 500.0, 0.5  # cost above the best within which the standard errors of a fit are computed

Progress = Callable[[str], None]


@dataclass(frozen=True)
class Candidate:
    """A fitted hypothesis."""

    fit: Fit

    @property
    def effects(self) -> tuple[str, ...]:
        return self.fit.hypothesis.effects

    @property
    def contradicted(self) -> tuple[str, ...]:
        """Effects whose fitted change contradicts the stated tolerance of their parameter."""
        return self.fit.hypothesis.contradicted(self.fit.u)

    @property
    def predictive(self) -> float:
        """Expected cost of further records of this kind: fitted cost plus twice the free parameters (Akaike 1974).

        Forms of effects have priors; their freedom costs as by Laplace's method.
        """
        return self.fit.cost + 2.0 * len(self.fit.hypothesis.coordinates) + self.fit.occam


@dataclass(frozen=True)
class Attribution:
    """All fitted candidates of a campaign.

    Attributes:
        nominal: Cost of the unchanged nominal rig; inf where it touches down.
        candidates: Calibration alone first, then single effects and pairs.
        expected: Cost of the true model, twice the number of complex residuals.
        problem: The problem that was fitted.
    """

    nominal: float
    candidates: tuple[Candidate, ...]
    expected: float
    problem: Problem

    def of(self, *effects: str) -> Candidate | None:
        for candidate in self.candidates:
            if set(candidate.effects) == set(effects):
                return candidate
        return None

    @property
    def simplest(self) -> Candidate:
        """The candidate with the fewest effects among those that are about as good as the best."""
        least = min(c.predictive for c in self.candidates)
        near = [c for c in self.candidates if c.predictive < least + ABOUT]
        return min(near, key=lambda c: (len(c.effects), c.predictive))

    @property
    def calibration(self) -> Candidate:
        return self.candidates[0]

    @cached_property
    def refitted(self) -> Fit | None:
        """Every nominal parameter that has a tolerance, fitted without it."""
        base = self.calibration.fit
        if not np.isfinite(base.cost) or not base.hypothesis.tolerances:
            return None
        free = Hypothesis((), {name: FREE * sigma for name, sigma in base.hypothesis.tolerances.items()})
        fits = begin([free], [base.u / FREE], self.problem.data, self.problem.simulate)
        iterate(fits, self.problem.data, self.problem.simulate, 8)
        return fits[0]


def attribute(
    problem: Problem,
    progress: Progress = lambda text: None,
    earlier: Attribution | None = None,
    reach: np.ndarray | None = None,
) -> Attribution:
    """Fit calibration alone, each effect that has a meaning on the rig, and the most promising pairs.

    Args:
        problem: The campaign.
        progress: Called with the name of each step.
        earlier: Of the same recordings with other noise or nuisances; its candidates are fitted again from where they
            ended, and only further pairs are looked for.
        reach: Cost above the best of its candidates within which each is fitted again (candidates,); the others are
            only simulated. None: all are.

    Raises:
        ValueError: No hypothesis levitates under the recorded gains.
    """
    rig = problem.parts[0].record.nominal
    hidden = unseen_by_all([part.record for part in problem.parts])
    allowed = tolerances(rig)
    progress("calibration")
    base = Hypothesis((), allowed, scales=rig.scales, usual=usual_tolerances(rig))
    untouched, *calibration = begin([base] * 2, [np.zeros(base.size)] * 2, problem.data, problem.simulate)
    nominal = untouched.cost
    if np.isfinite(nominal):
        differentiate([untouched], problem.data, problem.simulate, True)
        share_calibrations(calibration, untouched)
    iterate(calibration, problem.data, problem.simulate, ITERATIONS)
    differentiate(calibration, problem.data, problem.simulate, True)
    pairs: list[Fit] = []
    if earlier is None:
        progress("single effects")
        shown = [name for name in single_effects(rig) if name not in hidden]
        singles = _singles(problem, (untouched, calibration[0]), shown)
    else:
        progress("the same effects again")
        singles, pairs = _again(problem, earlier, reach)
    least = min((f.cost for f in singles), default=np.inf)
    if not calibration[0].cost - least < NO_GAP:
        progress("forms of effects")
        singles = shaped(problem, calibration[0].cost, singles, SHAPED)
        progress("pairs of effects")
        pairs, singles = _pairs(problem, calibration[0].cost, singles, pairs)
        pairs = shaped(problem, calibration[0].cost, pairs, SHAPED_PAIRS)
    fits = _blurred(problem, [*calibration, *singles, *pairs])
    standing = [f for f in fits if np.isfinite(f.cost)]
    if not standing:
        wrong = next(filter(None, (not_stable(part.record.experiment) for part in problem.parts)), None)
        why = wrong or "check the gains, their units and the sign of the displacement"
        raise ValueError(
            f"campaign: neither the nominal rig {rig.name} nor any single effect levitates with the recorded gains; "
            f"{why}"
        )
    least = min(f.cost for f in standing)
    close = [f for f in standing if f.cost - least < CLOSE + CLOSE_SHARE * least and f.cost < fits[0].cost - LEAST]
    at_end = [f for f in (fits[0], *close) if not f.fresh and f.jacobian is not None]
    differentiate(at_end, problem.data, problem.simulate, True)
    return Attribution(nominal, tuple(map(Candidate, fits)), 2.0 * problem.data.size, problem)


def _may_blur(effects: Collection[str]) -> bool:
    return DITHERED.isdisjoint(effects) and not MAY_BE_DITHERED.isdisjoint(effects)


def _blurred(problem: Problem, fits: Sequence[Fit]) -> list[Fit]:
    """The fits, with the best ones that noise may smooth fitted again with noise; the better of both is kept.

    A pair whose other effect alone does as well needs nothing that noise may smooth. Where a fit leaves no more than
    noise, only what leaves little can do as well as that.
    """
    least, count = min(f.cost for f in fits), 2.0 * problem.data.size
    share = BLURRED_SHARE if least > count + LEFT_SD * np.sqrt(2 * count) else BLURRED_TIE
    enough = least + share * (fits[0].cost - least)
    alone = {frozenset(f.hypothesis.effects): f.cost for f in fits}

    def needed(f: Fit) -> bool:
        return alone.get(frozenset(f.hypothesis.effects) - MAY_BE_DITHERED, np.inf) > f.cost + NO_GAP

    able = [f for f in fits if f.cost < enough and _may_blur(f.hypothesis.effects) and needed(f)]
    tried = sorted(able, key=lambda f: f.cost)[:BLURRED]
    again = begin(
        [replace(f.hypothesis, dithered=True) for f in tried], [f.u for f in tried], problem.data, problem.simulate
    )
    iterate(again, problem.data, problem.simulate, FIRST)
    better = {id(f): new for f, new in zip(tried, again, strict=True) if new.cost < f.cost}
    iterate(list(better.values()), problem.data, problem.simulate, ITERATIONS)
    return [better.get(id(f), f) for f in fits]


def _singles(problem: Problem, seeds: Sequence[Fit], names: Sequence[str]) -> list[Fit]:
    """Fit each effect alone, from its most promising starts.

    Starts are placed beside the untouched nominal rig and beside calibration alone, because a missing effect may have
    driven the calibration far away. Where it was not, one of both is enough. What promises no more than calibration is
    not followed.
    """
    fits: list[Fit] = []
    unexplained, reached = seeds[-1].cost, current_reached(problem)
    if np.isfinite(unexplained) and np.max(abs(seeds[-1].u), initial=0.0) < MOVED:
        seeds = seeds[-1:]
    for seed in seeds:
        jobs = [
            (seed, h, extended(h, start, seed))
            for h in map(seed.hypothesis.instead, names)
            for start in starts(h.effects[0], h.scales)
        ]
        jobs += [(seed, h, u) for name in names for h, u in starts_elsewhere(seed.hypothesis, name, reached)]
        ranked = screened(problem, jobs)
        begun = _begun(problem, kept(ranked), ranked)
        share_calibrations(begun, seed)
        fits += begun
    asked = unexplained - LEAST if np.isfinite(unexplained) else np.inf
    iterate(fits, problem.data, problem.simulate, FIRST, [asked] * len(fits))
    tried = dict.fromkeys(f.hypothesis.effects for f in fits)
    best = [min((f for f in fits if f.hypothesis.effects == names), key=lambda f: f.cost) for names in tried]
    iterate(best, problem.data, problem.simulate, ITERATIONS, [asked] * len(best))
    return best


def _begun(problem: Problem, chosen: Sequence[Start], ranked: Sequence[Start]) -> list[Fit]:
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


def _again(problem: Problem, earlier: Attribution, reach: np.ndarray | None) -> tuple[list[Fit], list[Fit]]:
    """The single effects and the pairs of an earlier attribution, fitted from where they ended.

    Those that are farther behind the best there than they reach are only simulated: they keep their coordinates and
    have no Jacobian, and so no standard errors.
    """
    known = [c.fit for c in earlier.candidates if c.effects]
    fits = begin([f.hypothesis for f in known], [f.u for f in known], problem.data, problem.simulate)
    least = min((f.cost for f in fits), default=np.inf)
    far = np.full(len(fits), np.inf) if reach is None else reach[[bool(c.effects) for c in earlier.candidates]]
    near = [f for f, own in zip(fits, far, strict=True) if f.cost <= least + own]
    iterate(near, problem.data, problem.simulate, ITERATIONS)
    return [f for f in fits if len(f.hypothesis.effects) == 1], [f for f in fits if len(f.hypothesis.effects) > 1]


def _pairs(
    problem: Problem, unexplained: float, singles: Sequence[Fit], known: Sequence[Fit] = ()
) -> tuple[list[Fit], list[Fit]]:
    """Fit pairs, and the single effects again.

    A second effect is tried beside each of the best single ones, and then beside either effect of the best pairs at
    its values in the pair: the single effect that best replaces two need not be one of them. Finally, either effect
    of the best pairs is fitted alone from its values in the pair. Where no pair of the first round explains more than
    the best single effect, that is all.

    Args:
        problem: The campaign.
        unexplained: Cost without any effect.
        singles: Fits of single effects.
        known: Fits of pairs.

    Returns:
        pairs: Fits of pairs, the known ones among them.
        singles: The better fit of each single effect.
    """
    least = min((f.cost for f in singles), default=np.inf)
    enough = least + (1 - SEED_SHARE) * (unexplained - least) if np.isfinite(unexplained) else np.inf
    able = (f for f in singles if np.isfinite(f.cost) and f.cost <= enough)
    found = [*known] or _round(problem, singles, sorted(able, key=lambda f: f.cost)[:SEEDS], ())
    if not min((f.cost for f in found), default=np.inf) < least - SECOND:
        return found, list(singles)
    found += _round(problem, singles, _halves(problem, found), {frozenset(f.hypothesis.effects) for f in found})
    again = _halves(problem, found)
    iterate(again, problem.data, problem.simulate, ITERATIONS)
    best = {f.hypothesis.effects: f for f in sorted([*again, *singles], key=lambda f: -f.cost - f.occam)}
    return found, [best[f.hypothesis.effects] for f in singles]


def _beside(h: Hypothesis, effects: np.ndarray, seed: Fit, other: Fit) -> np.ndarray:
    """Coordinates beside a seed; forms that only the other fit has are taken from it."""
    u, first = extended(h, effects, seed), len(h.coordinates)
    known = dict(zip(other.hypothesis.calibrated, other.u[len(other.hypothesis.coordinates) :], strict=True))
    for i, name in enumerate(h.calibrated, first):
        if name in other.hypothesis.shapes and name not in seed.hypothesis.shapes:
            u[i] = known[name]
    return u


def _halves(problem: Problem, pairs: Sequence[Fit]) -> list[Fit]:
    """Either effect of the best pairs alone, at its values in the pair; without those that touch down."""
    halves: dict[str, tuple[Hypothesis, np.ndarray]] = {}
    for f in sorted((f for f in pairs if np.isfinite(f.cost)), key=lambda f: f.cost)[:SWAPPED]:
        n, both = len(coordinates_of(f.hypothesis.effects[0], f.hypothesis.scales)), len(f.hypothesis.coordinates)
        for name, u in zip(f.hypothesis.effects, (f.u[:n], f.u[n:both]), strict=True):
            alone = f.hypothesis.instead(name)
            halves.setdefault(name, (alone, extended(alone, u, f)))
    fits = begin([h for h, _ in halves.values()], [u for _, u in halves.values()], problem.data, problem.simulate)
    return [f for f in fits if np.isfinite(f.cost)]


def _round(
    problem: Problem, singles: Sequence[Fit], seeds: Sequence[Fit], known: Collection[frozenset[str]]
) -> list[Fit]:
    """Fit the most promising new pairs, found by a linear prediction: any effect beside the effect of a seed."""
    differentiate(seeds, problem.data, problem.simulate, True)
    jobs = []
    for seed in seeds:
        first = seed.hypothesis.effects[0]
        n = len(seed.hypothesis.coordinates)
        for other in singles:
            name = other.hypothesis.effects[0]
            if name == first or {first, name} in known:
                continue
            h = seed.hypothesis.instead(first, name)
            if not other.hypothesis.coordinates:  # on this rig it has a form alone, which only a fit of it knows
                h = replace(h, shaped=(*h.shaped, name))
            tried = starts(name, h.scales)
            if np.isfinite(other.cost):
                tried = [*tried, other.u[: len(other.hypothesis.coordinates)]]
            jobs += [(seed, h, _beside(h, np.concatenate([seed.u[:n], start]), seed, other)) for start in tried]
    chosen: dict[frozenset[str], Start] = {}
    ranked = screened(problem, jobs, apart=False)
    for start in ranked:
        if len(chosen) < PAIRS:
            chosen.setdefault(frozenset(start.hypothesis.effects), start)
    alike = {other for pair in list(chosen)[:SWAPPED] for other in resembling(pair)}
    for start in ranked:
        if (pair := frozenset(start.hypothesis.effects)) in alike:
            chosen.setdefault(pair, start)
    fits, of = _begun(problem, list(chosen.values()), ranked), {f.hypothesis.effects[0]: f for f in seeds}
    alone = {f.hypothesis.effects[0]: f.cost for f in singles}
    for f in fits:
        share_calibrations([f], of[f.hypothesis.effects[0]])
    below = [min(alone[name] for name in f.hypothesis.effects) - SECOND for f in fits]
    iterate(fits, problem.data, problem.simulate, FIRST + ITERATIONS, below)
    return fits


def contradictions(attribution: Attribution) -> list[str]:
    """A sentence for each single effect that would explain more than all others if the rig did not exclude it."""
    allowed = min((c.predictive for c in attribution.candidates if not c.contradicted), default=np.inf)
    found = []
    for c in attribution.candidates:
        if len(c.effects) == 1 and c.contradicted and c.predictive < allowed:
            nominal = EFFECTS[c.effects[0]].nominal
            change = c.fit.hypothesis.coordinates[0].value(float(c.fit.u[0]))
            stated = attribution.problem.parts[0].record.nominal.tolerance[nominal]
            found.append(
                f"{c.effects[0]} {100 * change:+.3g} % would fit better than what is named, but the rig states "
                f"{nominal} to within {100 * stated:.2g} % ([tolerance]); if that is wrong, correct it"
            )
    return found


def best_partial(attribution: Attribution, probable: int | None) -> Candidate:
    """The best partial explanation: the most probable effects, or calibration where none explains more than it.

    Args:
        attribution: The fitted candidates.
        probable: Index of the most probable candidate with effects; None or 0 where there is none.
    """
    if probable:
        best = attribution.candidates[probable]
    else:
        best = min(attribution.candidates, key=lambda c: (bool(c.contradicted), c.predictive))
    return best if best.predictive < attribution.calibration.predictive - NO_GAP else attribution.calibration
