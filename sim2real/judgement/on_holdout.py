"""What fitted hypotheses leave of recordings that no fit has used, beyond what their own uncertainty explains."""

from collections.abc import Iterator, Sequence
from dataclasses import replace
from itertools import chain

import numpy as np

from maglev_env.loop.effect import EFFECTS
from sim2real.compared.point import Point
from sim2real.compared.problem import Problem
from sim2real.gap.shrink import gap_of, left_on
from sim2real.judgement.borne_out import CLEAR_GAP, PLAINLY, most_of_noise
from sim2real.judgement.judge import Entry
from sim2real.search.candidates import ABOUT, NO_GAP, Attribution, Candidate
from sim2real.search.fit import Fit
from sim2real.search.fitting import Simulate, begin, iterate
from sim2real.search.hypotheses import Hypothesis
from sim2real.search.shaping import free_forms, starts

# Multiple of the shares of their cards that other forms of effects may leave of the gap of one recording, and the least
# such share: forms of effects that hardly have any left 1.6 % of large gaps at most (see `EffectCard.form_share`).
OTHER_FORM, ANY_FORM = 2.5, 0.05
STEPS = 12  # of a fit of all recordings


def shown_by_both(
    judged: Problem, attribution: Attribution, named: Sequence[Entry], tempering: float = 1.0
) -> list[Entry]:
    """Single effects that fitted recordings and holdout show together, where the fitted ones do not ask for any.

    Two recordings may tell different combinations of parameters: a drive of the current alone does not tell mass from
    gain, which a force does. Calibration then explains the fitted recordings by a gain that the holdout contradicts.

    Args:
        judged: The holdout.
        attribution: The fitted candidates.
        named: Hypotheses with effects.
        tempering: What differences of evidence are divided by (see `dispersion`).

    Returns:
        Those that both are explained with; none where calibration leaves no clear gap of the holdout, or explains
        both together about as well.
    """
    plain = attribution.calibration.fit
    left = judged.data - judged.simulate([plain.hypothesis.point(plain.u)])[0]
    gap = gap_of(left)
    if gap is None or gap <= CLEAR_GAP:
        return []
    tried = [(e, attribution.candidates[e.candidate]) for e in named if e.candidate is not None and len(e.effects) == 1]
    tried = [(e, c) for e, c in tried if c.effects and c.predictive < attribution.calibration.predictive + ABOUT]
    cost = np.array([_of_both(judged, c) for _, c in tried])
    about = ABOUT * tempering
    if not tried or not cost.min() < _of_both(judged, attribution.calibration) - about:
        return []
    return [e for (e, _), own in zip(tried, cost, strict=True) if own < cost.min() + about]


def leaves_clear_gap(judged: Problem, attribution: Attribution, shown: Sequence[Entry]) -> bool:
    """Whether each of these leaves a clear gap of the holdout, wherever the fitted recordings let its parameters be.

    What explains most of a gap better than calibration does need not be its cause.

    Args:
        judged: The holdout.
        attribution: The fitted candidates.
        shown: Hypotheses with fits.
    """
    fits = (attribution.candidates[e.candidate].fit for e in shown if e.candidate is not None)
    return all(left_on(judged, fit) > CLEAR_GAP**2 * 2.0 * judged.data.size for fit in fits)


def leaves_too_much(judged: Problem, attribution: Attribution, named: Sequence[Entry]) -> list[Entry]:
    """Those that leave a clear gap of the holdout and more of what calibration leaves of it than another form may.

    Fitted recordings tell a small effect's name from its size alone where their noise has room for its form. What grows
    otherwise with the motion than the name says shows on recordings that no fit has seen. Noise is taken as loud as it
    looks: errors at single moments, for which it is widened elsewhere, are what a wrong name leaves, too.

    Args:
        judged: The holdout.
        attribution: The fitted candidates.
        named: Hypotheses.
    """
    asked = [(e, e.candidate) for e in named if e.candidate is not None and attribution.candidates[e.candidate].effects]
    if not asked:
        return []
    if judged.louder > 1:
        best = attribution.candidates[asked[0][1]].fit
        judged = judged.again(best.hypothesis.point(best.u))
    noise = 2.0 * judged.data.size
    least = max(CLEAR_GAP**2 * noise, most_of_noise(judged.data.size))
    gap = left_on(judged, attribution.calibration.fit) - noise

    def too_much(left: float, of_form: float) -> bool:
        return bool(np.isfinite(left)) and left > least and left - noise > max(OTHER_FORM * of_form, ANY_FORM) * gap

    found = []
    for e, candidate in asked:
        fit, of_form = attribution.candidates[candidate].fit, _form_share(attribution, candidate)
        every = chain([left_on(judged, fit)], _left_by_fits(judged, attribution.problem, fit))
        if all(too_much(left, of_form) for left in every):
            found.append(e)
    return found


def _form_share(attribution: Attribution, candidate: int) -> float:
    """Share of what effects explain that other forms of them leave: the mean over them, by what each saves."""
    cost, names = attribution.candidates[candidate].fit.cost, attribution.candidates[candidate].effects
    shares = [EFFECTS[name].form_share for name in names]
    saved = [max(attribution.without(candidate, name) - cost, 0.0) for name in names]
    if not 0 < sum(saved) < np.inf:
        return max(shares)
    return float(np.average(shares, weights=saved))


def together(one: Problem, other: Problem) -> tuple[np.ndarray, Simulate]:
    """Data (K,) of two problems, and what simulates them at points, (points, K)."""

    def simulate(points: Sequence[Point]) -> np.ndarray:
        return np.concatenate([one.simulate(points), other.simulate(points)], axis=1)

    return np.concatenate([one.data, other.data]), simulate


def _left_by_fits(judged: Problem, fitted: Problem, fit: Fit) -> Iterator[float]:
    """As `left_on`, with everything fitted to all recordings together; then with all forms of the effects free, too.

    Where the fitted recordings do not ask for another form of an effect, the holdout may.
    """
    data, simulate = together(fitted, judged)

    def least(hypothesis: Hypothesis, tried: Sequence[np.ndarray]) -> float:
        fits = begin([hypothesis] * len(tried), tried, data, simulate)
        fits = [f for f in fits if np.isfinite(f.cost)]
        iterate(fits, data, simulate, STEPS)
        return min((f.cost for f in fits), default=np.inf) - fit.cost

    yield least(fit.hypothesis, [fit.u])
    freed = replace(fit.hypothesis, shaped=free_forms(fit))
    if freed != fit.hypothesis:
        yield least(freed, starts(fit, freed))


def calibration_fails(judged: Problem, attribution: Attribution) -> bool:
    """Whether calibration leaves plainly more than noise of the holdout, wherever the fitted recordings let it be.

    These may be explained by it although an effect is there: their noise, where it is told without a period, has room
    for what the simulation lacks.
    """
    left = left_on(judged, attribution.calibration.fit)
    return bool(np.isfinite(left) and left > PLAINLY * 2.0 * judged.data.size)


def spoken_against(judged: Problem, attribution: Attribution, named: Sequence[Entry]) -> list[Entry]:
    """Hypotheses that the fitted recordings hardly show, and the holdout less than calibration alone.

    What a fit of many effects saves by chance it loses on recordings that it has not seen. Together with these it must
    still save more than NO_GAP.

    Args:
        judged: The holdout.
        attribution: The fitted candidates.
        named: Hypotheses with effects.
    """
    asked = [(e, attribution.candidates[e.candidate]) for e in named if e.candidate is not None]
    saved = [attribution.calibration.predictive - c.predictive for _, c in asked]
    weak = [(e, c, s) for (e, c), s in zip(asked, saved, strict=True) if c.effects and s < NO_GAP + ABOUT]
    if not weak:
        return []
    plain = left_on(judged, attribution.calibration.fit)
    more = [left_on(judged, c.fit) - plain for _, c, _ in weak]
    return [e for (e, _, s), m in zip(weak, more, strict=True) if np.isfinite(m) and m > 0 and s - m < NO_GAP]


def _of_both(judged: Problem, candidate: Candidate) -> float:
    return candidate.predictive + left_on(judged, candidate.fit)
