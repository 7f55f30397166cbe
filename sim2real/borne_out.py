"""Which of the explanations that fitted recordings do not distinguish the holdout bears out."""

from collections.abc import Sequence
from dataclasses import replace

from sim2real.attribute import Attribution
from sim2real.judge import Entry
from sim2real.problem import Problem
from sim2real.shrink import gap_of
from sim2real.simulated import Point

CLEAR_GAP = 1.2  # in units of the noise, left by calibration on the holdout: what is named must then leave less


def borne_out(judged: Problem, attribution: Attribution, named: Sequence[Entry]) -> list[Entry]:
    """Those with which the holdout is simulated better than on the nominal rig, and better than after calibration
    alone, where that leaves a clear gap. Tones are kept: they leave the compared lines alone.

    Args:
        judged: The holdout.
        attribution: The fitted candidates.
        named: Hypotheses with effects.
    """
    fits = [None if e.candidate is None else attribution.candidates[e.candidate].fit for e in named]
    fits = [None if f is None or not f.hypothesis.effects else f for f in fits]
    tried = [attribution.calibration.fit, *(f for f in fits if f is not None)]
    points = [Point({}, {}), *(f.hypothesis.point(f.u) for f in tried)]
    before, calibrated, *after = (gap_of(r) for r in judged.data - judged.simulate(points))
    if before is None:
        return list(named)
    least = before if calibrated is None or calibrated <= CLEAR_GAP else min(before, calibrated)
    left = iter(after)
    gaps = [None if f is None else next(left) for f in fits]
    return [e for e, f, gap in zip(named, fits, gaps, strict=True) if f is None or (gap is not None and gap < least)]


def without(found: Sequence[Entry], refuted: Sequence[Entry]) -> list[Entry]:
    """All hypotheses, the most probable first, without the probability of those that the holdout refutes."""
    kept = sum(e.probability for e in found if e not in refuted)
    now = [replace(e, probability=0.0 if e in refuted else e.probability / kept) for e in found]
    return sorted(now, key=lambda e: -e.probability)
