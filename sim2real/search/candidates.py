"""Fitted hypotheses, and what can be said of them as they stand."""

from collections.abc import Collection
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from maglev_env.loop.effect import EFFECTS
from sim2real.compared.problem import Problem
from sim2real.search.fit import Fit
from sim2real.search.fitting import begin, iterate
from sim2real.search.hypotheses import Hypothesis

PART = 0.05  # share of what calibration leaves beyond noise that a partial explanation must save
NO_GAP = 12.0  # if no single effect lowers the cost of calibration by more than this, no pair is tried
ABOUT = 30.0  # cost above the best within which a candidate of fewer effects is preferred
FREE = 20.0  # factor on the tolerances that makes them as good as no prior, for a refit of all parameters


@dataclass(frozen=True)
class Candidate:
    """A fitted hypothesis."""

    fit: Fit

    @property
    def effects(self) -> tuple[str, ...]:
        return self.fit.hypothesis.effects

    @property
    def contradicted(self) -> tuple[str, ...]:
        """Effects whose fitted change contradicts the stated tolerance of their parameter."""
        return self.fit.hypothesis.contradicted(self.fit.u)

    @property
    def possible(self) -> bool:
        """Whether it may explain a gap: an effect alone may show that a tolerance is wrong, one of several may not."""
        return len(self.effects) == 1 or not self.contradicted

    @property
    def predictive(self) -> float:
        """Expected cost of further records of this kind: fitted cost plus twice the free parameters (Akaike 1974), as
        far as they are charged (`Fit.charged`).

        Forms of effects have priors; their freedom costs as by Laplace's method.
        """
        return self.fit.cost + 2.0 * float(self.fit.charged.sum()) + self.fit.occam


@dataclass(frozen=True)
class Attribution:
    """All fitted candidates of a campaign.

    Attributes:
        nominal: Cost of the unchanged nominal rig; inf where it touches down.
        candidates: Calibration alone first, then single effects and pairs.
        expected: Cost of the true model, twice the number of complex residuals.
        problem: The problem that was fitted.
    """

    nominal: float
    candidates: tuple[Candidate, ...]
    expected: float
    problem: Problem

    def of(self, *effects: str) -> Candidate | None:
        for candidate in self.candidates:
            if set(candidate.effects) == set(effects):
                return candidate
        return None

    def without(self, candidate: int, name: str) -> float:
        """Cost of the hypothesis of a candidate without one of its effects; inf where it was not fitted."""
        rest = [other for other in self.candidates[candidate].effects if other != name]
        found = self.of(*rest) if rest else self.calibration
        return np.inf if found is None else found.fit.cost

    @property
    def best(self) -> Candidate:
        """The candidate of the least predictive cost."""
        return min(self.candidates, key=lambda c: c.predictive)

    @property
    def simplest(self) -> Candidate:
        """The candidate with the fewest effects among those that are about as good as the best."""
        least = self.best.predictive
        near = [c for c in self.candidates if c.predictive < least + ABOUT]
        return min(near, key=lambda c: (len(c.effects), c.predictive))

    @property
    def calibration(self) -> Candidate:
        return self.candidates[0]

    @cached_property
    def refitted(self) -> Fit | None:
        """Every nominal parameter that has a tolerance, fitted without it."""
        base = self.calibration.fit
        if not np.isfinite(base.cost) or not base.hypothesis.tolerances:
            return None
        free = Hypothesis((), {name: FREE * sigma for name, sigma in base.hypothesis.tolerances.items()})
        fits = begin([free], [base.u / FREE], self.problem.data, self.problem.simulate)
        iterate(fits, self.problem.data, self.problem.simulate, 8)
        return fits[0]


def contradictions(attribution: Attribution, named: Collection[tuple[str, ...]] = ()) -> list[str]:
    """A sentence for each single effect that the rig excludes: where it is named alone all the same, or would explain
    more than all others and is no part of what is named."""
    allowed = min((c.predictive for c in attribution.candidates if not c.contradicted), default=np.inf)
    found = []
    for c in attribution.candidates:
        if len(c.effects) != 1 or not c.contradicted:
            continue
        (name,) = c.effects
        nominal = EFFECTS[name].nominal
        said = f"{name} {100 * c.fit.hypothesis.coordinates[0].value(float(c.fit.u[0])):+.3g} %"
        stated = f"{nominal} to within {100 * attribution.problem.parts[0].record.nominal.tolerance[nominal]:.2g} %"
        if c.effects in named:
            found.append(
                f"{said} contradicts the rig's file, which states {stated} ([tolerance]): measure and correct it"
            )
        elif c.predictive < allowed and not any(name in effects for effects in named):
            found.append(
                f"{said} would fit better than what is named, but the rig states {stated} ([tolerance]); if that is "
                "wrong, correct it"
            )
    return found


def best_partial(attribution: Attribution, probable: int | None, unnamed: Candidate | None = None) -> Candidate:
    """The best partial explanation: the most probable effects, or of a pair the one that explains about as much alone;
    calibration where none explains more than it.

    Args:
        attribution: The fitted candidates.
        probable: Index of the most probable candidate with effects; None or 0 where there is none.
        unnamed: What is not named although it may leave the least, such as a stated lag in another form beside an
            effect; it is taken where it leaves less than half. None: nothing is.
    """
    if probable:
        best = attribution.candidates[probable]
    else:
        best = min(attribution.candidates, key=lambda c: (bool(c.contradicted), c.predictive))
    # An effect beside it that explains next to nothing is no part of it.
    alone = [c for c in attribution.candidates if c.effects and {*c.effects} < {*best.effects}]
    best = min((c for c in alone if c.predictive < best.predictive + ABOUT), key=lambda c: c.predictive, default=best)
    # Nor is what saves little of what calibration leaves, however clearly: it takes up a bit of something else.
    least = max(NO_GAP, PART * attribution.calibration.fit.excess)
    best = best if best.predictive < attribution.calibration.predictive - least else attribution.calibration
    return best if unnamed is None or unnamed.fit.excess > 0.5 * best.fit.excess else unnamed
