"""Which effect explains the gap: candidate effects are fitted in closed loop, alone and in pairs."""

from collections.abc import Callable, Collection, Sequence
from dataclasses import replace

import numpy as np

from sim2real.compared.commands_seen import LOST, share_lost
from sim2real.compared.drift import drift_of
from sim2real.compared.point import DITHERED, MAY_BE_DITHERED, NOMINAL, apart_tolerances, tolerances, unseen_by_all
from sim2real.compared.problem import Problem
from sim2real.compared.reached import motion_reached
from sim2real.compared.tolerance_forms import form_tolerances
from sim2real.recorded.drifting import DRIFTING
from sim2real.recorded.not_stable import not_stable
from sim2real.recorded.open_record import OpenRecord
from sim2real.search.across_ticks import across_ticks
from sim2real.search.again import again
from sim2real.search.candidates import NO_GAP, Attribution, Candidate
from sim2real.search.fit import Fit, above_noise
from sim2real.search.fitting import begin, differentiate, iterate, share_calibrations
from sim2real.search.hypotheses import Hypothesis, single_effects, usual_tolerances
from sim2real.search.lost_beside_lag import lost_beside_lag
from sim2real.search.pairs import alone_again, fit_pairs, saved_by_second
from sim2real.search.shaping import shaped
from sim2real.search.singles import FIRST, ITERATIONS, LEAST, fit_singles
from sim2real.search.sought_again import sought_again

SHAPED, SHAPED_PAIRS = 5, 5  # best single effects and pairs that are tried in other forms
BLURRED, BLURRED_SHARE = 4, 0.5  # best fits that are repeated with sensor noise, and share of the gap they may leave
BLURRED_TIE = 0.05  # that share where the best leaves no more than noise
CLOSE, CLOSE_SHARE = 500.0, 0.5  # cost above the best within which the standard errors of a fit are computed

Progress = Callable[[str], None]


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
    if not may_drift(problem):
        hidden |= {DRIFTING}
    progress("calibration")
    lost = share_lost(problem)
    seen = {LOST: lost} if lost is not None else {}
    scales = replace(rig.scales, motion=motion_reached(problem))
    both = Hypothesis((), tolerances(rig), scales=scales, usual=usual_tolerances(rig), own=rig.effects, seen=seen)
    if earlier is not None:
        known = earlier.calibration.fit.hypothesis
        both = replace(both, tolerances=known.tolerances, derived=known.derived)
    untouched, *calibration = _calibrated(problem, both)
    # What is tried only where it tells something: each further tolerance takes time in every fit.
    of_form = form_tolerances(problem.nuisances, rig)
    for further, derived in ((apart_tolerances(rig), frozenset()), (of_form, frozenset(of_form))):
        base = calibration[0].hypothesis
        wider = replace(base, tolerances=base.tolerances | further, derived=base.derived | derived)
        if wider != base and (found := _calibrated(problem, wider))[-1].cost < calibration[0].cost - NO_GAP:
            untouched, *calibration = found
    nominal = untouched.cost
    pairs: list[Fit] = []
    if earlier is None:
        progress("single effects")
        shown = [name for name in single_effects(rig) if name not in hidden]
        singles = across_ticks(problem, fit_singles(problem, (untouched, calibration[0]), shown))
    else:
        progress("the same effects again")
        singles, pairs = again(problem, earlier, reach)
    least = min((f.cost for f in singles), default=np.inf)
    if calibration[0].cost - least < NO_GAP:
        singles = _one_of_each(singles)
    else:
        progress("forms of effects")
        singles = _one_of_each(shaped(problem, calibration[0].cost, singles, SHAPED))
        progress("pairs of effects")
        pairs, singles = fit_pairs(problem, (untouched, calibration[0]), singles, pairs)
        # Of a pair it is asked what it explains beyond the best single effect: all explain most of a large gap.
        alone = min((f.cost for f in singles), default=np.inf) + saved_by_second(problem, singles)
        pairs = shaped(problem, min(alone, calibration[0].cost), pairs, SHAPED_PAIRS)
        pairs = [*pairs, *lost_beside_lag(problem, singles, pairs)]
        singles = _one_of_each([*singles, *alone_again(problem, singles, pairs)])
        moved = sought_again(problem, [*singles, *pairs])
        singles, pairs = moved[: len(singles)], moved[len(singles) :]
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


def _calibrated(problem: Problem, base: Hypothesis) -> list[Fit]:
    """The untouched nominal rig and calibration alone, with their Jacobians where they levitate."""
    untouched, calibration = begin([base] * 2, [np.zeros(base.size)] * 2, problem.data, problem.simulate)
    if np.isfinite(untouched.cost):
        differentiate([untouched], problem.data, problem.simulate, True)
        share_calibrations([calibration], untouched)
    iterate([calibration], problem.data, problem.simulate, ITERATIONS)
    differentiate([calibration], problem.data, problem.simulate, True)
    return [untouched, calibration]


def _one_of_each(fits: Sequence[Fit]) -> list[Fit]:
    """The best fit of each hypothesis: what may sit at other places was fitted in its plain form and there."""
    tried = dict.fromkeys(f.hypothesis.effects for f in fits)
    return [min((f for f in fits if f.hypothesis.effects == own), key=lambda f: f.cost + f.occam) for own in tried]


def may_drift(problem: Problem) -> bool:
    """Whether a drift of the gain would show: without a period, or where the periods have a trend.

    In the mean over periods it is a steady gain.
    """
    if any(isinstance(part.record, OpenRecord) for part in problem.parts):
        return True
    drift = drift_of(problem, NOMINAL)
    return drift is not None and drift.shown


def _may_blur(effects: Collection[str]) -> bool:
    return DITHERED.isdisjoint(effects) and not MAY_BE_DITHERED.isdisjoint(effects)


def _blurred(problem: Problem, fits: Sequence[Fit]) -> list[Fit]:
    """The fits, with the best ones that noise may smooth fitted again with noise; the better of both is kept.

    A pair of which one effect alone does as well has nothing that noise may smooth, or that effect has. Where a fit
    leaves no more than noise, only what leaves little can do as well as that.
    """
    least = min(f.cost for f in fits)
    share = BLURRED_SHARE if above_noise(least, problem.data.size) else BLURRED_TIE
    enough = least + share * (fits[0].cost - least)
    alone = {frozenset(f.hypothesis.effects): f.cost for f in fits}

    def needed(f: Fit) -> bool:
        own = frozenset(f.hypothesis.effects)
        parts = {own - MAY_BE_DITHERED, *(frozenset({name}) for name in own)} - {own}
        return min((alone.get(part, np.inf) for part in parts), default=np.inf) > f.cost + NO_GAP

    able = [f for f in fits if f.cost < enough and _may_blur(f.hypothesis.effects) and needed(f)]
    tried = sorted(able, key=lambda f: f.cost)[:BLURRED]
    blurred = begin(
        [replace(f.hypothesis, dithered=True) for f in tried], [f.u for f in tried], problem.data, problem.simulate
    )
    iterate(blurred, problem.data, problem.simulate, FIRST)
    better = {id(f): new for f, new in zip(tried, blurred, strict=True) if new.cost < f.cost}
    iterate(list(better.values()), problem.data, problem.simulate, ITERATIONS)
    return [better.get(id(f), f) for f in fits]
