"""Would another gain of the stated controller explain more than anything that is found in the rig?

Where the command is recorded, it tells what the controller makes of the reading. Where it is not, a mistyped gain is in
everything that the loop does, and looks like no effect of the rig.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from maglev_env.loop.gains import NO_CONTROLLER, Controllers, gain_values, with_gains
from sim2real.compared.problem import Problem
from sim2real.gap.wrong_reading import BETTER, fitted
from sim2real.recorded.drive.other_gains import under_gains
from sim2real.recorded.open_record import OpenRecord
from sim2real.recorded.records import Record
from sim2real.search.fit import Fit
from sim2real.search.fitting import begin
from sim2real.search.following import Following
from sim2real.words import quantity

LOOK = 0.01  # relative change by which a gain's effect is found
MOST = 0.7  # relative change from which on it is no mistyped gain of this controller, either way
TRIED, PROMISED = 2, 0.2  # gains that promise most, which are fitted, and share of the gap that they must promise
STEPS, ENOUGH = 6, 0.1  # towards a gain; standard errors by which it may still change


@dataclass(frozen=True)
class WrongGain:
    """A gain by which the stated controller is not the one of the recordings.

    Attributes:
        gain: Its name.
        stated: As stated, by recording.
        factor: What is to be multiplied with.
        se: Standard error of the factor.
    """

    gain: str
    stated: Mapping[str, float]
    factor: float
    se: float

    @property
    def briefly(self) -> str:
        """The end of a sentence on it."""
        stated = sorted(set(self.stated.values()))
        if len(stated) == 1:
            value = quantity(self.factor * stated[0], 2 * self.se * stated[0], "")
            said = f"{self.gain} = {value} (95 %) in place of {stated[0]:g}"
        else:
            said = f"{self.gain} times {quantity(self.factor, 2 * self.se, '')} (95 %)"
        return f"a controller with {said} would explain more than anything in the rig"

    def in_words(self) -> str:
        """A sentence on it."""
        return (
            f"{self.briefly}: compare the gains with those in the controller's code, and record the command, which "
            "tells them exactly, before anything is changed in the rig"
        )


def wrong_gain(problem: Problem, calibration: Fit, found_in_rig: Fit) -> WrongGain | None:
    """The gain that explains clearly more than what is found in the rig, the same share wrong in all recordings; None
    without one.

    Args:
        problem: The fitted recordings.
        calibration: A fit of them by calibration alone.
        found_in_rig: A fit of them by what is found.
    """
    own = {r.name: r.experiment.gains for r in (part.record for part in problem.parts) if _under_stated(r)}
    if not own:
        return None
    common = set.intersection(*(set(_values(gains)) for gains in own.values()))
    steps = {name: _step(problem, calibration, name, 1.0) for name in sorted(common)}
    enough = calibration.cost - max(BETTER, PROMISED * calibration.excess)
    promising = sorted((step[2], name) for name, step in steps.items() if step is not None and step[2] < enough)
    best: tuple[float, WrongGain] | None = None
    for _, name in promising[:TRIED]:
        found = _sought(problem, calibration, name, steps[name])
        if found is not None and (best is None or found[0] < best[0]):
            cost, factor, se = found
            best = cost, WrongGain(name, {r: _values(gains)[name] for r, gains in own.items()}, factor, se)
    return best[1] if best is not None and best[0] < found_in_rig.cost - BETTER else None


def _under_stated(record: Record | OpenRecord) -> bool:
    """Whether the stated controller closes the simulated loop of a recording: it has one, and none stands in for it."""
    stood_in = isinstance(record, OpenRecord) and record.source is not None
    return record.experiment.gains != NO_CONTROLLER and not stood_in


def _values(gains: Controllers) -> dict[str, float]:
    """The gains of a controller, or of both axes where they are the same, that are not zero."""
    both = [gain_values(one) for one in (gains if isinstance(gains, tuple) else (gains,))]
    return {name: value for name, value in both[0].items() if value and all(one.get(name) == value for one in both)}


def _under(problem: Problem, fit: Fit, name: str, factor: float) -> Problem | None:
    """The same recordings under a controller with one gain times a factor; None where it cannot be that large."""
    records = []
    for record in (part.record for part in problem.parts):
        if not _under_stated(record):
            records.append(record)
            continue
        gains = record.experiment.gains
        try:
            changed = with_gains(gains, **{name: factor * _values(gains)[name]})
        except ValueError:
            return None
        if isinstance(record, OpenRecord):
            records.append(under_gains(record, changed))
        else:
            records.append(replace(record, experiment=replace(record.experiment, gains=changed)))
    return problem.again(fit.hypothesis.point(fit.u), records=records)


def _step(problem: Problem, fit: Fit, name: str, factor: float) -> tuple[float, float, float] | None:
    """Change of a gain's factor, its standard error and the cost, as predicted from a fit; None where the rotor touches
    down.

    Args:
        problem: As stated.
        fit: With its Jacobian, of the recordings under that factor.
        name: Of the gain.
        factor: By which it is multiplied.
    """
    if (under := _under(problem, fit, name, factor + LOOK)) is None:
        return None
    (moved,) = begin([fit.hypothesis], [fit.u], under.data, under.simulate)
    if not np.isfinite(moved.cost) or moved.residual.shape != fit.residual.shape:
        return None
    slope = (fit.residual - moved.residual)[None] / LOOK
    beside = Following(np.vstack([fit.jacobian, slope]), np.append(fit.prior, 0.0), np.append(fit.u, 0.0), fit.residual)
    return float(beside.step()[-1]), float(beside.solve[-1, -1] ** 0.5), fit.cost - beside.promised


def _sought(
    problem: Problem, calibration: Fit, name: str, first: tuple[float, float, float]
) -> tuple[float, float, float] | None:
    """Cost, factor and its standard error where calibration beside another gain fits best, from the first step towards
    it on; None where it is none."""
    factor, se, step = 1.0, np.inf, first
    fit: Fit | None = calibration
    for _ in range(STEPS):
        if step is None:
            return None
        change, se, _ = step
        factor = min(max(factor + change, 1 - MOST), 1 + MOST)
        if (under := _under(problem, fit, name, factor)) is None:
            return None
        # What took up the wrong gain need not lead back to the rig as it is stated.
        if (fit := fitted(under, fit.hypothesis, fit.u, np.zeros_like(fit.u))) is None:
            return None
        if abs(change) < ENOUGH * se:
            break
        step = _step(problem, fit, name, factor)
    return None if abs(abs(factor - 1) - MOST) < LOOK else (fit.cost, factor, se)
