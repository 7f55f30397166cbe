"""Evidence of an actuator gain that drifts over the periods of recordings: of each a trend along its derivative.

Recordings without a period are simulated with the drift, which is an effect like any other there.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import ceil, log

import numpy as np
from scipy import stats

from estimation.lines.periods import from_middle, straightened
from maglev_env.linear.poles import closed_loop_poles
from maglev_env.loop.effect import EFFECTS
from sim2real.compared.point import Point
from sim2real.compared.problem import Part, Problem
from sim2real.compared.simulated import SETTLED, experiment_near
from sim2real.compared.whole_gain import GAIN, times_gain, with_more_gain
from sim2real.recorded.drifting import DRIFTING, middle
from sim2real.recorded.open_record import OpenRecord
from sim2real.recorded.opened import noise_about_trends
from sim2real.recorded.records import Record
from sim2real.recorded.wander import LEAST

DRIFT = "drift"
STEP = 0.01  # relative change of the gain for its derivative
FALSE_ALARM = 1e-4
CLEARLY = 5.0  # standard deviations by which trends must exceed what the gain explains to count as something else
OTHER = 0.3  # share of the trends that the gain's direction may leave, for its form and its derivative
ROUNDS = 3  # of weighing the recordings
LEAST_GAIN, MOST_GAIN = 0.5, 2.0  # shares of the mean gain with which a drift may begin
# Relative error of the rate in one recording that a drift which is not steady may make: what warms up drifts half as
# fast again in the first four of its periods as in the second to the fourth.
FORM = 0.3


@dataclass(frozen=True)
class Drift:
    """What the periods of all recordings say of a drift of the actuator gain.

    Attributes:
        rate: Relative change of the gain per second.
        se: Its standard error.
        chi2: What the trends of all recordings weigh.
        left: What one rate of the gain leaves of it.
        shown: Whether noise alone would hardly make such trends.
    """

    rate: float
    se: float
    chi2: float
    left: float
    shown: bool

    def against(self, rate: float, sd: float) -> float:
        """Cost of another rate, told with a standard error, beyond that of none where no drift is shown.

        Args:
            rate: Mean over the periods, 1/s.
            sd: Its standard error.
        """
        apart = (rate - self.rate) ** 2 / (sd**2 + self.se**2 + (FORM * rate) ** 2)
        return apart if self.shown else apart - (self.rate / self.se) ** 2


def drift_of(problem: Problem, point: Point) -> Drift | None:
    """What recordings with periods say of a drift of the gain; None if there are too few periods.

    Args:
        problem: the campaign.
        point: the best known parameters, at which the gain is varied.
    """
    rows = [row for part in problem.parts if (row := _slope(part, point))]
    if not rows:
        return None
    rate, sd, beyond, scatter, freedom = (np.array(column) for column in zip(*rows, strict=True))
    chi2 = float(((rate / sd) ** 2).sum())
    mean = float((rate / sd**2).sum() / (1 / sd**2).sum())
    for _ in range(ROUNDS):  # a weight that grew less with each rate of its own would pull the mean to the least
        weight = 1 / (sd**2 + (FORM * mean) ** 2)
        mean = float((weight * rate).sum() / weight.sum())
    left = float((weight * (rate - mean) ** 2).sum())
    other = beyond - (rate / sd) ** 2  # trends in other directions, beyond what noise makes
    surely = (other > CLEARLY * scatter) & (other > OTHER * beyond)
    left += float(other[surely].sum())
    # The noise is told from few periods and lines, which makes large values less rare.
    shown = bool(stats.f.sf(chi2 / len(rate), len(rate), freedom.sum()) <= FALSE_ALARM)
    return Drift(mean, float(weight.sum() ** -0.5), chi2 + float(other[surely].sum()), left, shown)


def with_drift(point: Point, rate: float, records: Sequence[Record | OpenRecord]) -> Point:
    """The point with a drift of the gain whose mean is the gain that a fit without a drift has found.

    That is the gain in the middle of the recordings, the rate is relative to it, and the drift begins with each
    recording.

    Args:
        point: As it was fitted, without a drift.
        rate: Relative change of the gain per second.
        records: The recordings in which it was fitted.
    """
    begins = min(max(1 - rate * float(np.mean([_middle(r) for r in records])), LEAST_GAIN), MOST_GAIN)
    if GAIN in point.effects:
        found = times_gain(records[0].experiment, point, begins)
    else:  # the rig's own gain, within its tolerance or not
        whole = begins * (1 + point.changes.get(GAIN, 0.0))
        found = replace(point, changes={**point.changes, GAIN: whole - 1})
    bounds = EFFECTS[DRIFTING].parameters["rate"]
    within = min(max(rate / begins, bounds.low), bounds.high)
    return replace(found, effects={**found.effects, DRIFTING: {"rate": within}})


def _middle(record: Record | OpenRecord) -> float:
    """Middle of what is compared, s after the begin."""
    if isinstance(record, OpenRecord):
        return (record.first + 0.5 * record.windows.samples) / record.windows.sample_rate
    return middle(record)


def _slope(part: Part, point: Point) -> tuple[float, float, float, float, float] | None:
    """Relative change of the gain per second in one recording and its standard deviation, the chi-square of all trends
    beyond its expectation, its scatter, and the degrees of freedom of the noise; None where nothing can be said."""
    record = part.record
    if isinstance(record, OpenRecord) or record.count < LEAST or not record.nominal.controlled:
        return None
    # What rings on has a slope on all lines. Along the derivative by the gain alone, there is hardly any of it.
    may_ring = record.count - (ringing := _ringing(record, point)) < LEAST
    turned = _by_gain(part, point)
    if not np.isfinite(turned).all() or not turned.any():
        return None
    first = 0 if may_ring else ringing
    slopes, variance = trends(record, part, first)
    turned, slopes, variance = (v[..., part.used] for v in (turned, slopes, variance))
    precision = float((abs(turned) ** 2 / variance).sum())
    change = float((turned.conj() * slopes / variance).real.sum() / precision)  # relative, in a period
    chi2 = max(float((2 * abs(slopes) ** 2 / variance).sum()) - 2.0 * slopes.size, 0.0)
    scatter, along = float(np.sqrt(4.0 * slopes.size)), 2 * precision * change**2
    if may_ring and (chi2 < CLEARLY * scatter or along < (1 - OTHER) * chi2):
        return None
    per_second = record.experiment.fundamental
    freedom = 2.0 * (record.count - first - 2) * slopes.size  # of a complex line about a straight line
    return change * per_second, per_second / float(np.sqrt(2 * precision)), chi2, scatter, freedom


def _ringing(record: Record, point: Point) -> int:
    """How many of the periods that are kept a transient of the loop may still reach, at a point.

    A loop that is slower than the nominal one rings on where a nominal one is steady, and that is a trend, too.
    """
    e = record.experiment
    radius = abs(closed_loop_poles(experiment_near(record, point))).max()
    if not SETTLED < radius < 1:
        return 0
    return max(ceil(log(SETTLED) / log(radius) / e.samples_per_period) - record.dropped, 0)


def _by_gain(part: Part, point: Point) -> np.ndarray:
    """Derivative (outputs, axes, n) of the residuals with respect to a relative change of the actuator gain."""
    more, change = with_more_gain(part.record.experiment, point, STEP)
    here, there = part.predictor([point, more])
    return (there - here) / change


def trends(record: Record, part: Part, first: int = 0) -> tuple[np.ndarray, np.ndarray]:
    """Slopes (outputs, axes, n) of the residuals over the periods from one on, and the variance of their noise,
    E|n|^2."""
    periods = part.opened.residuals(record.periods["displacement"], record.periods.get("current"))[first:]
    slopes, _ = straightened(periods)
    at = from_middle(len(periods))
    return slopes, noise_about_trends(record, part.opened, first) / (at @ at)
