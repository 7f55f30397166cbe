"""The linear model's answer to a setting: loop, sensitivity, step of the load, stiffness and damping, and margins."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np

from estimation.lines.frequency_response import frequency_response
from estimation.lines.periods import LineStatistics
from estimation.max_likelihood import maximum_likelihood
from estimation.stability_margins import loop_gain, margin_arrays
from estimation.xy.planar import axis_statistics
from maglev_env.evaluation.known_chain import force_statistics, rotor_motion
from maglev_env.experiment import Experiment, axis_experiment
from maglev_env.linear.expected import expected_statistics
from maglev_env.linear.loop import loop_response
from maglev_env.linear.poles import pole_radii
from maglev_env.linear.step_load import step_load
from maglev_env.loop.axes import AXES
from maglev_env.rig.excitation import lines_at
from maglev_env.rig.rig import Rig, axis_rig

POINTS = 500  # of a curve over the whole frequency range
ROUGH, FINER = 0.3, 10  # Step of ln L from which so many points are put between two: the peak of a resonance is narrow.
TOP = 0.45  # of the control rate, the highest frequency shown
CYCLES = 6.0  # of the lowest target frequency, the length of the step shown


@dataclass(frozen=True)
class LoopCurves:
    """Curves of one axis in SI; what belongs to a closed loop is None where that is not stable.

    Args:
        frequency: (n,), Hz.
        loop_gain: complex (n,); on an x-y rig with the loop of the other axis closed.
        radius: of the largest closed-loop pole in the z-plane.
        sensitivity: complex (n,).
        margins: by name, as `margin_arrays`; nan where there is none.
        times: (t,), s.
        step: displacement after a step of the load, (t,), m/N.
        lines: (f,), frequencies of the force, Hz.
        stiffness: (f,), N/m.
        damping: (f,), N s/m.
        compliance: |displacement / force| of the loop, (f,), m/N.
        in_target: stiffness (N/m) and damping (N s/m) that fit best in the rig's target band.
    """

    frequency: np.ndarray
    loop_gain: np.ndarray
    radius: float
    sensitivity: np.ndarray | None = None
    margins: Mapping[str, float] | None = None
    times: np.ndarray | None = None
    step: np.ndarray | None = None
    lines: np.ndarray | None = None
    stiffness: np.ndarray | None = None
    damping: np.ndarray | None = None
    compliance: np.ndarray | None = None
    in_target: tuple[float, float] | None = None

    @property
    def stable(self) -> bool:
        return self.radius < 1


def loop_curves(experiment: Experiment, axis: int) -> LoopCurves:
    """The curves of one axis of an experiment on the linearised rig, without noise."""
    rig = experiment.rig
    frequency = _grid(min(1.0, rig.control_rate / 1e4), TOP * rig.control_rate)
    sensitivity, loop = _loop(experiment, frequency, axis)
    if (rough := np.flatnonzero(np.abs(np.log(loop[1:] / loop[:-1])) > ROUGH)).size:
        more = np.linspace(frequency[rough], frequency[rough + 1], FINER, endpoint=False)[1:]
        frequency = np.union1d(frequency, more)
        sensitivity, loop = _loop(experiment, frequency, axis)
    radius = float(pole_radii([experiment])[0])
    if radius >= 1:
        return LoopCurves(frequency, loop, radius)
    margins = {name: float(value) for name, value in margin_arrays(frequency, sensitivity).items()}
    times, step = step_load(experiment, CYCLES / rig.target.band[0] if rig.target.band else 0.1)
    found = LoopCurves(frequency, loop, radius, sensitivity, margins, times, step[:, axis, axis])
    return _with_coefficients(found, experiment, axis)


@lru_cache(maxsize=8)
def _grid(low: float, high: float) -> np.ndarray:
    return np.geomspace(low, high, POINTS)


def _loop(experiment: Experiment, frequency: np.ndarray, axis: int) -> tuple[np.ndarray, np.ndarray]:
    """Sensitivity and loop gain of one axis, complex (n,)."""
    response = loop_response(experiment, frequency)
    sensitivity = _of_axis(response.sensitivity, axis)
    return sensitivity, response.loop_gain if experiment.rig.axes == 1 else loop_gain(sensitivity)


def _of_axis(response: np.ndarray, axis: int) -> np.ndarray:
    return response if response.ndim == 1 else response[:, axis, axis]


def _with_coefficients(found: LoopCurves, experiment: Experiment, axis: int) -> LoopCurves:
    """The curves with stiffness and damping at the force lines, by the same chain as in `maglev estimate`."""
    rig = axis_rig(experiment.rig, axis)
    lines = lines_at(axis_experiment(experiment, axis).excitations, "force")
    if not lines.size:
        return found
    expected = expected_statistics(experiment, lines)
    closed, _ = frequency_response(loop_force(expected, experiment, axis), "displacement", "force")
    force = nominal_force(expected, experiment, axis)
    receptance, _ = frequency_response(force, "displacement", "force")
    stiffness, damping = coefficients(force.frequency, receptance, rig)
    fit = maximum_likelihood(force, np.array([rig.target.band]), rig.mass, intervals=False)
    in_target = float(fit.stiffness[0]), float(fit.damping[0])
    coefficient = {"stiffness": stiffness, "damping": damping, "in_target": in_target}
    return replace(found, lines=force.frequency, compliance=np.abs(closed), **coefficient)


def loop_force(statistics: LineStatistics, experiment: Experiment, axis: int) -> LineStatistics:
    """The force lines of one axis, without the hold of the force."""
    if experiment.rig.axes == 2:
        statistics = axis_statistics(statistics, AXES[axis])
    return force_statistics(statistics, axis_experiment(experiment, axis))


def nominal_force(statistics: LineStatistics, experiment: Experiment, axis: int) -> LineStatistics:
    """The force lines of one axis, without the hold of the force and without the lag of the nominal probe."""
    return rotor_motion(loop_force(statistics, experiment, axis), axis_rig(experiment.rig, axis))


def coefficients(frequency: np.ndarray, receptance: np.ndarray, rig: Rig) -> tuple[np.ndarray, np.ndarray]:
    """Stiffness (N/m) and damping (N s/m) at each frequency (Hz) from a receptance (m/N) and the rig's mass."""
    omega = 2 * np.pi * frequency
    dynamic = 1 / receptance
    return dynamic.real + rig.mass * omega**2, dynamic.imag / omega
