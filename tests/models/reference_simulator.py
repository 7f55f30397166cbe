"""A slow simulator written from the loop's definition alone, with scipy's integrator at tight tolerance."""

from dataclasses import replace
from itertools import pairwise
from math import exp, hypot

import numpy as np
from scipy.integrate import solve_ivp
from scipy.optimize import brentq
from textbook_controllers import by_hand

from maglev_env.experiment import Experiment
from maglev_env.loop.axes import Cross
from maglev_env.loop.effect import effect_value
from maglev_env.loop.gains import Gains

MU_0 = 4e-7 * np.pi
SINGLE_SIDED = ("electromagnet", "magnet_coil")


def force_law(rig, gain_change=0.0, stiffness_change=0.0):
    """f(y, i) as the equations write it, calibrated numerically; the nominal weight is in the single-sided ones."""
    if rig.magnet == "none":
        return lambda y, i: 0.0 * y
    mu_m = rig.recoil_permeability * MU_0
    m = rig.remanence * rig.magnet_length / mu_m
    r_m = rig.magnet_length * rig.pole_area / (mu_m * rig.magnet_area)
    n, g0, i0 = rig.turns, rig.gap, rig.bias_current
    weight = rig.mass * rig.gravity

    def field(gap, current):
        if rig.flux_path == "magnet":
            return (n * current + m) / (2 * gap / MU_0 + r_m)
        return m / (2 * gap / MU_0 + r_m) + MU_0 * n * current / (2 * gap)

    def iron(gap, current):
        """Two pole faces of B = mu_0 N I / (2 gap) each, B^2 A / (2 mu_0) on a face."""
        return rig.bearings * 2 * (MU_0 * n * current / (2 * gap)) ** 2 * rig.pole_area / (2 * MU_0)

    def total(y, current):
        """Force at the whole current of the coil, or the upper one of a pair."""
        match rig.magnet:
            case "hybrid_pair":
                upper, lower = field(g0 - y, current), field(g0 + y, 2 * i0 - current)
                return rig.bearings * rig.pole_area / (2 * MU_0) * (upper**2 - lower**2)
            case "electromagnet_pair":
                return iron(g0 - y, current) - iron(g0 + y, 2 * i0 - current)
            case "electromagnet":
                return iron(g0 - y, current) - weight
            case "magnet_coil":
                attraction = rig.pole_area / (2 * MU_0) * field(g0 - y, 0.0) ** 2
                return rig.force_constant * current / (g0 - y) ** rig.force_exponent + attraction - weight

    if rig.magnet in SINGLE_SIDED and not i0:
        i0 = brentq(
            lambda current: total(0.0, current), 0.0 if rig.magnet == "electromagnet" else -1e3, 1e3, xtol=1e-15
        )

    def raw(y, i):
        return total(y, i0 + i)

    d_i, d_y = 1e-4, 1e-8
    gain = (raw(0.0, d_i) - raw(0.0, -d_i)) / (2 * d_i)
    stiffness = -(raw(d_y, 0.0) - raw(-d_y, 0.0)) / (2 * d_y)
    a = (rig.actuator_gain / gain if rig.actuator_gain else 1.0) * (1 + gain_change)
    b = (rig.negative_stiffness / stiffness if rig.negative_stiffness else 1.0) * (1 + stiffness_change)
    return lambda y, i: raw(y, a * i) + (b - 1) * raw(y, 0.0)


class Axis:
    """One axis of an experiment: its numbers, its controller as a recursion, and where its states are."""

    def __init__(self, e: Experiment, axis: int, first: int) -> None:
        rig, effects = e.rig, e.effects
        if rig.axes == 2:
            rig = replace(rig, axes=1, per_axis={}, cross=Cross(), gains=Gains(0.0, 0.0, 0.0), protocol=None)
            rig = replace(rig, **e.rig.per_axis.get("xy"[axis], {}))
        self.rig, self.dt = rig, 1 / rig.control_rate
        self.controller = e.gains[axis] if isinstance(e.gains, tuple) else e.gains
        changes = (effect_value(effects, name) for name in ("actuator_gain", "negative_stiffness"))
        self.magnets = force_law(rig, *changes)
        self.mass = rig.mass * (1 + effect_value(effects, "mass"))
        self.extra_weight = (self.mass - rig.mass) * rig.gravity if rig.magnet in SINGLE_SIDED else 0.0
        self.stiffness = rig.support_stiffness * (1 + effect_value(effects, "support_stiffness"))
        self.damping = rig.support_damping + effect_value(effects, "damping")
        self.probe = rig.probe_gain * (1 + effect_value(effects, "sensor_gain"))
        self.amplifier = [t for t in (rig.amplifier_time_constant, effect_value(effects, "amplifier_lag")) if t]
        self.sensor = [t for t in (rig.sensor_time_constant, effect_value(effects, "sensor_lag")) if t]
        self.first = first
        self.first_amplifier = first + 2
        self.first_sensor = first + 2 + len(self.amplifier)
        self.size = 2 + len(self.amplifier) + len(self.sensor)
        self.lag = self.leak = 0.0
        self.by_hand = by_hand(self.controller, self.dt)

    def seen(self, x):
        return x[self.first + self.size - 1] if self.sensor else x[self.first]

    def current(self, x, command):
        return x[self.first_sensor - 1] if self.amplifier else command

    def output(self, reference, reading, current):
        """The controller's output for what it reads next."""
        g, error = self.controller, reference - reading
        if not isinstance(g, Gains):
            return self.by_hand(reference, reading, current)
        u = g.kp * error + g.kd * (error - self.lag) / g.td + g.ki * self.leak
        self.lag = error + (self.lag - error) * exp(-self.dt / g.td)
        self.leak = error + (self.leak - error) * exp(-self.dt / g.ti)
        return u

    def slopes(self, x, command, outside):
        """Derivatives of this axis' states under its command and the other forces on it."""
        y, v = x[self.first], x[self.first + 1]
        current = self.current(x, command)
        support = self.stiffness * y + self.damping * v + self.extra_weight
        slopes = [v, (self.magnets(y, current) - support + outside) / self.mass]
        source = command
        for j, t in enumerate(self.amplifier, self.first_amplifier):
            slopes.append((source - x[j]) / t)
            source = x[j]
        source = y
        for j, t in enumerate(self.sensor, self.first_sensor):
            slopes.append((source - x[j]) / t)
            source = x[j]
        return slopes


def simulate(e: Experiment, samples: int, between: int = 1) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Displacement readings, commands and currents, `between` of each per control sample, no noise or converters.

    Each (samples * between,), on an x-y rig (2, samples * between); shorter when the rotor touches down.
    """
    rig, c, dt = e.rig, e.rig.cross, 1 / e.rig.control_rate
    axes = [Axis(e, 0, 0)]
    if rig.axes == 2:
        axes.append(Axis(e, 1, axes[0].size))
    delay = effect_value(e.effects, "delay")
    whole = int(np.floor(delay / dt * (1 + 1e-12)))
    fraction = delay - whole * dt
    fraction = fraction if fraction > 1e-15 else 0.0

    def wave(at, axis):
        total = np.zeros(e.samples_per_period)
        for x in e.excitations:
            angle = np.deg2rad(x.direction) - axis * np.pi / 2
            total += x.waveform(rig.control_rate) * np.cos(angle) * (x.at == at)
        return np.resize(total, samples)

    force, injection, reference = (
        [wave(at, axis) for axis in range(len(axes))] for at in ("force", "current", "reference")
    )
    reference[0] = reference[0] + e.offset

    def rhs(_t, x, commands, forces):
        x = x.tolist()
        if len(axes) == 1:
            return axes[0].slopes(x, commands[0], forces[0])
        a, b = axes
        y_x, v_x, i_x = x[a.first], x[a.first + 1], a.current(x, commands[0])
        y_y, v_y, i_y = x[b.first], x[b.first + 1], b.current(x, commands[1])
        on_x = forces[0] - c.stiffness_xy * y_y - c.damping_xy * v_y + c.gain_xy * i_y
        on_y = forces[1] - c.stiffness_yx * y_x - c.damping_yx * v_x + c.gain_yx * i_x
        return a.slopes(x, commands[0], on_x) + b.slopes(x, commands[1], on_y)

    def readings(x):
        seen = [a.seen(x) for a in axes]
        if len(axes) == 2:
            seen = [seen[0] + c.sensor_xy * seen[1], seen[1] + c.sensor_yx * seen[0]]
        shown = []
        for a, z in zip(axes, seen, strict=True):
            top = a.rig.voltage_range
            shown.append(min(max(a.probe * z, -top), top) / a.rig.probe_gain)
        return shown

    scale = np.concatenate([[1e-15, 1e-12] + [1e-12] * len(a.amplifier) + [1e-15] * len(a.sensor) for a in axes])
    x = np.zeros(len(scale))
    shown, currents = (np.empty((len(axes), samples * between)) for _ in range(2))
    commands = np.zeros((len(axes), samples))
    # The integration stops where a reading is taken and where the command jumps.
    taken = [dt * s / between for s in range(between)]
    stops = sorted({fraction, *taken, dt})
    for t in range(samples):
        for a, z in enumerate(readings(x)):
            limit = axes[a].rig.voltage_range * axes[a].rig.amplifier_gain
            u = axes[a].output(reference[a][t], z, axes[a].current(x, 0.0)) + injection[a][t]
            commands[a, t] = min(max(u, -limit), limit)
        new = commands[:, t - whole].tolist() if t >= whole else [0.0] * len(axes)
        old = commands[:, t - whole - 1].tolist() if t >= whole + 1 else [0.0] * len(axes)
        forces = [float(f[t]) for f in force]
        n = t * between
        for start, stop in pairwise(stops):
            acting = new if start >= fraction else old
            if start in taken:
                shown[:, n] = readings(x)
                currents[:, n] = [a.current(x, u) for a, u in zip(axes, acting, strict=True)]
                n += 1
            run = solve_ivp(rhs, (0, stop - start), x, method="DOP853", rtol=1e-11, atol=scale, args=(acting, forces))
            x = run.y[:, -1]
        if hypot(*(x[a.first] for a in axes)) >= rig.clearance:
            samples = t + 1
            break
    kept = samples * between
    found = shown[:, :kept], np.repeat(commands[:, :samples], between, axis=1), currents[:, :kept]
    return tuple(series[0] for series in found) if rig.axes == 1 else found
