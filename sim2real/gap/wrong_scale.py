"""Would a recorded channel that reads too much or too little explain as much as what is found in the rig?

A force transducer that reads 6 % too little looks exactly like a probe that reads 6 % more beside a weaker actuator.
Its scale is told by the campaign where `scale_tolerance` states an error; where nothing is stated it counts as exact,
and the rig is blamed.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from maglev_env.loop.axes import suffixes
from sim2real.compared.point import Point
from sim2real.compared.problem import Problem
from sim2real.recorded.channel_errors import ChannelError
from sim2real.recorded.open_record import OpenRecord
from sim2real.recorded.records import Record
from sim2real.search.fit import Fit
from sim2real.search.fitting import begin, differentiate, iterate
from sim2real.search.hypotheses import Hypothesis

FORCE, CURRENT = "force", "current"  # whose scale nothing else tells; that of the displacement is an effect's name
GAINS = {"sensor_gain": "probe_gain", "actuator_gain": "actuator_gain"}  # effects, and what tolerances call them
ANY = 0.3  # relative standard deviation of a scale of which nothing is known
CLEAR = 3.0  # standard errors of the scale from which it is said
AS_WELL = 3.0  # cost by which it may explain less than what is found
STEPS = 6


@dataclass(frozen=True)
class WrongScale:
    """A scale of one channel, the same in all recordings, that explains as much as what is found.

    Attributes:
        channel: Its name.
        change: What its readings lack, relative to them: true = (1 + change) * reading.
        se: Standard error of the change.
    """

    channel: str
    change: float
    se: float

    @property
    def briefly(self) -> str:
        """The end of a sentence on it."""
        little = "little" if self.change > 0 else "much"
        return f"a {self.channel} that reads {100 * abs(self.change):.2g} % too {little} would explain as much"

    def in_words(self) -> str:
        """A sentence on it."""
        return (
            f"{self.briefly} ({100 * self.change:+.3g} +- {200 * self.se:.1g} %, 95 %; the recordings do not tell the "
            f"two apart): hold what measures the {self.channel} against a known one before anything is changed in the "
            "rig, and state how well it is known as scale_tolerance of the channel"
        )


def wrong_scale(problem: Problem, calibration: Fit, found_in_rig: Fit) -> WrongScale | None:
    """The channel whose scale alone explains most, if that is as much as what is found in the rig; None without one.

    Args:
        problem: The fitted recordings.
        calibration: A fit of them by calibration alone.
        found_in_rig: A fit of them by what is found, whose noise is that of recordings without a period.
    """
    records = [part.record for part in problem.parts]
    near, found = found_in_rig.hypothesis.point(found_in_rig.u), []

    def unknown(name: str) -> bool:  # nothing is stated of it
        return not any(e.name == f"scale of {name}" for r in records for e in r.errors)

    able = records[0].axes == 1 and records[0].nominal.controlled
    if able and unknown(FORCE) and any(np.any(r.driving(FORCE)) for r in records):
        found.append(_of_force(problem, calibration))
    for axis, suffix in enumerate(suffixes(records[0].axes)):
        if unknown(name := f"{CURRENT}{suffix}"):
            error = ChannelError(f"scale of {name}", CURRENT, axis, ANY)
            found.append(_freed(problem, records, calibration, error, near))
    best = min(filter(None, found), key=lambda pair: pair[0], default=None)
    return best[1] if best is not None and best[0] < found_in_rig.cost + AS_WELL else None


def _of_force(problem: Problem, calibration: Fit) -> tuple[float, WrongScale] | None:
    """Cost of calibration beside a force of any scale, and that scale; None where it is not told.

    A rotor that a larger force shakes moves more, and its magnets do as much as before: in the recordings that is a
    probe that reads more by a factor beside an actuator that does less by it.
    """
    h = calibration.hypothesis.instead(*GAINS)
    known = dict(zip(calibration.hypothesis.calibrated, calibration.u, strict=True))
    start = np.array([0.0] * len(h.coordinates) + [known[name] for name in h.calibrated])
    if (fit := _fitted(problem, h, start)) is None:
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
    return fit.cost + float(rest @ weight @ rest), WrongScale(FORCE, float(np.expm1(scale)), se * float(np.exp(scale)))


def _freed(
    problem: Problem, records: Sequence[Record | OpenRecord], calibration: Fit, error: ChannelError, near: Point
) -> tuple[float, WrongScale] | None:
    """Cost of calibration beside a channel of any scale, and that scale; None where no recording tells it."""
    own = [replace(r, errors=(*r.errors, error)) for r in records]
    freed = problem.again(near, records=own)
    if error.name not in freed.nuisances.names:
        return None
    if (fit := _fitted(freed, calibration.hypothesis, calibration.u)) is None:
        return None
    amount = freed.nuisances.amounts(fit.residual)[error.name]
    rows = np.array([freed.nuisances.amounts(row)[error.name] for row in fit.jacobian])
    se = float(np.sqrt(freed.nuisances.spread[error.name] ** 2 + rows @ fit.covariance() @ rows))
    if abs(amount) < CLEAR * se:
        return None
    # To first order the readings are that much of what they should be.
    return fit.cost, WrongScale(error.name.removeprefix("scale of "), 1 / (1 + ANY * amount) - 1, ANY * se)


def _fitted(problem: Problem, hypothesis: Hypothesis, start: np.ndarray) -> Fit | None:
    """A fit with its Jacobian; None where the rotor touches down."""
    (fit,) = begin([hypothesis], [start], problem.data, problem.simulate)
    iterate([fit], problem.data, problem.simulate, STEPS)
    if not np.isfinite(fit.cost):
        return None
    differentiate([fit], problem.data, problem.simulate, True)
    return fit
