"""Which of the explanations that fitted recordings do not distinguish the holdout bears out."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from sim2real.compared.point import NOMINAL
from sim2real.compared.problem import Problem
from sim2real.gap.shrink import closed, gap_of, left_on, lost
from sim2real.judgement.dispersion import NOISE_INFLATION
from sim2real.judgement.judge import Entry
from sim2real.search.candidates import NO_GAP, Attribution
from sim2real.search.fit import Fit
from sim2real.search.hypotheses import UNKNOWN, WIDER

SIGNIFICANT = 3.0  # standard deviations of the noise's power on the holdout
PLAINLY = 2.0  # chi-square per degree of freedom on the fitted recordings that is a gap whatever the holdout shows
CERTAIN = 100.0  # cost that no noise and no error at single moments saves; without an effect it was 11 at most
MOST = 0.5  # share of a gap that something named closes, unless it surely closes some
CLEAR_GAP = 1.2  # in units of the noise, left by calibration on the holdout: what is named must then leave less


def borne_out(judged: Problem, attribution: Attribution, named: Sequence[Entry]) -> list[Entry]:
    """Those with which the holdout is simulated better than on the nominal rig, better than after calibration alone
    where that leaves a clear gap, and not clearly worse where calibration keeps to what the rig states. What leaves
    most of a gap that is clearly there, and perhaps all of it, has followed the recordings that were fitted. A holdout
    of which no more than noise is left with what these show beyond doubt, wherever they let its parameters be, says
    nothing of it, as of a limit that it does not reach. Where calibration leaves a clear gap of the holdout only
    because the fitted recordings hardly tell a parameter that it depends on, as the gain of a force, so may what is
    named: both are then compared wherever those let their parameters be. Tones are kept: they leave the compared lines
    alone.

    Args:
        judged: The holdout.
        attribution: The fitted candidates.
        named: Hypotheses with effects.
    """
    fits = [None if e.candidate is None else attribution.candidates[e.candidate].fit for e in named]
    fits = [None if f is None or not f.hypothesis.effects else f for f in fits]
    tried = [attribution.calibration.fit, *(f for f in fits if f is not None)]
    points = [NOMINAL, *(f.hypothesis.point(f.u) for f in tried)]
    before, calibrated, *after = judged.data - judged.simulate(points)
    nominal, alone = gap_of(before), gap_of(calibrated)
    if nominal is None:
        return list(named)
    least = nominal if alone is None or alone <= CLEAR_GAP else min(nominal, alone)
    as_stated = _as_stated(attribution)
    anywhere = left_on(judged, tried[0]) if alone is not None and alone > CLEAR_GAP else np.inf
    untold = anywhere < most_of_noise(judged.data.size)

    def bears_out(fit: Fit, left: np.ndarray) -> bool:
        if untold:
            return left_on(judged, fit) < anywhere + NO_GAP
        gap = gap_of(left)
        if gap is None or (as_stated and lost(calibrated, left) > NO_GAP):
            return False
        share, interval = closed(before, left, 0)
        if gap < least and (share is None or interval is None or share > MOST or interval[0] > 0):
            return True
        beyond_doubt = attribution.calibration.fit.cost - fit.cost > CERTAIN
        return beyond_doubt and left_on(judged, fit) < most_of_noise(left.size)

    left = iter(after)
    return [e for e, f in zip(named, fits, strict=True) if f is None or bears_out(f, next(left))]


def shows_nothing(judged: Problem, attribution: Attribution, saved: float) -> bool:
    """Whether calibration, within what the rig states, leaves no more of the holdout than noise does.

    What other explanations save on the fitted recordings is then no evidence of an effect, known or unknown, unless
    calibration leaves several times the noise of these: the holdout then shows too little. Nor is it nothing if they
    save so much there that something must differ between the recordings, as what depends on the amplitude does.

    Args:
        judged: The holdout.
        attribution: The fitted candidates.
        saved: What the best of these explanations saves beyond calibration.
    """
    fit = attribution.calibration.fit
    if saved > CERTAIN:
        return False
    if not np.isfinite(fit.cost) or not _as_stated(attribution) or fit.cost > PLAINLY * attribution.expected:
        return False
    left = judged.data - judged.simulate([fit.hypothesis.point(fit.u)])[0]
    return bool(np.sum(np.abs(left) ** 2) < most_of_noise(left.size))


def most_of_noise(count: int) -> float:
    """Cost of that many complex residuals beyond which there is more than noise, which is known as well as it is."""
    return 2.0 * count + SIGNIFICANT * NOISE_INFLATION * np.sqrt(4.0 * count)


def _as_stated(attribution: Attribution) -> bool:
    """Whether calibration keeps to the tolerances of the rig."""
    return bool(np.all(np.abs(attribution.calibration.fit.u) <= WIDER))


def without(found: Sequence[Entry], refuted: Sequence[Entry]) -> list[Entry]:
    """All hypotheses, the most probable first, without the probability of those that the holdout refutes."""
    kept = sum(e.probability for e in found if e not in refuted) or 1.0
    now = [replace(e, probability=0.0 if e in refuted else e.probability / kept) for e in found]
    return sorted(now, key=lambda e: -e.probability)


def handed_on(found: Sequence[Entry], shown: Sequence[Entry]) -> list[Entry]:
    """All hypotheses, the most probable first, where the holdout shows some instead of calibration.

    An unknown cause stays as probable as it was. All else is handed on to those that are shown.
    """
    unknown = sum(e.probability for e in found if e.effects == (UNKNOWN,))
    shares = sum(e.probability for e in shown) or 1.0
    others = [e for e in found if e.effects != (UNKNOWN,)]
    now = [replace(e, probability=(1 - unknown) * e.probability / shares if e in shown else 0.0) for e in others]
    now += [e for e in found if e.effects == (UNKNOWN,)]
    return sorted(now, key=lambda e: -e.probability)
