"""Evidence of an actuator gain that drifts: of each recording with periods a trend over these, along its derivative; of
the others what a gain that grows with time would explain."""

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from scipy import stats

from sim2real.compared.problem import Part, Problem
from sim2real.compared.simulated import Point
from sim2real.judgement.dispersion import dispersion_of
from sim2real.recorded.open_record import OpenRecord
from sim2real.recorded.records import Record
from sim2real.recorded.wander import straightened
from sim2real.search.fitting import Fit, cost_of, inverse, reach, real_product

DRIFT = "drift"
LEAST = 4  # periods below which a trend cannot be told from noise
STEP = 0.01  # relative change of the gain, at the end of the longest recording if it grows, for its derivative
FALSE_ALARM = 1e-4
NEIGHBOURS = 15  # lines over which the noise beside the trend is pooled
CLEARLY = 5.0  # standard deviations by which trends must exceed what the gain explains to count as something else
OTHER = 0.3  # share of the trends that the gain's direction may leave, for its form and its derivative
ROUNDS = 3  # of weighing the recordings
FORM = 0.1  # relative error of the rate in one recording that a drift which is not steady may make


@dataclass(frozen=True)
class Drift:
    """A drift of the actuator gain.

    Attributes:
        rate: Relative change of the gain per second.
        se: Its standard error.
        chi2: What the trends of all recordings weigh.
        left: What one rate of the gain leaves of it.
        without_period: The part of chi2 that recordings without a period have.
    """

    rate: float
    se: float
    chi2: float
    left: float
    without_period: float = 0.0

    @property
    def parameters(self) -> Mapping[str, float]:
        """The parameters of the effect gain_drift."""
        return _rising(self.rate)


def drift_of(problem: Problem, fit: Fit) -> Drift | None:
    """The drift of the actuator gain that all recordings show; None if noise may make as much.

    Args:
        problem: the campaign.
        fit: the best known parameters, at which the gain is varied; recordings without a period say nothing if its
            Jacobian is not known.
    """
    point = fit.hypothesis.point(fit.u)
    rows = [row for part in problem.parts if (row := _slope(part, point))]
    without = _over_time(problem, fit, point)
    rows += [without] if without else []
    if not rows:
        return None
    rate, sd, beyond, scatter = (np.array(column) for column in zip(*rows, strict=True))
    chi2 = float(((rate / sd) ** 2).sum())
    if stats.chi2.sf(chi2, len(rate)) > FALSE_ALARM:
        return None
    mean = float((rate / sd**2).sum() / (1 / sd**2).sum())
    for _ in range(ROUNDS):  # a weight that grew less with each rate of its own would pull the mean to the least
        weight = 1 / (sd**2 + (FORM * mean) ** 2)
        mean = float((weight * rate).sum() / weight.sum())
    left = float((weight * (rate - mean) ** 2).sum())
    other = beyond - (rate / sd) ** 2  # trends in other directions, beyond what noise makes
    surely = (other > CLEARLY * scatter) & (other > OTHER * beyond)
    left += float(other[surely].sum())
    alone = without[2] if without else 0.0
    return Drift(mean, float(weight.sum() ** -0.5), chi2 + float(other[surely].sum()), left, alone)


def _slope(part: Part, point: Point) -> tuple[float, float, float, float] | None:
    """Relative change of the gain per second in one recording and its standard deviation, the chi-square of all trends
    beyond its expectation, and its scatter; None where nothing can be said."""
    record = part.record
    if isinstance(record, OpenRecord) or record.count < LEAST or not record.nominal.controlled:
        return None
    turned = _by_gain(part, point)
    if not np.isfinite(turned).all() or not turned.any():
        return None
    slopes, variance = trends(record, part)
    turned, slopes, variance = (v[..., part.used] for v in (turned, slopes, variance))
    precision = float((abs(turned) ** 2 / variance).sum())
    change = float((turned.conj() * slopes / variance).real.sum() / precision)  # relative, in a period
    chi2 = float((2 * abs(slopes) ** 2 / variance).sum()) - 2.0 * slopes.size
    per_second = record.experiment.fundamental
    return change * per_second, per_second / np.sqrt(2 * precision), max(chi2, 0.0), np.sqrt(4.0 * slopes.size)


def _over_time(problem: Problem, fit: Fit, point: Point) -> tuple[float, float, float, float] | None:
    """As `_slope`, of all recordings without a period together: what a gain that grows with time explains of the fit's
    residual where all parameters of the fit follow, to first order."""
    if fit.jacobian is None or not problem.parts[0].record.nominal.controlled:
        return None
    step = STEP / max(_duration(part.record) for part in problem.parts)
    change = _by_rate(problem, point, step) / step
    if not np.isfinite(change).all() or not change.any():
        return None
    free = _free(fit)
    jacobian = fit.jacobian[free]
    cross, follow = real_product(jacobian, change), inverse(fit.normal[np.ix_(free, free)])
    own = np.vdot(change, change).real - cross @ follow @ cross
    along = np.vdot(change, fit.residual).real - cross @ follow @ fit.gradient[free]
    # What the fit lacks has a share along any direction.
    spread = dispersion_of(problem, fit).fit.ratio(0.0)
    if own <= 0:
        return None
    rate, sd = float(along / own), float(np.sqrt(spread / own))
    return rate, sd, (rate / sd) ** 2, 0.0


def without_drift(problem: Problem, fit: Fit, rate: float) -> Fit:
    """A fit, to first order, with a gain that grows by `rate` (1/s) in the recordings without a period; the fit itself
    where that cannot be simulated or its Jacobian is not known."""
    change = _by_rate(problem, fit.hypothesis.point(fit.u), rate)
    if fit.jacobian is None or not np.isfinite(change).all() or not change.any():
        return fit
    free, residual = _free(fit), fit.residual - change
    jacobian = fit.jacobian[free]
    gradient = real_product(jacobian, residual) - fit.prior[free] * fit.u[free]
    moved = np.zeros_like(fit.u)
    moved[free] = inverse(fit.normal[np.ix_(free, free)]) @ gradient
    moved = (
        fit.hypothesis.bounded(fit.u + moved / np.max(abs(moved) / reach(fit.hypothesis, fit.u), initial=1.0)) - fit.u
    )
    residual = residual - moved @ fit.jacobian
    return replace(fit, u=fit.u + moved, residual=residual, cost=cost_of(residual, fit.u + moved, fit.prior))


def _free(fit: Fit) -> np.ndarray:
    """Coordinates that may follow, (size,) bool: all but those at an end of the range that a fit searches."""
    at_end = [c.at_bound(float(u)) for c, u in zip(fit.hypothesis.coordinates, fit.u, strict=False)]
    return np.array([not held for held in at_end] + [True] * len(fit.hypothesis.calibrated))


def _duration(record: Record | OpenRecord) -> float:
    """Of what is simulated of a recording, s."""
    return record.series["displacement"].shape[1] * record.experiment.rig.control_rate**-1 * getattr(record, "every", 1)


def _by_rate(problem: Problem, point: Point, rate: float) -> np.ndarray:
    """Change of the prediction (K,) of recordings without a period by a gain that grows at a rate, 1/s."""
    change = np.zeros(problem.data.size, complex)
    places = [part.place for part in problem.parts if isinstance(part.record, OpenRecord)]
    if places:
        rising = replace(point, effects={**point.effects, "gain_drift": _rising(rate)})
        steady, drifting = problem.simulate([point, rising])
        for place in places:
            change[place] = (drifting - steady)[place]
    return change


def _rising(rate: float) -> dict[str, float]:
    """The parameters of the effect gain_drift for a steady rate, 1/s."""
    return {"rate": rate}


def _by_gain(part: Part, point: Point) -> np.ndarray:
    """Derivative (outputs, axes, n) of the residuals with respect to a relative change of the actuator gain."""
    own = point.effects.get("actuator_gain", {}).get("change", 0.0)
    more = {**point.effects, "actuator_gain": {"change": own + STEP * (1 + own)}}
    here, there = part.predictor([point, replace(point, effects=more)])
    return (there - here) / STEP


def trends(record: Record, part: Part) -> tuple[np.ndarray, np.ndarray]:
    """Slopes (outputs, axes, n) of the residuals over periods, and the variance of their noise, E|n|^2."""
    periods = part.opened.residuals(record.periods["displacement"], record.periods.get("current"))
    slopes, rest = straightened(periods)
    at = np.arange(record.count) - (record.count - 1) / 2
    own = (abs(rest) ** 2).sum(axis=0) / (record.count - 2)
    kernel, inside = np.ones(2 * NEIGHBOURS + 1), slice(NEIGHBOURS, -NEIGHBOURS)  # also of fewer lines than that
    count = np.convolve(np.ones(own.shape[-1]), kernel)[inside]
    pooled = np.apply_along_axis(lambda v: np.convolve(v, kernel)[inside] / count, -1, own)
    return slopes, np.maximum(pooled, own / 4) / (at @ at)
