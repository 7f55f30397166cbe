"""Which effect: candidates fitted in closed loop, alone and in pairs."""

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from sim2real.fitting import Fit, begin, differentiate, iterate, share_calibrations
from sim2real.hypotheses import COORDINATES, Hypothesis, single_effects, starts
from sim2real.problem import Problem
from sim2real.screening import Start, extended, kept, screened
from sim2real.simulated import DITHERED, MAY_BE_DITHERED, tolerances

FIRST, ITERATIONS = 3, 20  # steps of a fit from every start that is followed, and more of the better one
SEEDS, PAIRS = 4, 8  # best single effects that a second one is added to, and pairs that are fitted, in a round
SPARE = 30  # starts of an effect that are tried instead of one that touches down
BLURRED, BLURRED_SHARE = 4, 0.5  # best fits that are tried with noise that blurs them, and what they may leave
SWAPPED = 2  # best pairs of which either effect is tried with others
NO_GAP = 12.0  # cost that no single effect saves beyond calibration: then no pair is looked for
ABOUT = 30.0  # cost above the best that a simpler candidate may have to be taken for it
CLOSE, CLOSE_SHARE = 500.0, 0.5  # cost above the best within which the errors of a fit are of interest

Progress = Callable[[str], None]


@dataclass(frozen=True)
class Candidate:
    """A fitted hypothesis."""

    fit: Fit

    @property
    def effects(self) -> tuple[str, ...]:
        return self.fit.hypothesis.effects

    @property
    def predictive(self) -> float:
        """Expected cost of other records like these: what was fitted and twice its free parameters (Akaike 1974)."""
        return self.fit.cost + 2.0 * len(self.fit.hypothesis.coordinates)


@dataclass(frozen=True)
class Attribution:
    """nominal: cost of the nominal rig as it is (inf where it touches down). candidates: calibration alone
    first, then singles and pairs. expected: cost of the true model, twice the number of complex residuals."""

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
        """The one with fewest effects of those that are about as good as the best."""
        least = min(c.predictive for c in self.candidates)
        near = [c for c in self.candidates if c.predictive < least + ABOUT]
        return min(near, key=lambda c: (len(c.effects), c.predictive))

    @property
    def calibration(self) -> Candidate:
        return self.candidates[0]


def attribute(problem: Problem, progress: Progress = lambda text: None) -> Attribution:
    """Fit calibration alone, each effect that has a meaning on the rig, and the most promising pairs.

    ValueError when no hypothesis at all levitates under the recorded gains.
    """
    rig = problem.parts[0].record.nominal
    allowed = tolerances(rig)
    progress("calibration")
    base = Hypothesis((), allowed)
    untouched, *calibration = begin([base] * 2, [np.zeros(base.size)] * 2, problem.data, problem.simulate)
    nominal = untouched.cost
    if np.isfinite(nominal):
        differentiate([untouched], problem.data, problem.simulate, True)
        share_calibrations(calibration, untouched)
    iterate(calibration, problem.data, problem.simulate, ITERATIONS)
    differentiate(calibration, problem.data, problem.simulate, True)
    progress("single effects")
    singles = _singles(problem, (untouched, calibration[0]), single_effects(rig), allowed)
    pairs: list[Fit] = []
    least = min((f.cost for f in singles), default=np.inf)
    if not calibration[0].cost - least < NO_GAP:
        progress("pairs of effects")
        pairs, singles = _pairs(problem, singles)
    fits = _blurred(problem, [*calibration, *singles, *pairs])
    standing = [f for f in fits if np.isfinite(f.cost)]
    if not standing:
        raise ValueError(
            f"campaign: neither the nominal rig {rig.name} nor any single effect levitates with the recorded gains; "
            "check the gains, their units and the sign of the displacement"
        )
    least = min(f.cost for f in standing)
    close = [f for f in standing if f is fits[0] or f.cost - least < CLOSE + CLOSE_SHARE * least]
    differentiate(close, problem.data, problem.simulate, True)
    return Attribution(nominal, tuple(map(Candidate, fits)), 2.0 * problem.data.size, problem)


def _may_blur(effects: Collection[str]) -> bool:
    return DITHERED.isdisjoint(effects) and not MAY_BE_DITHERED.isdisjoint(effects)


def _blurred(problem: Problem, fits: Sequence[Fit]) -> list[Fit]:
    """The fits, of which the best ones whose effects noise may blur are fitted so too, and the better kept."""
    least = min(f.cost for f in fits)
    enough = least + BLURRED_SHARE * (fits[0].cost - least)
    able = [f for f in fits if f.cost < enough and _may_blur(f.hypothesis.effects)]
    tried = sorted(able, key=lambda f: f.cost)[:BLURRED]
    again = begin(
        [replace(f.hypothesis, dithered=True) for f in tried], [f.u for f in tried], problem.data, problem.simulate
    )
    iterate(again, problem.data, problem.simulate, FIRST)
    better = {id(f): new for f, new in zip(tried, again, strict=True) if new.cost < f.cost}
    iterate(list(better.values()), problem.data, problem.simulate, ITERATIONS)
    return [better.get(id(f), f) for f in fits]


def _singles(problem: Problem, seeds: Sequence[Fit], names: Sequence[str], allowed: Mapping[str, float]) -> list[Fit]:
    """Each effect alone, from the starts that promise most: beside the untouched nominal rig, and beside calibration
    alone, which a missing effect may have driven far away."""
    fits: list[Fit] = []
    for seed in seeds:
        jobs = [
            (seed, h, extended(h, start, seed))
            for h in (Hypothesis((name,), allowed) for name in names)
            for start in starts(h.effects[0])
        ]
        ranked = screened(problem, jobs)
        fits += _begun(problem, kept(ranked), ranked)
    iterate(fits, problem.data, problem.simulate, FIRST)
    tried = dict.fromkeys(f.hypothesis.effects for f in fits)
    best = [min((f for f in fits if f.hypothesis.effects == names), key=lambda f: f.cost) for names in tried]
    iterate(best, problem.data, problem.simulate, ITERATIONS)
    return best


def _begun(problem: Problem, chosen: Sequence[Start], ranked: Sequence[Start]) -> list[Fit]:
    """Fits at the chosen starts; at another one of its effects, the best on all records, where that on the screened
    record alone touches down on others."""
    fits = begin([s.hypothesis for s in chosen], [s.u for s in chosen], problem.data, problem.simulate)
    fallen = {s.hypothesis.effects: i for i, s in enumerate(chosen) if not np.isfinite(fits[i].cost)}
    spare = {names: [s for s in ranked if s.hypothesis.effects == names][:SPARE] for names in fallen}
    others = [s for same in spare.values() for s in same]
    for f in begin([s.hypothesis for s in others], [s.u for s in others], problem.data, problem.simulate):
        i = fallen[f.hypothesis.effects]
        if f.cost < fits[i].cost:
            fits[i] = f
    return fits


def _pairs(problem: Problem, singles: Sequence[Fit]) -> tuple[list[Fit], list[Fit]]:
    """Pairs, and the single effects again. A second effect is tried beside each of the best single ones, then beside
    either effect of the best pairs as that pair has it: what alone does best in the place of two need not be one of
    them. In the end either effect is fitted alone from where the best pairs have it."""
    seeds = sorted((f for f in singles if np.isfinite(f.cost)), key=lambda f: f.cost)[:SEEDS]
    found = _round(problem, singles, seeds, ())
    found += _round(problem, singles, _halves(problem, found), {frozenset(f.hypothesis.effects) for f in found})
    again = _halves(problem, found)
    iterate(again, problem.data, problem.simulate, ITERATIONS)
    best = {f.hypothesis.effects: f for f in sorted([*again, *singles], key=lambda f: -f.cost)}
    return found, [best[f.hypothesis.effects] for f in singles]


def _halves(problem: Problem, pairs: Sequence[Fit]) -> list[Fit]:
    """Either effect of the best pairs alone, as the pair has it; without what touches down."""
    halves: dict[str, tuple[Hypothesis, np.ndarray]] = {}
    for f in sorted((f for f in pairs if np.isfinite(f.cost)), key=lambda f: f.cost)[:SWAPPED]:
        n, both = len(COORDINATES[f.hypothesis.effects[0]]), len(f.hypothesis.coordinates)
        for name, u in zip(f.hypothesis.effects, (f.u[:n], f.u[n:both]), strict=True):
            alone = Hypothesis((name,), f.hypothesis.tolerances)
            halves.setdefault(name, (alone, extended(alone, u, f)))
    fits = begin([h for h, _ in halves.values()], [u for _, u in halves.values()], problem.data, problem.simulate)
    return [f for f in fits if np.isfinite(f.cost)]


def _round(
    problem: Problem, singles: Sequence[Fit], seeds: Sequence[Fit], known: Collection[frozenset[str]]
) -> list[Fit]:
    """The pairs, other than those known, that a linear look promises most, fitted: any effect beside a seed's."""
    differentiate(seeds, problem.data, problem.simulate, True)
    jobs = []
    for seed in seeds:
        first = seed.hypothesis.effects[0]
        n = len(seed.hypothesis.coordinates)
        for other in singles:
            name = other.hypothesis.effects[0]
            if name == first or {first, name} in known:
                continue
            h = Hypothesis((first, name), seed.hypothesis.tolerances)
            tried = starts(name)
            if np.isfinite(other.cost):
                tried = [*tried, other.u[: len(COORDINATES[name])]]
            jobs += [(seed, h, extended(h, np.concatenate([seed.u[:n], start]), seed)) for start in tried]
    chosen: dict[frozenset[str], Start] = {}
    ranked = screened(problem, jobs)
    for start in ranked:
        if len(chosen) < PAIRS:
            chosen.setdefault(frozenset(start.hypothesis.effects), start)
    fits = _begun(problem, list(chosen.values()), ranked)
    iterate(fits, problem.data, problem.simulate, FIRST + ITERATIONS)
    return fits
