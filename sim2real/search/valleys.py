"""Where a fit lies far along a valley of its cost: whether the cost at its other end is really higher.

What only the curvature of a force law tells apart, such as the springs of a rotor and the pull of its magnets, leaves a
valley that is flat over several times their size, and narrow again where the curvature at the fit is looked at. Where
one sine is all that moves the rotor, a light resonance that fits the noise is such a narrow place.
"""

from dataclasses import replace

import numpy as np

from sim2real.compared.problem import Problem
from sim2real.search.fit import Fit
from sim2real.search.fitting import begin, iterate

WIDE = 0.05  # relative standard error from which a valley may be bent
BEYOND = 0.15  # relative change from which it may be, however narrow the valley is at the fit
FAR = 2.0  # standard errors from the nominal value within which intervals reach it anyway
STEPS = 8  # of a fit along the valley
# What the best of all resonances that noise makes saves, rarely more: of recordings of nothing but noise it was 16 to
# 19 in one of fifty, and 26 in one of 260.
CHANCE = 25.0
# Share of the cost by the curvature that the other end must hope to come below to be followed further: it then widens
# an interval by more than a twentieth.
LOWER = 0.9


def held_at_nominal(problem: Problem, fit: Fit) -> list[Fit]:
    """Points at which one coordinate is nominal and all others fit so well as to show whether the cost there is as high
    as the curvature claims, for each coordinate that lies far from there; one that changes a parameter in proportion
    must have wide standard errors too, or have changed a lot."""
    h, covariance, found = fit.hypothesis, fit.covariance(), []
    for i, c in enumerate(h.coordinates):
        sd = float(np.sqrt(covariance[i, i]))
        if c.scale is None or not sd or abs(fit.u[i]) < FAR * sd:
            continue
        if any(other.scale is None for other in h.coordinates if other.effect == c.effect):
            continue  # a mode has no nominal frequency
        if c.parameter == "change" and sd * c.scale < WIDE and abs(fit.u[i]) * c.scale < BEYOND:
            continue
        held = replace(h, held=(c.effect,))
        start = fit.u - covariance[:, i] / covariance[i, i] * fit.u[i]
        start[i] = 0.0
        (point,) = begin([held], [start], problem.data, problem.simulate)
        if np.isfinite(point.cost):
            claimed = LOWER * (fit.u[i] / sd) ** 2 + CHANCE
            iterate([point], problem.data, problem.simulate, STEPS, [fit.cost + claimed])
            found.append(point)
    return found
