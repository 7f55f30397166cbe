"""What the identification experiment would show of a linear loop, for many gain sets at once."""

from dataclasses import dataclass

import numpy as np
import scipy

from estimation.gain_margin import gain_factors
from estimation.stability_margins import margin_arrays
from maglev_env.evaluation.goal_score import misses
from maglev_env.evaluation.requirements import LOOP, margins_below_lines
from maglev_env.experiment import Experiment, axis_experiment
from maglev_env.linear.between_lines import between_lines
from maglev_env.linear.loop import loop_response
from maglev_env.linear.poles import all_poles
from maglev_env.loop.gains import controller_response, of_axis, reads_current
from maglev_env.rig.excitation import lines_at
from maglev_env.rig.goal import Goal
from maglev_env.rig.rig import Rig, axis_rig
from maglev_env.task.task import Task
from tuning.study.recommendation import PEAK_SENSITIVITY

FINER = 5  # points between two lines at which a peak is sought
CREST = 3.0  # peak over rms of the displacement; what it is really, the correction finds
FEWEST = 8  # lines of a narrow band of the worst compliance: with fewer of them, all of the band are looked at
SURE = 0.97  # share of the gain at the lowest line that counts where less would leave margins below the lines
MOST_FORCED, MOST_FITTED = 60, 90  # force lines at which a search looks outside the target band, and a fit in all


@dataclass(frozen=True, eq=False)
class OpenLoop:
    """Responses of one axis of a rig with its loop open, at the lines of the experiment.

    Attributes:
        mass: kg.
        plant: (f + s,), from command to reading, m/A, at the force lines and then the injection lines.
        free: (f + s,), from force to reading, m/N.
        amplifier: (f + s,), from command to current, A/A.
    """

    mass: float
    plant: np.ndarray
    free: np.ndarray
    amplifier: np.ndarray


class LineModel:
    """One axis of a task's experiment: its lines, and the controllers of the box at them."""

    def __init__(self, task: Task, axis: int, goal: Goal | None) -> None:
        self.task, self.axis, self.goal = task, axis, goal
        rig, p = task.rig, task.rig.protocol
        e = axis_experiment(Experiment(rig, rig.gains, p.excitations, p.periods), axis)
        forced, injected = (lines_at(e.excitations, place) for place in ("force", "current"))
        n = e.samples_per_period
        force, injection = (2 / n * np.abs(np.fft.rfft(e.waveform(at))) for at in ("force", "current"))
        self.force, self.injection = force[forced], injection[injected]
        self.f, self.s = forced.size, injected.size
        self.forced, self.injected = forced * e.fundamental, injected * e.fundamental
        self.frequency = np.concatenate([self.forced, self.injected])
        self._z, self._dt = np.exp(2j * np.pi * self.frequency / rig.control_rate), 1 / rig.control_rate
        self._inner = reads_current(rig.gains, self._dt)
        self._noise, self._runs_away = rig.noise, axis_rig(rig, axis).runs_away
        self.bands = [(self.forced >= low) & (self.forced <= high) for low, high in task.layout.bands]
        low, high = rig.target.band
        self.band = (self.forced >= low) & (self.forced <= high)
        # A search needs the target's lines, and of the others as many as show the size of the motion.
        every = np.flatnonzero(~self.band)
        step = max(1, every.size // MOST_FORCED)
        self.few = np.sort(np.concatenate([np.flatnonzero(self.band), every[::step]]))
        self.weight = np.where(self.band, 1.0, step)
        asked = {r.name: r for r in goal.measured} if goal else {}
        low, high = asked["compliance"].band if "compliance" in asked else (0.0, np.inf)
        self.worst = (self.forced >= low) & (self.forced <= high)  # among which the goal's worst compliance is sought
        if self.worst[self.few].sum() < FEWEST:
            self.weight[np.setdiff1d(np.flatnonzero(self.worst), self.few)] = 0.0
            self.few = np.union1d(self.few, np.flatnonzero(self.worst))
        self.even = np.arange(0, self.f, max(1, self.f // MOST_FITTED))  # a fit needs lines in every band
        self._linear = self._basis()
        # A spline is linear in its values: those between the lines are a matrix times those at them.
        x = np.log(self.injected)
        grid = np.interp(np.arange(FINER * (self.s - 1) + 1) / FINER, np.arange(self.s), x)
        self._spline = scipy.interpolate.CubicSpline(x, np.eye(self.s), axis=-1)(grid)

    def open(self, rig: Rig) -> OpenLoop:
        """Responses of a rig."""
        e = axis_experiment(Experiment(rig, rig.gains, ()), self.axis)
        loop = loop_response(e, self.frequency)
        x = self.frequency / rig.control_rate
        # The model's force is held, while the hold of a measured one is removed.
        free = loop.receptance / loop.sensitivity / (np.sinc(x) * np.exp(-1j * np.pi * x))
        if self._inner:  # what the controller's own current loop makes of the reading is part of the controller here
            inner = 1 + self._controllers(e.gains, "current") * loop.amplifier
            return OpenLoop(axis_rig(rig, self.axis).mass, loop.plant / inner, free, loop.amplifier)
        return OpenLoop(axis_rig(rig, self.axis).mass, loop.plant, free, loop.amplifier)

    def responses(self, points: np.ndarray, at: np.ndarray) -> np.ndarray:
        """Controllers (m, lines) of points (m, k) at some of the lines."""
        values = self.task.box.gains(points)
        if self._linear is not None:
            constant, slopes = self._linear
            return constant[at] + values @ slopes[:, at]
        return np.array([self._one(v)[at] for v in values])

    def values(self, loop: OpenLoop, points: np.ndarray, whole: bool = False) -> dict[str, np.ndarray]:
        """Quantities (m,) that the experiment would show at points (m, k), by the names of its info.

        Args:
            loop: The open loop.
            points: The points.
            whole: Whether margins and bands, (m, b), are among them; with a goal its margins always are, and whether
                they lie below the lines.
        """
        few = self.even if whole else self.few
        at = np.concatenate([few, self.f + np.arange(self.s)])
        c = self.responses(points, at)
        loop_gain = c * loop.plant[at]
        s = 1 / (1 + loop_gain)
        n = few.size
        h, inside = s[:, :n] * loop.free[few], self.band[few]
        w, mass = 2 * np.pi * self.forced[few], loop.mass
        stiff = 1 / h
        power = 1 / (self._noise.force**2 + np.abs(stiff) ** 2 * self._noise.displacement**2 + 1e-30)
        real, imag = stiff.real + mass * w**2, stiff.imag
        found = dict(zip(("stiffness", "damping"), _coefficients(real, imag, power, w, inside), strict=True))
        sensitivity, lines = s[:, n:], self.f + np.arange(self.s)
        weight = self.f / few.size if whole else self.weight[few]
        force, injection = self.force[few] * np.sqrt(weight), self.injection
        put_in = np.abs(sensitivity * injection) ** 2
        moved = (np.abs(h * force) ** 2).sum(1) + (put_in * np.abs(loop.plant[lines]) ** 2).sum(1)
        sent = (np.abs(c[:, :n] * h * force) ** 2).sum(1) + put_in.sum(1)
        found["peak_displacement"], found["current_rms"] = CREST * np.sqrt(moved / 2), np.sqrt(sent / 2)
        if whole or self.goal:
            margins = margin_arrays(self.injected, sensitivity)
            found |= margins
            found["below_lines"] = self._runs_away & margins_below_lines(self.injected, sensitivity, margins, SURE)
            found["gain_margin"] = np.fmin(*gain_factors(self.injected, sensitivity, margins))
        else:
            found["peak_sensitivity"] = self._peak(loop_gain[:, n:])
        if whole:
            every = [_coefficients(real, imag, power, w, band[few]) for band in self.bands]
            found["band_stiffness"], found["band_damping"] = np.moveaxis(np.array(every), (0, 2), (2, 1))
        elif self.goal:
            found["compliance"] = np.abs(h[:, self.worst[few]]).max(axis=1)
        return found

    def _peak(self, loop_gain: np.ndarray) -> np.ndarray:
        """Largest |S| (m,) of loop gains (m, s), between the lines by a cubic spline."""
        square = (1 + loop_gain.real @ self._spline) ** 2 + (loop_gain.imag @ self._spline) ** 2
        at = np.clip(square.argmin(axis=1), 1, square.shape[1] - 2)
        before, least, after = (square[np.arange(len(square)), at + i] for i in (-1, 0, 1))
        bend = before - 2 * least + after
        drop = np.divide((before - after) ** 2, 8 * bend, out=np.zeros_like(least), where=bend > 0)
        return 1 / np.sqrt(np.maximum(np.minimum(np.minimum(before, after), least - drop), 0.3 * least))

    def sound(self, rig: Rig, points: np.ndarray) -> np.ndarray:
        """Whether the linear loops of points (m, k) are stable and keep between the lines what they show there, (m,).

        A loop whose resonance between the lines passes a limit of the goal, or that of what may be recommended, would
        have a score that it does not deserve, and would be refused.
        """
        values = self.task.box.gains(points)
        experiments = [Experiment(rig, self.task.box.applied(rig.gains, v), ()) for v in values]
        poles = all_poles(experiments)
        hidden = between_lines(experiments, poles, self.injected, self.axis)
        passed = hidden["peak_sensitivity"] > PEAK_SENSITIVITY
        for one in self.goal.requirements if self.goal else ():
            if one.name in LOOP:
                passed |= (misses(one, hidden[one.name]) > 0) & np.isfinite(hidden[one.name])
        return ~passed & (np.array([np.abs(own).max() for own in poles]) < 1)

    def _controllers(self, controller: object, of: str = "reading") -> np.ndarray:
        return controller_response(controller, self._z, self._dt, of)

    def _one(self, values: np.ndarray) -> np.ndarray:
        return self._controllers(of_axis(self.task.box.applied(self.task.rig.gains, values), self.axis))

    def _basis(self) -> tuple[np.ndarray, np.ndarray] | None:
        """Constant (lines,) and slopes (k, lines) of a controller that is linear in its gains; None for others."""
        box = self.task.box
        middle, ends = box.gains(np.zeros(len(box.names))), box.high - box.low
        try:
            at = self._one(middle)
            slopes = np.array([(self._one(middle + 0.1 * e) - at) / (0.1 * e.sum()) for e in np.diag(ends)])
            constant = at - middle @ slopes
            other = box.low + 0.3 * ends * np.linspace(0.5, 1, middle.size)
            linear = np.allclose(self._one(other), constant + other @ slopes, 1e-6, 0)
        except ValueError:
            return None
        return (constant, slopes) if linear else None


def _coefficients(
    real: np.ndarray, imag: np.ndarray, power: np.ndarray, w: np.ndarray, inside: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    p, w = power[:, inside], w[inside]
    stiffness = (p * real[:, inside]).sum(1) / p.sum(1)
    return stiffness, (p * w * imag[:, inside]).sum(1) / (p * w**2).sum(1)
