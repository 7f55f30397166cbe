"""A gain of any block that changes over the record: the trend of its periods, along the derivative by that gain."""

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from scipy import stats

from maglev_env.loop.effect import EFFECTS, meaningful
from maglev_env.loop.free.places import REMEMBERING
from sim2real.compared.drift import FALSE_ALARM, LEAST, trends
from sim2real.compared.point import Point
from sim2real.compared.problem import Part, Problem
from sim2real.free.share import share_closed
from sim2real.gap.leftover_words import NORMAL_95
from sim2real.recorded.open_record import OpenRecord
from sim2real.words import percent, quantity

STEP = 0.01  # relative change of a gain for its derivative; of a stiffness, share of the nominal one of the magnets
# Share of the trends of what no fit has seen that must be closed, and the lower end of its 95 % interval. It is much,
# because what a simulation lacks leaves trends of its own where a record still settles.
HELD, SURELY = 0.5, 0.4
WORDS = {
    "free_command": "the amplifier's gain",
    "free_current": "the actuator's gain",
    "free_spring": "the stiffness",
    "free_reading": "the probe's gain",
}


@dataclass(frozen=True)
class Trend:
    """A gain that changes evenly with time.

    Attributes:
        place: Where, a key of WORDS.
        rate: Relative change per second; of the stiffness N/m per second.
        se: Its standard error.
        span: Length of the longest recording, s.
        closes: Share that it closes of the trends of recordings that no fit has seen.
        closes_ci: Its 95 % interval.
    """

    place: str
    rate: float
    se: float
    span: float
    closes: float
    closes_ci: tuple[float, float]

    @property
    def block(self) -> str:
        return EFFECTS[self.place].block

    def in_words(self) -> str:
        """ "over time: the probe's gain falls by 8.1 +- 0.6 % (95 %) in 1 s of a recording"."""
        change, se = self.rate * self.span, NORMAL_95 * self.se * self.span
        size = quantity(abs(change), se, "N/m") if self.place == "free_spring" else quantity(change, se, "", True)
        way = "falls" if self.rate < 0 else "grows"
        lo, hi = self.closes_ci
        return (
            f"over time: {WORDS[self.place]} {way} by {size.lstrip('+-')} (95 %) in {self.span:.3g} s of a recording, "
            f"which closes {percent(min(max(self.closes, 0.0), 1.0))} (95 %: {100 * lo:.0f} .. "
            f"{100 * min(hi, 1.0):.0f}) of the trends of what no fit has seen"
        )

    def to_json(self) -> dict[str, Any]:
        return {**asdict(self), "block": self.block, "in_words": self.in_words()}

    def added_to(self, point: Point) -> Point:
        """A point with the effect of this trend, a gain that changes over the record."""
        defaults = {key: p.default or 0.0 for key, p in EFFECTS[self.place].parameters.items()}
        own: Mapping[str, float] = point.effects.get(self.place, {**defaults, "range": 1.0})
        return Point({**point.effects, self.place: {**own, "rate": self.rate}}, point.changes, point.dithered)


@dataclass(frozen=True)
class _Row:
    """Trends of one recording: slopes per second and derivatives by each gain, in units of the noise, (n,).

    A gain with which the rotor touches down has no derivative.
    """

    slopes: np.ndarray
    by: Mapping[str, np.ndarray]


def trend_of(problem: Problem, judged: Problem, point: Point, seed: int) -> Trend | None:
    """The gain whose change over time explains most of the trends; None where there are none, or it does not hold.

    The trends of the lines are taken for proportional to the change. A loop of another gain answers otherwise, so a
    gain that has changed by a tenth when the recording ends is told a quarter too large or too small where the point
    has the gain of its beginning, and a tenth where it has that of its middle.

    Args:
        problem: The recordings that were fitted; those without a period say nothing here.
        judged: The recordings that judge.
        point: The best known parameters.
        seed: Of the interval.
    """
    rows = [row for part in problem.parts if (row := _row(part, point))]
    if not rows:
        return None
    slopes = np.concatenate([row.slopes for row in rows])
    if stats.chi2.sf(float(np.sum(abs(slopes) ** 2)), 2 * slopes.size) > FALSE_ALARM:
        return None
    held = [row for part in judged.parts if (row := _row(part, point))]
    if not held:
        return None
    found = {}
    for place in (name for name in rows[0].by if all(name in row.by for row in (*rows, *held))):
        by = np.concatenate([row.by[place] for row in rows])
        weight = float(np.sum(abs(by) ** 2))
        if weight > 0:
            rate = float(np.sum((by.conj() * slopes).real) / weight)
            found[place] = rate**2 * weight, rate, weight**-0.5
    if not found:
        return None
    place = max(found, key=lambda name: found[name][0])
    _, rate, se = found[place]
    before = np.concatenate([row.slopes for row in held])
    closes, ends = share_closed(before, before - rate * np.concatenate([row.by[place] for row in held]), seed)
    if closes is None or ends is None or closes < HELD or ends[0] < SURELY:
        return None
    span = max(p.record.count / p.record.experiment.fundamental for p in problem.parts if _periodic(p))
    return Trend(place, rate, se, float(span), closes, ends)


def _periodic(part: Part) -> bool:
    return not isinstance(part.record, OpenRecord) and part.record.count >= LEAST


def _row(part: Part, point: Point) -> _Row | None:
    if not _periodic(part):
        return None
    record = part.record
    places = [name for name in REMEMBERING if meaningful(name, record.nominal.capabilities)]
    steps = {name: STEP * (abs(record.nominal.negative_stiffness or 0.0) or 1e4 if name == "free_spring" else 1.0)
             for name in places}  # fmt: skip
    moved = []
    for name, step in steps.items():
        own = {key: p.default or 0.0 for key, p in EFFECTS[name].parameters.items()} | {"range": 1.0}
        own |= dict(point.effects.get(name, {}))
        moved.append(Point({**point.effects, name: {**own, "direct": own["direct"] + step}}, point.changes))
    here, *there = part.predictor([point, *moved])
    if not np.isfinite(here).all():
        return None
    slopes, variance = trends(record, part)
    white = np.sqrt(2 / variance[..., part.used]).ravel()
    by = {
        name: ((one - here)[..., part.used] / step).ravel() * white / record.experiment.fundamental
        for (name, step), one in zip(steps.items(), there, strict=True)
        if np.isfinite(one).all()
    }
    return _Row(slopes[..., part.used].ravel() * white, by)
