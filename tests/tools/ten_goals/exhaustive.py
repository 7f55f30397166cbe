"""What the linear loop of a rig reaches at many gain sets at once, by formulas that the tuner has no part in.

The plant is the exact sampled one of the rig with its effects (`maglev_env.linear.open_loop`); controller, margins,
coefficients, noise and events are computed here. What only a large motion shows, lift-off, is left to the experiments.
"""

from dataclasses import dataclass

import numba
import numpy as np
import scipy

from maglev_env.experiment import Experiment, axis_experiment
from maglev_env.linear.expected import reading_noise
from maglev_env.linear.open_loop import open_loop
from maglev_env.loop.gains import of_axis
from maglev_env.rig.excitation import lines_at
from maglev_env.rig.goal import QUANTITIES, Goal

GRID = 500  # frequencies at which margins are looked at
LIGHT, WIDE = 0.1, 0.3  # damping ratio below which a pole is looked at closely, and how far to either side
CHUNK = 400
SLACK = 0.3  # logarithm by which a set may miss what its responses show, and its events are still simulated
SURE = 0.97  # share of the gain at the lowest line that counts where less would leave margins below the lines
HOVER = 4.0  # crest of the noise in a peak current


@numba.njit(cache=True)
def _run(a, b, rows, steps, impulse):
    """Outputs (m, rows, steps) of x' = a x from an input b at the first sample, or at every one; x (n,) at rest."""
    m, n = a.shape[0], a.shape[1]
    out = np.zeros((m, rows.shape[1], steps))
    for i in range(m):
        x, fresh = b[i].copy(), np.zeros(n)
        for t in range(steps):
            for k in range(rows.shape[1]):
                for j in range(n):
                    out[i, k, t] += rows[i, k, j] * x[j]
            for k in range(n):
                fresh[k] = 0.0 if impulse else b[i, k]
                for j in range(n):
                    fresh[k] += a[i, k, j] * x[j]
            x[:] = fresh
    return out


@dataclass(frozen=True, eq=False)
class Axis:
    """One axis of an experiment with its loop open; `values` closes it by gains (m, 3): kp, ki, kd."""

    experiment: Experiment
    goal: Goal

    def __post_init__(self):
        e, rig = self.experiment, self.experiment.rig
        plant = open_loop(e)
        own = of_axis(rig.gains, 0)
        forced, injected = (lines_at(e.excitations, at) for at in ("force", "current"))
        n = e.samples_per_period
        force, injection = (2 / n * np.abs(np.fft.rfft(e.waveform(at))) for at in ("force", "current"))
        at = injected * e.fundamental
        grid = np.unique(np.concatenate([at, np.geomspace(at[0], at[-1], GRID)]))
        poles = np.log(np.linalg.eigvals(plant.a).astype(complex) + 1e-300) / plant.dt
        for pole in poles[(poles.imag > 0) & (np.abs(poles.real) < LIGHT * np.abs(poles))]:
            near = np.linspace(1 - WIDE, 1 + WIDE, GRID) * abs(pole) / (2 * np.pi)
            grid = np.union1d(grid, near[(near > at[0]) & (near < at[-1])])
        f = np.concatenate([forced * e.fundamental, at, grid])
        parts = np.cumsum([forced.size, injected.size])
        z = np.exp(2j * np.pi * f * plant.dt)
        inputs = np.concatenate([plant.command, plant.force], axis=1)
        rows = np.concatenate([plant.reading, plant.current])
        solved = rows @ np.linalg.solve(z[:, None, None] * np.eye(len(plant.a)) - plant.a, inputs)
        low, held = (
            (1 - np.exp(-plant.dt / t)) / (z - np.exp(-plant.dt / t)) for t in (own.td, own.ti)
        )  # fmt: skip
        still = np.exp(2j * np.pi * 1e-9 * plant.dt)
        rest = (plant.reading @ np.linalg.solve(still * np.eye(len(plant.a)) - plant.a, plant.command))[0, 0].real
        vars(self).update(
            plant=plant, own=own, f=f, parts=parts, force=force[forced], injection=injection[injected],
            p=solved[:, 0, 0], free=solved[:, 0, 1], amplifier=solved[:, 1, 0] + plant.jump[0, 0], low=low, held=held,
            hold=np.sinc(f / rig.control_rate), rest=rest,
            runs_away=np.abs(np.linalg.eigvals(plant.a)).max() > 1 + 1e-9, noise=reading_noise(rig),
        )  # fmt: skip

    def closed(self, gains):
        """The closed loop (m, n, n) of gains (m, 3), and rows of reading and current, (m, 2, n)."""
        plant, own, (kp, ki, kd) = self.plant, self.own, gains.T
        n, m = len(plant.a), len(gains)
        a = np.zeros((m, n + 2, n + 2))
        read = -plant.reading[0]
        a[:, :n, :n] = plant.a
        for k, t in ((n, own.td), (n + 1, own.ti)):
            a[:, k, k] = np.exp(-plant.dt / t)
            a[:, k, :n] = (1 - np.exp(-plant.dt / t)) * read
        command = np.zeros((m, n + 2))
        command[:, :n] = (kp + kd / own.td)[:, None] * read
        command[:, n], command[:, n + 1] = -kd / own.td, ki
        a[:, :n] += plant.command[:, 0][None, :, None] * command[:, None, :]
        rows = np.zeros((m, 2, n + 2))
        rows[:, 0, :n], rows[:, 1, :n] = plant.reading[0], plant.current[0]
        rows[:, 1] += plant.jump[0, 0] * command
        return a, rows

    def values(self, gains):
        """Quantities (m,) by name of gains (m, 3); nan where the loop is unstable."""
        parts = [self._values(gains[i : i + CHUNK]) for i in range(0, len(gains), CHUNK)]
        return {name: np.concatenate([one[name] for one in parts]) for name in parts[0]}

    def _values(self, gains):
        a, rows = self.closed(gains)
        holds = np.abs(np.linalg.eigvals(a)).max(axis=1) < 1
        kp, ki, kd = (v[:, None] for v in gains.T)
        c = kp + kd / self.own.td * (1 - self.low) + ki * self.held
        loop = c * self.p
        s = 1 / (1 + loop)
        end, begin = self.parts
        f, rig = self.f, self.experiment.rig
        found = self._margins(loop[:, begin:], s[:, begin:], gains)
        h = (s * self.free)[:, :end] / self.hold[:end]
        # The middle of a held force lies half a sample later.
        h = h * np.exp(1j * np.pi * f[:end] / rig.control_rate)
        low, high = rig.target.band
        inside, w = (f[:end] >= low) & (f[:end] <= high), 2 * np.pi * f[:end]
        stiff, w = 1 / h[:, inside], w[inside]
        weight = np.abs(h[:, inside]) ** 2 / (self.noise**2 + np.abs(h[:, inside]) ** 2 * rig.noise.force**2)
        found["stiffness"] = (weight * (stiff.real + rig.mass * w**2)).sum(1) / weight.sum(1)
        found["damping"] = (weight * w * stiff.imag).sum(1) / (weight * w**2).sum(1)
        asked = {r.name: r for r in self.goal.measured}
        low, high = asked["compliance"].band if "compliance" in asked else (0.0, np.inf)
        among = (f[:end] >= low) & (f[:end] <= high)
        found["compliance"] = np.abs(h[:, among]).max(axis=1)
        sent = ((np.abs((c * s * self.free * self.amplifier)[:, :end]) * self.force) ** 2).sum(1)
        sent += ((np.abs((s * self.amplifier)[:, end:begin]) * self.injection) ** 2).sum(1)
        found["current_rms"] = np.sqrt(sent / 2)
        found = {name: np.where(holds, value, np.nan) for name, value in found.items()}
        found |= self._events(gains, a, rows, holds, found)
        return found

    def _margins(self, loop, s, gains):
        size, angle = np.maximum(np.abs(loop), 1e-12), np.degrees(np.abs(np.angle(-loop)))
        crosses = np.diff(np.sign(np.log(size))) != 0
        share = np.abs(np.log(size[:, :-1])) / np.maximum(np.abs(np.diff(np.log(size))), 1e-12)
        between = angle[:, :-1] + share * np.diff(angle)
        phase = np.where(crosses, between, 180.0).min(axis=1)
        real = (np.diff(np.sign(loop.imag)) != 0) & (loop.real[:, :-1] < 0)
        share = np.abs(loop.imag[:, :-1]) / np.maximum(np.abs(np.diff(loop.imag)), 1e-300)
        at = np.maximum(np.abs(loop.real[:, :-1] + share * np.diff(loop.real)), 1e-9)
        gain = np.where(real, np.maximum(at, 1 / at), np.inf).min(axis=1)
        found = {
            "peak_sensitivity": np.abs(s).max(axis=1), "phase_margin": phase, "gain_margin": gain,
            "disk_margin": 1 / np.abs(s - 0.5).max(axis=1),
        }  # fmt: skip
        if self.runs_away:
            still = np.abs(self.rest) * (gains[:, 0] + gains[:, 1])
            found["gain_margin"] = np.where(still > 1, np.minimum(gain, still), 1.0)
            # Where the lowest line shows too little gain, margins count as missed (docs/goals.md).
            first = SURE * loop[:, 0]
            falls = ((real & (at > 1)).any(axis=1)) | (
                (first.real < -1) & (np.abs(first.imag) < np.tan(np.pi / 6) * np.abs(first.real))
            )
            below = (np.abs(first) < 1) | (~falls & (np.abs(first) < 2))
            for name, value in found.items():
                found[name] = np.where(below, np.inf if QUANTITIES[name].most else 0.0, value)
        return found

    def _events(self, gains, a, rows, holds, found):
        loud = [r for r in self.goal.measured if r.name == "current_rms"]  # the noise is a part of it
        asked = [r for r in self.goal.measured if r.quantity.event and r.name != "lift_off_time"] + loud
        out = {r.name: np.full(len(a), np.nan) for r in asked}
        for one in self.goal.requirements:  # events take long: they are left out where the responses are far off
            if one.name in found:
                with np.errstate(invalid="ignore", divide="ignore"):
                    off = np.log(found[one.name] / one.limit) * (1 if one.quantity.most else -1)
                holds = holds & ~(off > SLACK)
        if "lift_off_time" in {r.name for r in self.goal.measured}:
            out["lift_off_time"] = np.where(holds, 1e-3, np.nan)
        if not asked or not holds.any():
            return out
        own, rows = np.ascontiguousarray(a[holds]), np.ascontiguousarray(rows[holds])
        m, n, dt = len(own), len(self.plant.a), self.plant.dt
        kp, _, kd = gains[holds].T
        reading = np.zeros((m, n + 2))  # of an error of the reading of 1 m
        command = -(kp + kd / self.own.td)
        reading[:, :n] = self.plant.command[:, 0] * command[:, None]
        reading[:, n] = -(1 - np.exp(-dt / self.own.td))
        reading[:, n + 1] = -(1 - np.exp(-dt / self.own.ti))
        force = np.zeros((m, n + 2))
        force[:, :n] = self.plant.force[:, 0]
        limit = max([r.limit for r in asked if r.name == "recovery_time"], default=0.02)
        span = round(max(3 * limit, 0.05) / dt)
        noise = _run(own, reading, rows, span, True)
        first = (self.plant.jump[0, 0] * command)[:, None]
        noisy = np.concatenate([first, noise[:, 1]], axis=1)
        hover = self.noise * np.sqrt((noisy**2).sum(axis=1))
        peak, clearance = HOVER * hover, self.experiment.rig.clearance
        moves = self.noise * np.sqrt((noise[:, 0] ** 2).sum(axis=1) + 1)
        for r in asked:
            if r.name == "current_rms":
                out[r.name][holds] = np.hypot(found[r.name][holds], hover)
            if r.name == "noise_current":
                out[r.name][holds] = hover
            if r.name == "impulse_displacement":
                y = _run(own, force / dt * r.size, rows, min(span, round(0.3 / dt)), True)
                out[r.name][holds] = np.abs(y[:, 0]).max(axis=1) + 2 * moves
                peak = np.maximum(peak, np.abs(y[:, 1]).max(axis=1) + 2 * hover)
            if r.name == "recovery_time":
                y = _run(own, force * r.size, rows, round(3 * r.limit / dt), False)
                peak = np.maximum(peak, np.abs(y[:, 1]).max(axis=1) + 2 * hover)
                out[r.name][holds] = _rest(y[:, 0], r.limit, dt, clearance, moves)
        if "current_peak" in out:
            out["current_peak"][holds] = peak
        return out


def _rest(y, limit, dt, clearance, moves):
    """Time (m,) from which y (m, t) stays where it ends, by the rule of docs/goals.md."""
    width = max(1, round(limit / 30 / dt))
    end = y[:, -max(1, int(0.2 * y.shape[1])) :].mean(axis=1, keepdims=True)
    y = scipy.ndimage.uniform_filter1d(y, width, axis=1, mode="nearest")
    near = np.maximum(0.1 * np.abs(y).max(axis=1), np.maximum(0.01 * clearance, 5 * moves / np.sqrt(width)))
    out = np.abs(y - end) > near[:, None]
    last = np.where(out.any(axis=1), y.shape[1] - out[:, ::-1].argmax(axis=1), 0)
    return np.maximum(last, 1) * dt


def axes_of(task, episode, goal):
    """The axes of an episode's rig, each by itself."""
    whole = task.experiment(episode, task.box.gains(episode.start), 0)
    return [Axis(axis_experiment(whole, axis), goal) for axis in range(episode.rig.axes)]


def worst(axes, gains):
    """Quantities (m,) of the worse axis by name."""
    each = [axis.values(gains) for axis in axes]
    return {
        name: (np.max if QUANTITIES[name].most else np.min)([one[name] for one in each], axis=0) for name in each[0]
    }
