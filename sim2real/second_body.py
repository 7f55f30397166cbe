"""A rotor that bends or a support that gives way, in the fit of one rig to its recordings."""

from dataclasses import replace

import numpy as np

from sim2real.coefficients import misfit
from sim2real.compared.problem import Problem
from sim2real.search.fitting import Fit, begin, differentiate, iterate
from sim2real.search.hypotheses import starts
from sim2real.search.screening import extended, kept, screened

BODY = "support_resonance"
# What is known as the mass was weighed with all that hangs on it. The scale of gain and stiffness rests on that.
INSIDE = {BODY: {"inside": 1.0}}
LACKS = 10.0  # times the noise that one mass must leave
EXPLAINS = 0.1  # of what it leaves, what a second body may leave
STEPS = 40


def with_second_body(problem: Problem, fit: Fit) -> Fit | None:
    """The fit with a second body on a spring, where one mass leaves much and the body takes most of that away.

    Args:
        problem: The recordings. A second body is looked for on one axis, and not below a single magnet: what hangs
            there is small and stiff, and what its law lacks would pass for one.
        fit: The rig's fit to them.
    """
    several = problem.parts[0].record.axes > 1
    if misfit(fit) < LACKS or several or "pair" in fit.hypothesis.scales.lacks:
        return None
    h = replace(fit.hypothesis, effects=(*fit.hypothesis.effects, BODY), given=INSIDE)
    first = len(fit.hypothesis.coordinates)
    # What one mass lacks may have driven its fit far away, so starts lie beside the nominal rig, too.
    (nominal,) = begin([fit.hypothesis], [np.zeros(fit.u.size)], problem.data, problem.simulate)
    seeds = [one for one in (nominal, fit) if np.isfinite(one.cost)]
    differentiate(seeds, problem.data, problem.simulate, True)
    begun: list[Fit] = []
    for seed in seeds:
        own = [np.concatenate([seed.u[:first], start]) for start in starts(BODY, h.scales)]
        chosen = kept(screened(problem, [(seed, h, extended(h, u, seed)) for u in own]))
        begun += begin([s.hypothesis for s in chosen], [s.u for s in chosen], problem.data, problem.simulate)
    iterate(begun, problem.data, problem.simulate, STEPS)
    best = min(begun, key=lambda one: one.cost, default=fit)
    return best if best.cost < EXPLAINS * fit.cost else None


def body_in_words(fit: Fit) -> str | None:
    """The second body of a fit, None where it has none."""
    body = fit.hypothesis.point(fit.u).effects.get(BODY)
    if BODY not in fit.hypothesis.effects or body is None:
        return None
    ratio = body["mass_ratio"]
    return (
        "the rotor bends, or its support gives way: one mass leaves much, so a second body on a spring is fitted, "
        f"{ratio / (1 + ratio):.0%} of the stated mass, with a mode of the free rotor at "
        f"{body['frequency'] * np.sqrt(1 + ratio):.4g} Hz; gain, stiffness and damping are those beside it"
    )
