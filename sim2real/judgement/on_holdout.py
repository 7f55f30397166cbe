"""What fitted hypotheses leave of recordings that no fit has used, beyond what their own uncertainty explains."""

from collections.abc import Sequence

import numpy as np

from sim2real.compared.problem import Problem
from sim2real.gap.shrink import gap_of, left_on
from sim2real.judgement.borne_out import CLEAR_GAP, PLAINLY
from sim2real.judgement.judge import Entry
from sim2real.search.candidates import ABOUT, NO_GAP, Attribution, Candidate

OTHER_FORM = 0.25  # share of a gap that another form of an effect may leave: a tenth in the mean at most (their cards)


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
    otherwise with the motion than the name says shows on recordings that no fit has seen.

    Args:
        judged: The holdout.
        attribution: The fitted candidates.
        named: Hypotheses.
    """
    asked = [(e, attribution.candidates[e.candidate].fit) for e in named if e.candidate is not None]
    asked = [(e, fit) for e, fit in asked if fit.hypothesis.effects]
    if not asked:
        return []
    noise = 2.0 * judged.data.size
    most = OTHER_FORM * (left_on(judged, attribution.calibration.fit) - noise)
    left = [left_on(judged, fit) for _, fit in asked]
    too_much = [np.isfinite(own) and own > CLEAR_GAP**2 * noise and own - noise > most for own in left]
    return [e for (e, _), more in zip(asked, too_much, strict=True) if more]


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
