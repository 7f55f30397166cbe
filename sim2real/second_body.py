"""A rotor that bends or a support that gives way, in the fit of one rig to its recordings."""

from dataclasses import dataclass, replace

import numpy as np

from sim2real.coefficients import misfit
from sim2real.compared.problem import Problem
from sim2real.search.fit import Fit
from sim2real.search.fitting import begin, iterate
from sim2real.search.starts import starts

BODY = "support_resonance"
# What is known as the mass was weighed with all that hangs on it. The scale of gain and stiffness rests on that.
INSIDE = {BODY: {"inside": 1.0}}
LACKS = 10.0  # times the noise that one mass must leave
EXPLAINS = 0.1  # of what it leaves, what a second body may leave
STEPS = 40
HEAVY = {"mass_ratio": 0.3, "damping_ratio": 0.02}  # of a second body, where a fit begins
FOLLOWED = 4  # starts that are followed, beside the nominal rig and beside the fit of one mass


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
    body = h.coordinates[first:]
    at = [np.array([c.at(HEAVY.get(c.parameter, c.value(v))) for c, v in zip(body, start, strict=True)])
          for start in starts(BODY, h.scales)]  # fmt: skip
    # What one mass lacks may have driven its fit far away, so starts lie beside the nominal rig, too. A body that is a
    # good part of the mass changes too much for a linear prediction: all starts are simulated.
    begun: list[Fit] = []
    for u in (np.zeros(fit.u.size), fit.u):
        own = [np.concatenate([u[:first], start, u[first:]]) for start in at]
        tried = begin([h] * len(own), own, problem.data, problem.simulate)
        begun += sorted(tried, key=lambda one: one.cost)[:FOLLOWED]
    iterate(begun, problem.data, problem.simulate, STEPS)
    best = min(begun, key=lambda one: one.cost, default=fit)
    return best if best.cost < EXPLAINS * fit.cost else None


@dataclass(frozen=True)
class SecondBody:
    """What hangs on a spring inside the stated mass.

    Attributes:
        share: Its part of the stated mass.
        mode_hz: Of the free rotor, Hz.
        damping_ratio: Of the body on its spring.
    """

    share: float
    mode_hz: float
    damping_ratio: float


def second_body_of(fit: Fit) -> SecondBody | None:
    """The second body of a fit, None where it has none."""
    body = fit.hypothesis.point(fit.u).effects.get(BODY)
    if BODY not in fit.hypothesis.effects or body is None:
        return None
    ratio = body["mass_ratio"]
    mode = float(body["frequency"] * np.sqrt(1 + ratio))
    return SecondBody(ratio / (1 + ratio), mode, body["damping_ratio"])


def body_in_words(body: SecondBody) -> str:
    """A note that a second body was fitted."""
    return (
        "the rotor bends, or its support gives way: one mass leaves much, so a second body on a spring is fitted, "
        f"{body.share:.0%} of the stated mass, with a mode of the free rotor at {body.mode_hz:.4g} Hz; gain, stiffness "
        "and damping are those beside it"
    )
