"""The score of a goal: a term for every requirement, and one for what is made best; docs/goals.md gives the reasons."""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from maglev_env.rig.goal import QUANTITIES, Goal, Requirement

SOFT = 0.01  # of a limit: within some of it a requirement turns from met to missed
MISSED = 0.05  # a requirement that is missed by this share of its limit has a term of one half
FAR = 1e3  # a value farther from its limit than this factor counts as being there
FLAT = 4.0  # from the scale of what is made best: a tenth of it changes the score by less than a hundredth beyond that
BEST = "best"
MARGINS = ("phase_margin", "gain_margin")  # unknown where the lines hold no crossing: those are met


def misses(requirement: Requirement, value: np.ndarray) -> np.ndarray:
    """Logarithm of the factor by which values (n,) miss a limit: 0 at the limit, negative where it is met."""
    with np.errstate(divide="ignore", invalid="ignore"):
        ratio = value / requirement.limit if requirement.quantity.most else requirement.limit / value
    # A stiffness or damping that is not positive misses every lower limit; a margin without a crossing misses none.
    ratio = np.where((ratio > 0) | np.isnan(ratio), ratio, FAR if not requirement.quantity.most else 1 / FAR)
    ratio = np.where(np.isnan(ratio), 1 / FAR if requirement.name in MARGINS else FAR, ratio)
    return np.log(np.clip(ratio, 1 / FAR, FAR))


def goal_terms(goal: Goal, values: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
    """Terms in (0, 1) of values (n,) by quantity: of each requirement, and BEST of what is made best.

    Of a requirement 1 / (1 + s / MISSED) with s = SOFT ln(1 + e^(x / SOFT)) and x of `misses`; of what is made best
    1 / (1 + e^x).
    """
    found = {}
    for one in goal.requirements:
        shortfall = SOFT * np.logaddexp(0.0, misses(one, values[one.name]) / SOFT)
        found[one.name] = 1 / (1 + shortfall / MISSED)
    if goal.best:
        found[BEST] = 1 / (1 + np.exp(misses(goal.best, values[goal.best.name])))
    return found


def goal_score(terms: Mapping[str, np.ndarray]) -> np.ndarray:
    """The product of all requirements' terms, times (1 + b) / 2 with b the term of what is made best."""
    total = np.ones(())
    for name, term in terms.items():
        total = total * ((1 + term) / 2 if name == BEST else term)
    return total


def met(goal: Goal, values: Mapping[str, np.ndarray]) -> np.ndarray:
    """Whether every requirement is met, (n,)."""
    return np.all([misses(one, values[one.name]) <= 0 for one in goal.requirements], axis=0)


def in_words(requirement: Requirement) -> str:
    """A requirement for a reader, in the units of the tables."""
    q = QUANTITIES[requirement.name]
    scale, unit = q.shown
    text = f"{q.words} {'at most' if q.most else 'at least'} {requirement.limit * scale:.4g} {unit}".rstrip()
    if requirement.at is None or q.condition is None:
        return text
    scale, unit = {"m": (1e6, "µm"), "N s": (1e3, "mN s")}.get(q.condition[1], (1.0, q.condition[1]))
    ends = requirement.at if isinstance(requirement.at, tuple) else (requirement.at,)
    return f"{text}, {q.condition[0]} {' to '.join(f'{end * scale:.4g}' for end in ends)} {unit}"


def scale_in_words(goal: Goal, value: float) -> str:
    """A sentence where what is made best is so far from its scale that the score hardly tells it; "" elsewhere."""
    best = goal.best
    if best is None or not np.isfinite(value) or value <= 0 or abs(np.log(value / best.limit)) <= np.log(FLAT):
        return ""
    (factor, unit), near = best.quantity.shown, replace(best, limit=float(f"{value:.2g}"))
    reached, stated = (f"{one * factor:.3g} {unit}".rstrip() for one in (value, best.limit))
    return (
        f"The {best.quantity.words} of {reached} is far from the scale that the goal states for what is made best, "
        f"{stated}: the score hardly tells it; to go on, write '{Goal((), near).text}'."
    )
