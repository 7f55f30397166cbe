"""Where a fit lies far along a valley of its cost: whether the cost at its other end is really higher.

What only the curvature of a force law tells apart, such as the springs of a rotor and the pull of its magnets, leaves a
valley that is flat over several times their size, and narrow again where the curvature at the fit is looked at. Where
one sine is all that moves the rotor, a light resonance that fits the noise is such a narrow place.
"""

from dataclasses import replace

import numpy as np

from sim2real.compared.problem import Problem
from sim2real.compared.whole_gain import GAIN
from sim2real.recorded.open_record import along_instrument
from sim2real.search.fit import Fit
from sim2real.search.fitting import begin, iterate

WIDE = 0.05  # relative standard error from which a valley may be bent
BEYOND = 0.15  # relative change from which it may be, however narrow the valley is at the fit
FAR = 2.0  # standard errors from the nominal value within which intervals reach it anyway
STEPS = 8  # of a fit along the valley
ROUNDS = 2  # in which what is compared follows such a fit
ASIDE = 6.0  # standard errors from a fit near the nominal gain at which that is held
# What the best of all resonances that noise makes saves, rarely more: of recordings of nothing but noise it was 16 to
# 19 in one of fifty, and 26 in one of 260.
CHANCE = 25.0
# Share of the cost by the curvature that the other end must hope to come below to be followed further: it then widens
# an interval by more than a twentieth.
LOWER = 0.9


def held_aside(problem: Problem, fit: Fit) -> list[Fit]:
    """Points at which one coordinate is held and all others fit so well as to show whether the cost there is as high as
    the curvature claims.

    Each coordinate that lies far from its nominal value is held there; one that changes a parameter in proportion must
    have wide standard errors too, or have changed a lot. The gain of what is compared along instruments alone is held
    on either side of the fit where it lies near: noise in the measured drive hides how far its valley goes on.
    """
    h, covariance, found = fit.hypothesis, fit.covariance(), []
    along = any(along_instrument(p.record) for p in problem.parts)
    for i, c in enumerate(h.coordinates):
        sd = float(np.sqrt(covariance[i, i]))
        for at in _asides(fit, i, sd, along):
            held = replace(h, held={c.effect: c.value(at)})
            start = fit.u + covariance[:, i] / covariance[i, i] * (at - fit.u[i])
            start[i] = at
            start = held.bounded(start)
            (point,) = begin([held], [start], problem.data, problem.simulate)
            if np.isfinite(point.cost):
                claimed = LOWER * ((at - fit.u[i]) / sd) ** 2 + CHANCE
                iterate([point], problem.data, problem.simulate, STEPS, [fit.cost + claimed])
                found.append(_about_itself(problem, point) if along else point)
    return found


def _asides(fit: Fit, i: int, sd: float, along: bool) -> tuple[float, ...]:
    """Values at which the i-th coordinate, of a standard error by the curvature, is held."""
    h, c, u = fit.hypothesis, fit.hypothesis.coordinates[i], float(fit.u[i])
    if c.scale is None or not sd or any(o.scale is None for o in h.coordinates if o.effect == c.effect):
        return ()  # a mode has no nominal frequency
    if abs(u) < FAR * sd:
        return tuple(c.to_bounds(u + side * ASIDE * sd) for side in (-1, 1)) if along and c.effect == GAIN else ()
    narrow = c.parameter == "change" and sd * c.scale < WIDE and abs(u) * c.scale < BEYOND
    return () if narrow and not (along and c.effect == GAIN) else (0.0,)


def _about_itself(problem: Problem, point: Fit) -> Fit:
    """A held fit where what is compared along instruments alone is compared about it.

    What errors of the measured drive change, and what the noise in it adds, is told about one point. About another one
    it differs by as much as a valley is long.
    """
    best = point
    for _ in range(ROUNDS):
        moved = problem.about(point.hypothesis.point(best.u))
        (again,) = begin([point.hypothesis], [best.u], moved.data, moved.simulate)
        if not np.isfinite(again.cost):
            break
        iterate([again], moved.data, moved.simulate, STEPS)
        best = again
    return best
