"""Would a recorded channel that reads too much, too little or late explain as much as what is found in the rig?

A force transducer that reads 6 % too little looks exactly like a probe that reads 6 % more beside a weaker actuator. A
current behind a low-pass of its meter is late, and looks like a slower amplifier that the loop contradicts. Scale and
time are told by the campaign where `scale_tolerance` and `delay_tolerance` state an error; where nothing is stated they
count as exact, and the rig is blamed.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from maglev_env.loop.axes import suffixes
from sim2real.compared.point import Point
from sim2real.compared.problem import Problem
from sim2real.recorded.channel_errors import ChannelError, scale_of, time_of
from sim2real.recorded.open_record import OpenRecord
from sim2real.recorded.records import Record
from sim2real.search.fit import Fit
from sim2real.search.fitting import begin, differentiate, iterate
from sim2real.search.hypotheses import Hypothesis
from sim2real.words import quantity

FORCE, CURRENT = "force", "current"  # whose readings nothing else tells; scale and time of the displacement are effects
GAINS = {"sensor_gain": "probe_gain", "actuator_gain": "actuator_gain"}  # effects, and what tolerances call them
ANY = 0.3  # relative standard deviation of a scale of which nothing is known
LATE = 1.0  # the same of a time, in samples
CLEAR = 3.0  # standard errors of the scale or the time from which it is said
AS_WELL = 3.0  # cost by which it may explain less than what is found
NEARLY = 0.01  # or share of that by which it may explain less where it leaves no more than noise
BETTER = 30.0  # cost by which it explains more than anything in the rig
STEPS = 6


@dataclass(frozen=True)
class WrongReading:
    """A scale or a time of one channel, the same in all recordings, that explains as much as what is found.

    Attributes:
        channel: Its name.
        of_time: Whether it is the time; else the scale.
        change: What is to be added to its readings, relative to them: true = (1 + change) * reading. Of the time: by
            how much they are late, s.
        se: Standard error of the change.
        better: Whether it explains more than anything that is found in the rig.
    """

    channel: str
    of_time: bool
    change: float
    se: float
    better: bool = False

    @property
    def briefly(self) -> str:
        """The end of a sentence on it."""
        if self.of_time:
            reads = f"is read {quantity(abs(self.change), 0.0, 's')} {'late' if self.change > 0 else 'early'}"
        else:
            reads = f"reads {100 * abs(self.change):.2g} % too {'little' if self.change > 0 else 'much'}"
        much = "more than anything in the rig" if self.better else "as much"
        return f"a {self.channel} that {reads} would explain {much}"

    def in_words(self) -> str:
        """A sentence on it."""
        said, apart = self.briefly, "" if self.better else "; the recordings do not tell the two apart"
        if self.of_time:
            size = f"{1e6 * self.change:+.3g} +- {2e6 * self.se:.1g} us"
            do = "find out when that column is sampled and through which filter (a low-pass makes it late by its time "
            do += "constant) before anything is changed in the rig, and state delay and delay_tolerance of the channel"
        else:
            size = f"{100 * self.change:+.3g} +- {200 * self.se:.1g} %"
            do = f"hold what measures the {self.channel} against a known one before anything is changed in the rig, "
            do += "and state how well it is known as scale_tolerance of the channel"
        return f"{said} ({size}, 95 %{apart}): {do}"


def wrong_reading(problem: Problem, calibration: Fit, found_in_rig: Fit, noise: float) -> WrongReading | None:
    """The channel whose scale or time alone explains most, if that is as much as what is found in the rig; None without
    one.

    Args:
        problem: The fitted recordings.
        calibration: A fit of them by calibration alone.
        found_in_rig: A fit of them by what is found, whose noise is that of recordings without a period.
        noise: Cost that noise alone hardly exceeds.
    """
    records = [part.record for part in problem.parts]
    near, found = found_in_rig.hypothesis.point(found_in_rig.u), []
    stated = {e.name for record in records for e in record.errors}
    shaken = any(np.any(record.driving(FORCE)) for record in records)
    if records[0].axes == 1 and records[0].nominal.controlled and shaken and scale_of(FORCE) not in stated:
        found.append(_of_force(problem, calibration))
    late, timed = LATE * _sample(records), (CURRENT, FORCE) if shaken else (CURRENT,)
    for axis, suffix in enumerate(suffixes(records[0].axes)):
        errors = [ChannelError(scale_of(f"{CURRENT}{suffix}"), CURRENT, axis, scale=ANY)]
        errors += [ChannelError(time_of(f"{kind}{suffix}"), kind, axis, delay=late) for kind in timed]
        found += [_freed(problem, records, calibration, e, near) for e in errors if e.name not in stated]
    best = min(filter(None, found), key=lambda pair: pair[0], default=None)
    if best is None:
        return None
    cost, reading = best
    more = cost - found_in_rig.cost
    if more < -BETTER:
        return replace(reading, better=True)
    whole = cost < noise and more < NEARLY * (calibration.cost - found_in_rig.cost)
    # Where nothing is found in the rig, as under a tone, there is nothing that another reading would explain as well.
    return reading if found_in_rig.hypothesis.effects and (more < AS_WELL or whole) else None


def _sample(records: Sequence[Record | OpenRecord]) -> float:
    """The longest time between two samples of any recording, s."""
    rates = (r.windows.sample_rate if isinstance(r, OpenRecord) else r.experiment.recorded_rate for r in records)
    return 1 / min(rates)


def _of_force(problem: Problem, calibration: Fit) -> tuple[float, WrongReading] | None:
    """Cost of calibration beside a force of any scale, and that scale; None where it is not told.

    A rotor that a larger force shakes moves more, and its magnets do as much as before: in the recordings that is a
    probe that reads more by a factor beside an actuator that does less by it.
    """
    h = calibration.hypothesis.instead(*GAINS)
    known = dict(zip(calibration.hypothesis.calibrated, calibration.u, strict=True))
    start = np.array([0.0] * len(h.coordinates) + [known[name] for name in h.calibrated])
    if (fit := fitted(problem, h, start)) is None:
        return None
    own, scales = h.point(fit.u).effects, np.array([c.scale for c in h.coordinates])
    logs = np.log1p([own[c.effect]["change"] for c in h.coordinates])
    sign = np.array([1.0 if c.effect == "sensor_gain" else -1.0 for c in h.coordinates])
    stated = np.array([h.tolerances.get(GAINS[c.effect], 0.0) for c in h.coordinates])
    slopes = scales * np.exp(-logs)  # of the logarithms with the coordinates
    covariance = slopes[:, None] * fit.covariance()[:2, :2] * slopes + np.diag(stated**2)
    weight = np.linalg.inv(covariance)
    se = float((sign @ weight @ sign) ** -0.5)
    scale = float(se**2 * sign @ weight @ logs)
    rest = logs - scale * sign
    if abs(scale) < CLEAR * se:
        return None
    change = float(np.expm1(scale))
    return fit.cost + float(rest @ weight @ rest), WrongReading(FORCE, False, change, se * (1 + change))


def _freed(
    problem: Problem, records: Sequence[Record | OpenRecord], calibration: Fit, error: ChannelError, near: Point
) -> tuple[float, WrongReading] | None:
    """Cost of calibration beside a channel of any scale or time, and that; None where no recording tells it."""
    own = [replace(r, errors=(*r.errors, error)) for r in records]
    freed = problem.again(near, records=own)
    if error.name not in freed.nuisances.names:
        return None
    if (fit := fitted(freed, calibration.hypothesis, calibration.u)) is None:
        return None
    amount = freed.nuisances.amounts(fit.residual)[error.name]
    rows = np.array([freed.nuisances.amounts(row)[error.name] for row in fit.jacobian])
    se = float(np.sqrt(freed.nuisances.spread[error.name] ** 2 + rows @ fit.covariance() @ rows))
    if abs(amount) < CLEAR * se:
        return None
    channel = error.name.partition(" of ")[2]
    if error.delay:
        return fit.cost, WrongReading(channel, True, -error.delay * amount, error.delay * se)
    # To first order the readings are that much of what they should be.
    return fit.cost, WrongReading(channel, False, 1 / (1 + error.scale * amount) - 1, error.scale * se)


def fitted(problem: Problem, hypothesis: Hypothesis, *starts: np.ndarray) -> Fit | None:
    """The best fit from some starts, with its Jacobian; None where the rotor touches down."""
    fits = begin([hypothesis] * len(starts), list(starts), problem.data, problem.simulate)
    iterate(fits, problem.data, problem.simulate, STEPS)
    fit = min(fits, key=lambda f: f.cost)
    if not np.isfinite(fit.cost):
        return None
    differentiate([fit], problem.data, problem.simulate, True)
    return fit
