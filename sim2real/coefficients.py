"""Coefficients of a rig that a fit of recordings identifies, with what their intervals must hold."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy import stats

from maglev_env.lane_values import shaped_law
from maglev_env.loop.effect import EFFECTS, effect_value
from maglev_env.loop.magnets.kinds import force_law
from maglev_env.loop.magnets.law import linearise
from maglev_env.rig.rig import Rig
from sim2real.compared.problem import Problem
from sim2real.judgement.nonstationary import widening
from sim2real.one_sided import bounded_spread
from sim2real.recorded.at_rest.static_evidence import can_rest, of_weight
from sim2real.recorded.open_record import OpenRecord
from sim2real.recorded.records import Record
from sim2real.search.fit import Fit
from sim2real.search.fitting import CONVERGED
from sim2real.search.valleys import CHANCE

# What is identified, each as an effect of this name, and its unit.
UNITS = {
    "actuator_gain": "N/A",
    "negative_stiffness": "N/m",
    "support_stiffness": "N/m",
    "damping": "N s/m",
    "delay": "s",
}
# Relative standard error from which a likelihood is no parabola, so that an interval by its curvature would be wrong;
# of damping and delay in `_natural`.
UNBOUNDED = 0.25
SIGNIFICANT = 3.0  # standard deviations of the misfit under noise alone
# A fit that tells the actuator's gain to no more than WEAK of it may as well have found a resonance of the noise.
WEAK = 0.1
# So may one from which the cost rises more slowly to another point than its curvature claims: by this factor in
# standard errors.
BENT = 1.5


@dataclass(frozen=True)
class Coefficient:
    """One identified coefficient.

    Attributes:
        name: As the rig or its effect is named.
        unit: SI.
        value: Identified.
        se: Its standard error, widened by the misfit.
        nominal: Value of the nominal rig.
        bounded: Whether the recordings, with the tolerances of all other parameters, bound it.
        at_limit: Whether the fit ended at the end of the range that it searches.
        most: Standard error from which it counts as not bounded.
    """

    name: str
    unit: str
    value: float
    se: float
    nominal: float
    bounded: bool
    at_limit: bool = False
    most: float = np.inf

    def with_error(self, se: float) -> "Coefficient":
        """The same with another standard error, which may leave it unbounded."""
        return replace(self, se=se, bounded=self.bounded and se < self.most)

    @property
    def identified(self) -> bool:
        """Whether the value is an estimate: bounded, and not where the search ends."""
        return self.bounded and not self.at_limit

    @property
    def interval(self) -> tuple[float, float]:
        """95 % interval; a time is not negative."""
        reach = float(stats.norm.isf(0.025)) * self.se
        least = 0.0 if self.unit == "s" else -np.inf
        return max(self.value - reach, least), self.value + reach

    @property
    def change(self) -> float | None:
        """Relative change against the nominal value; None where that is zero."""
        return (self.value - self.nominal) / abs(self.nominal) if self.nominal else None

    @property
    def apart(self) -> float:
        """Standard errors from the nominal value."""
        return (self.value - self.nominal) / self.se if self.se > 0 else 0.0


def least_spread(fit: Fit, other: Fit, chance: float = 0.0) -> np.ndarray:
    """Least standard errors (size,) of a fit's coordinates that its likelihood ratio to another point allows, less what
    the fit gains by chance.

    That ratio bounds the ratio to every value of one coordinate that the point has, so no coordinate is further from
    it, in standard errors, than its root; the curvature at the fit claims more where little is told. What a fit may
    lack to its optimum is added.
    """
    return np.abs(fit.u - other.u) / np.sqrt(max(other.cost - fit.cost - chance, 0.0) + CONVERGED)


def standard_errors(by_curvature: np.ndarray, fit: Fit, others: Sequence[Fit], chance: float = 0.0) -> np.ndarray:
    """Standard errors (size,) by the curvature at a fit, and no less than other points allow.

    Args:
        by_curvature: standard errors (size,).
        fit: the optimum.
        others: points of the same coordinates.
        chance: what the fit may gain by chance; CHANCE at least on points along which the cost is no parabola.
    """
    least = [by_curvature]
    for other in others:
        spread = least_spread(fit, other, chance)
        bent = (spread > BENT * by_curvature).any()
        least.append(least_spread(fit, other, max(chance, CHANCE)) if bent else spread)
    return np.maximum.reduce(least)


def overstated(fit: Fit, others: Sequence[Fit]) -> bool:
    """Whether the curvature at a fit claims more of the actuator's gain than other points allow."""
    at = [i for i, c in enumerate(fit.hypothesis.coordinates) if c.effect == "actuator_gain"]
    return bool((standard_errors(fit.spread, fit, others) > BENT * fit.spread)[at].any())


def misfit(fit: Fit) -> float:
    return float(np.mean(abs(fit.residual) ** 2) / 2)


def surplus(fit: Fit, share: float = 1.0) -> float:
    """The misfit of a fit to a share of its residual, where that is more than noise leaves; else 1."""
    lack = misfit(fit) / share
    return lack if lack > 1 + SIGNIFICANT / np.sqrt(share * fit.residual.size) else 1.0


def _of_mass(rig: Rig, fit: Fit) -> dict[str, tuple[int, float, float]]:
    """How gain and stiffness grow with a suspended mass that is known to a tolerance: coordinate of the mass, relative
    change for one unit of it, and power; nothing where the magnet carries no weight or the mass is exact."""
    if "mass" not in fit.hypothesis.calibrated or not can_rest(rig):
        return {}
    at = len(fit.hypothesis.coordinates) + fit.hypothesis.calibrated.index("mass")
    names = ("actuator_gain", "negative_stiffness")
    return {name: (at, fit.hypothesis.sigma("mass"), p) for name, p in zip(names, of_weight(rig), strict=True)}


def coefficients_of(
    rig: Rig, problem: Problem, fit: Fit, others: Sequence[Fit], share: float = 1.0
) -> tuple[Coefficient, ...]:
    """Coefficients of a fit to all of a problem, or to a share of it.

    Args:
        rig: the nominal one.
        problem: the problem.
        fit: its fit, with derivatives; of a share of the problem its residual and derivatives are zero elsewhere.
        others: points that its intervals must not exclude more than the likelihood does.
        share: that one.
    """
    h, factor = fit.hypothesis, np.sqrt(surplus(fit, share))
    by_curvature = bounded_spread(fit, fit.spread)
    sd = standard_errors(by_curvature, fit, others)
    by_chance = standard_errors(by_curvature, fit, others, CHANCE)
    if any(c.effect == "actuator_gain" and s * c.scale > WEAK for c, s in zip(h.coordinates, by_chance, strict=False)):
        sd = by_chance
    sd = sd * np.maximum(widening(problem, fit), factor)
    heavier, covariance = _of_mass(rig, fit), fit.covariance()
    found = []
    for c, u, spread in zip(fit.hypothesis.coordinates, fit.u, sd, strict=False):
        if c.effect not in UNITS:
            continue
        plain, scale = plain_coefficient(rig, c.effect), c.scale or 1.0
        relative = c.parameter == "change"
        size = abs(plain) if relative else 1.0
        change, se = c.value(float(u)) * size, float(spread) * scale * size
        most = UNBOUNDED * (size if relative else _natural(rig)[c.effect])
        value = plain + (change if plain >= 0 else -change) if relative else plain + change
        if c.effect in heavier:
            # A heavier suspended mass needs more pull, which has more gain and stiffness.
            at, sigma, power = heavier[c.effect]
            value *= (1 + float(fit.u[at]) * sigma) ** power
            own, more = np.copysign(scale * size, plain), value * power * sigma
            mixed = 2 * own * more * covariance[len(found), at] + more**2 * covariance[at, at]
            se = float(np.sqrt(max(se**2 + mixed, 0.0)))
        ended = c.value(float(u)) in (c.low, c.high) and c.low < 0
        nominal = nominal_coefficient(rig, c.effect)
        found.append(Coefficient(c.effect, UNITS[c.effect], value, se, nominal, se < most, ended, most))
    if any(c.name == "actuator_gain" and not c.bounded for c in found):
        # Of a force of unknown size nobody can say how late it comes, nor how much of it a damping takes.
        lost = {"delay"} if forced(part.record for part in problem.parts) else {"delay", "damping"}
        found = [replace(c, bounded=False) if c.name in lost else c for c in found]
    return tuple(found)


def _natural(rig: Rig) -> dict[str, float]:
    """Sizes of damping and delay beside which those of a rig are told or not: of a force of which a quarter of a radian
    is unknown at the frequency that mass and stiffness give, and of a damping of a quarter of the critical one."""
    stiffness = max(abs(rig.support_stiffness), abs(nominal_coefficient(rig, "negative_stiffness")))
    rate = np.sqrt(stiffness / rig.mass) if stiffness else np.inf
    return {"damping": 2 * rig.mass * rate, "delay": 1 / rate if np.isfinite(rate) else np.inf}


def forced(records: Iterable[Record | OpenRecord]) -> bool:
    """Whether a measured force moves the rotor in any recording."""
    return any(np.any(r.driven.get("force", False)) for r in records)


def nominal_coefficient(rig: Rig, name: str) -> float:
    """The value of the nominal rig with the effects that it has of its own; of two axes that state other values, their
    mean."""
    plain, own = plain_coefficient(rig, name), effect_value(rig.effects, name)
    return plain * (1 + own) if "change" in EFFECTS[name].parameters else plain + own


def plain_coefficient(rig: Rig, name: str) -> float:
    """As `nominal_coefficient`, without the rig's own effect of this name: that of a fit stands in its place, and its
    change refers to this value."""
    if rig.per_axis:
        return float(np.mean([plain_coefficient(own, name) for own in rig.by_axis]))
    if name in ("actuator_gain", "negative_stiffness"):
        if not rig.controlled:
            return 0.0
        bent = {of: values for of, values in rig.effects.items() if of == "force_law"}
        return float(linearise(shaped_law(force_law(rig), bent))[name == "negative_stiffness"])
    return {"support_stiffness": rig.support_stiffness, "damping": rig.support_damping, "delay": 0.0}[name]


def change_at(rig: Rig, c: Coefficient) -> float:
    """The change by which an effect makes a relative coefficient what it is, in place of the rig's own effect."""
    more, own = c.change * np.sign(c.nominal), effect_value(rig.effects, c.name)
    return own + more + own * more


def across_recordings(c: Coefficient, each: Sequence[Coefficient]) -> Coefficient:
    """A coefficient whose standard error is scaled by the Birge ratio of recordings that disagree.

    Distances count in standard errors of their own recording, so that one that tells little cannot undo what the
    others tell (R. T. Birge, Phys. Rev. 40, 1932; the scale factor of the Particle Data Group).

    Args:
        c: of all recordings.
        each: the same of every recording alone.
    """
    z = np.array([(own.value - c.value) / own.se for own in each if own.identified and own.se > 0])
    return c.with_error(c.se * float(np.sqrt(max(1.0, np.sum(z**2) / max(z.size - 1, 1)))))
