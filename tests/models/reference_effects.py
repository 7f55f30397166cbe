"""A slow simulator of every effect, written from the effects' equations alone, with scipy's integrator."""

from math import copysign, cos, exp, expm1, hypot, pi, sin, sqrt
from operator import mul

import numpy as np
from reference_simulator import MU_0, Axis, force_law
from scipy.integrate import solve_ivp

from maglev_env.experiment import Experiment
from maglev_env.loop.eddy import eddy_branches
from maglev_env.loop.effect import effect_value


def bent_by(x, knee, sharpness, creep=0.0):
    """x / (1 + |x / knee|^n)^((1 - c) / n)."""
    return x / (1 + abs(x / knee) ** sharpness) ** ((1 - creep) / sharpness)


def saturated_law(rig, knee, sharpness, creep, gain_change, stiffness_change):
    """f(y, i) of a pair whose B bends to B / (1 + |B / knee|^n)^((1 - c) / n), with the straight law's calibration."""
    gap, mu_m = rig.gap, rig.recoil_permeability * MU_0
    m = rig.remanence * rig.magnet_length / mu_m if rig.magnet == "hybrid_pair" else 0.0
    r_m = rig.magnet_length * rig.pole_area / (mu_m * rig.magnet_area)
    area = rig.bearings * rig.pole_area / (2 * MU_0) * (1 if rig.magnet == "hybrid_pair" else 2)

    def field(x, current):
        if rig.magnet == "hybrid_pair" and rig.flux_path == "magnet":
            return (rig.turns * current + m) / (2 * x / MU_0 + r_m)
        return m / (2 * x / MU_0 + r_m) + MU_0 * rig.turns * current / (2 * x)

    def straight(y, i):
        return area * (field(gap - y, rig.bias_current + i) ** 2 - field(gap + y, rig.bias_current - i) ** 2)

    gain = (straight(0.0, 1e-4) - straight(0.0, -1e-4)) / 2e-4
    stiffness = -(straight(1e-8, 0.0) - straight(-1e-8, 0.0)) / 2e-8
    a = (rig.actuator_gain / gain if rig.actuator_gain else 1.0) * (1 + gain_change)
    b = (rig.negative_stiffness / stiffness if rig.negative_stiffness else 1.0) * (1 + stiffness_change)

    def bent(x, current):
        return bent_by(field(x, current), knee * (x / gap) ** (creep / (1 - creep)), sharpness, creep) ** 2

    def force(y, i):
        i0 = rig.bias_current
        upper, lower = bent(gap - y, i0), bent(gap + y, i0)
        moved = (bent(gap - y, i0 + a * i) - upper) - (bent(gap + y, i0 - a * i) - lower)
        return area * (b * (upper - lower) + moved)

    return force


class FullAxis(Axis):
    """One axis with every effect. States: y, v, amplifier, branches, hysteresis, mount, bodies, bristles, probe."""

    def __init__(self, e: Experiment, axis: int, first: int) -> None:
        super().__init__(e, axis, first)
        rig, value = self.rig, lambda name, key=None: effect_value(e.effects, name, key)
        changes = value("actuator_gain"), value("negative_stiffness")
        self.magnets = self.straight = force_law(rig, *changes)
        if np.isfinite(value("saturation")):
            knee = (value("saturation", key) for key in ("field", "sharpness", "creep"))
            self.magnets = saturated_law(rig, *knee, *changes)
        self.knees = [value("saturation", key) for key in ("current", "command", "sharpness", "creep")]
        self.power, self.unloading = value("hysteresis", "power"), value("hysteresis", "unloading")
        self.ripple = value("hysteresis", "ripple")
        self.static, self.stribeck, self.gradual = (value("friction", k) for k in ("static", "stribeck", "gradual"))
        self.feedback, self.lead = (value("amplifier_lag", key) for key in ("feedback", "lead"))
        self.filtered = value("sensor_lag", "feedback")
        self.limit, self.r, self.l = value("amplifier_voltage_limit"), rig.coil_resistance, rig.coil_inductance
        direct, weights, rates = eddy_branches(*(value("eddy_current", k) for k in (None, "order", "depth_hz")))
        self.direct, self.weights, self.rates = float(direct), weights.tolist(), rates.tolist()
        self.strength, self.width = value("hysteresis"), value("hysteresis", "width")
        self.offset = value("eccentricity")
        self.viscous = value("friction", "viscous")
        self.mount = [value("sensor_resonance", key) for key in (None, "damping_ratio", "coupling")]
        ratio, times, damping = (value("sensor_resonance", f"further_{k}") for k in ("ratio", "frequency", "damping"))
        self.further_mount = [self.mount[0] * times, damping, self.mount[2] * ratio]
        self.feels, self.beside = (value("sensor_resonance", f"{key}_share") for key in ("support", "outside"))
        self.body = [value("support_resonance", key) for key in (None, "damping_ratio", "mass_ratio")]
        ratio, times, damping = (value("support_resonance", f"further_{k}") for k in ("ratio", "frequency", "damping"))
        self.further = [self.body[0] * times, damping, ratio]
        hung = (self.body[2] + ratio) * bool(self.body[0])
        self.mass -= self.mass * value("support_resonance", "inside") * hung / (1 + hung)
        self.rub, self.slip = value("friction"), value("friction", "velocity")
        self.presliding = value("friction", "presliding")
        self.runout = [value("runout", key) for key in (None, "harmonics", "phase")]
        self.pickup = [value("pickup", key) for key in (None, "harmonics", "phase")]
        self.speed, self.mains = 2 * pi * e.speed_rpm / 60, 2 * pi * value("pickup", "frequency")
        self.moment, self.moment_phase = value("unbalance"), value("unbalance", "phase")
        self.quarter = axis * pi / 2
        self.asymmetry = value("asymmetric_gain")
        self.drift = [value("gain_drift", key) for key in (None, "depth", "frequency", "phase", "settling")]
        self.cube, self.reach, self.stop = value("cubic_spring"), value("soft_stop"), value("soft_stop", "stiffness")
        self.steepness, self.side = value("soft_stop", "steepness"), value("soft_stop", "side")
        self.shake = [value("foreign_vibration", key) for key in (None, "frequency", "phase")]
        self.dead, self.lost = value("deadband"), value("dropped_samples")
        self.plays = value("probe_backlash") * (1 + value("probe_backlash", "spread") * np.array([-1.0, 0.0, 1.0]))
        self.passed, self.behind = 0.0, np.zeros(3)
        self.branch = self.first_sensor
        self.held = self.branch + len(rates)
        self.first_mount = self.held + 1
        self.first_body = self.first_mount + 4
        self.first_further = self.first_body + 2
        self.bristles = self.first_further + 2
        self.first_sensor = self.bristles + 1
        self.size = self.first_sensor + len(self.sensor) - first

    def current(self, x, command):
        if self.lead:
            return (1 - self.lead) * x[self.branch - 1] + self.lead * x[self.branch - 2]
        return x[self.branch - 1] if self.amplifier else command

    def pulling(self, x, command):
        branches = x[self.branch : self.held]
        lagging = self.direct * self.current(x, command) + sum(map(mul, self.weights, branches))
        return bent_by(lagging - self.strength * self.width * x[self.held], self.knees[0], *self.knees[2:])

    def uneven(self, t, current):
        rate, depth, frequency, phase, settling = self.drift
        lasting = -expm1(-settling * t) / settling if settling else t
        gain = 1 + rate * lasting + depth * sin(2 * pi * frequency * t + phase)
        return gain * (current + self.asymmetry * abs(current))

    def pushed_back(self, y):
        beyond = abs(y) - self.reach
        if beyond <= 0:
            return self.cube * y**3
        stop = self.stop * ((1 - self.side if y < 0 else 1.0) if self.side > 0 else (1 + self.side if y > 0 else 1.0))
        return self.cube * y**3 + copysign(stop * beyond * (beyond / self.reach) ** (self.steepness - 1), y)

    def behind_play(self, reading):
        """The mean of what follows at the distance of each play."""
        for j, play in enumerate(self.plays):
            if abs(reading - self.behind[j]) > play:
                self.behind[j] = reading - copysign(play, reading - self.behind[j])
        return self.behind.mean()

    def passed_on(self, command):
        """The expected command behind the dead band, where a share of the commands is lost."""
        left = copysign(abs(command) - self.dead, command) if abs(command) > self.dead else 0.0
        self.passed = (1 - self.lost) * left + self.lost * self.passed
        return self.passed

    def seen(self, x):
        return x[self.first + self.size - 1] if self.sensor else self.beside_mount(x)

    def beside_mount(self, x):
        return x[self.first] - x[self.first_mount] - x[self.first_mount + 2]

    def tones(self, t):
        """What runout and pickup add to a reading at t."""
        total = 0.0
        for (amplitude, decay, phase), angle in (
            (self.runout, self.speed * t - self.quarter),
            (self.pickup, self.mains * t),
        ):
            total += amplitude * sum(decay ** (n - 1) * cos(n * (angle + phase)) for n in (1, 2, 3))
        return total

    def slopes_at(self, t, x, command, force, beside):
        """Derivatives under a command, the held force and what the other axis adds to the bearing's force."""
        y, v = x[self.first], x[self.first + 1]
        bearing = self.magnets(y + self.offset, self.uneven(t, self.pulling(x, command))) - self.stiffness * y
        bearing -= self.damping * v + self.pushed_back(y)
        bent, slope = v / sqrt(v * v + self.slip * self.slip), 0.0
        if self.presliding:
            bent = x[self.bristles]
            level = 1 + (self.static - 1) * exp(-((v / self.stribeck) ** 2))
            speed = sqrt(v * v + self.slip * self.slip)
            missing = v / speed - bent / level
            eased = (1 - self.gradual) * abs(missing) + self.gradual * sqrt(abs(missing))
            slope = copysign(eased, missing) * speed / self.presliding
        bearing += beside - self.extra_weight - self.rub * bent - self.viscous * v
        angle = self.speed * t - self.quarter + self.moment_phase
        outside = force + self.moment * self.speed**2 * cos(angle)
        push, rate, phase = self.shake
        outside += push * cos(2 * pi * rate * t + phase)
        a, on_springs = (bearing + outside) / self.mass, []
        for (frequency, damping, ratio), at in ((self.body, self.first_body), (self.further, self.first_further)):
            turn, (r, rv) = 2 * pi * frequency, x[at : at + 2]
            held_back = turn**2 * r + 2 * damping * turn * rv
            a += (ratio if frequency else 0.0) * held_back
            on_springs.append((rv, held_back))
        slopes = [v, a]
        source = bent_by(command, *self.knees[1:])
        rate = before = 0.0
        for j, time in enumerate(self.amplifier, self.first_amplifier):
            before, rate = rate, (source - x[j]) / time
            if j == self.first_amplifier and self.feedback:
                rate += self.feedback * (x[j] - x[j + 1]) / time
            if j == self.first_amplifier and np.isfinite(self.limit):
                low, high = (-self.limit - self.r * x[j]) / self.l, (self.limit - self.r * x[j]) / self.l
                rate = min(max(rate, low), high)
            slopes.append(rate)
            source = x[j]
        if self.lead:
            rate, source = (1 - self.lead) * rate + self.lead * before, self.current(x, command)
        slopes += [rate_k * (source - z) for rate_k, z in zip(self.rates, x[self.branch : self.held], strict=True)]
        z, toward = x[self.held], 1.0 if rate > 0 else -1.0
        back = z * abs(z) ** (self.power - 1) * (1.0 if z * toward > 0 else self.unloading)
        slopes.append((rate - hypot(rate, self.ripple) * back) / self.width)  # ripple goes its way to and fro
        held_back = (1 - self.feels) * (self.stiffness * y + (self.damping + self.viscous) * v)
        felt, mounts = bearing + held_back + self.beside * outside, x[self.first_mount : self.first_mount + 4]
        for (frequency, damping, coupling), (w, wv) in zip(
            (self.mount, self.further_mount), (mounts[:2], mounts[2:]), strict=True
        ):
            turn, driven = 2 * pi * frequency, -coupling * felt / self.mass if frequency else 0.0
            slopes += [wv, driven - 2 * damping * turn * wv - turn**2 * w]
        for rv, held_back in on_springs:
            slopes += [rv, -a - held_back if self.body[0] else 0.0]
        slopes.append(slope)
        source = y - mounts[0] - mounts[2]
        for j, time in enumerate(self.sensor, self.first_sensor):
            fed_back = self.filtered * (x[j] - x[j + 1]) if j == self.first_sensor and self.filtered else 0.0
            slopes.append((source - x[j] + fed_back) / time)
            source = x[j]
        return slopes


def simulate_effects(e: Experiment, samples: int, rtol: float = 1e-11, max_step: float = np.inf) -> tuple:
    """Displacement readings, commands and currents, each (axes, samples); no noise, no converters, no touchdown."""
    rig, c, dt = e.rig, e.rig.cross, 1 / e.rig.control_rate
    axes = [FullAxis(e, 0, 0)]
    if rig.axes == 2:
        axes.append(FullAxis(e, 1, axes[0].size))
    delay = effect_value(e.effects, "delay")
    whole = int(np.floor(delay / dt * (1 + 1e-12)))
    fraction = max(delay - whole * dt, 0.0)
    fraction = fraction if fraction > 1e-15 else 0.0
    waves = {at: np.resize(np.atleast_2d(e.waveform(at)), (len(axes), e.samples_per_period)) for at in PLACES}
    cross = [list(c.onto(axis)) for axis in range(2)]
    ratio = effect_value(e.effects, "cross_coupling")
    for axis in range(len(axes) if ratio else 0):
        law = axes[1 - axis].straight
        cross[axis][0] -= ratio * (law(1e-8, 0.0) - law(-1e-8, 0.0)) / 2e-8
        cross[axis][2] += ratio * (law(0.0, 1e-4) - law(0.0, -1e-4)) / 2e-4

    def rhs(t, x, begun, commands, forces):
        x = x.tolist()
        slopes = []
        for axis, a in enumerate(axes):
            beside = 0.0
            if len(axes) == 2:
                o, (stiffness, damping, gain, _) = axes[1 - axis], cross[axis]
                beside = gain * o.pulling(x, commands[1 - axis]) - stiffness * x[o.first] - damping * x[o.first + 1]
            slopes += a.slopes_at(begun + t, x, commands[axis], forces[axis], beside)
        return slopes

    x = np.zeros(sum(a.size for a in axes))
    scale = np.concatenate([_scale(a) for a in axes]) * (rtol / 1e-11)
    shown, currents, commands, passed = (np.empty((len(axes), samples)) for _ in range(4))
    spans = [(0.0, fraction), (fraction, dt)] if fraction else [(0.0, dt)]
    for t in range(samples):
        n = t % e.samples_per_period
        seen = [a.seen(x) for a in axes]
        if len(axes) == 2:
            seen = [seen[0] + cross[0][3] * seen[1], seen[1] + cross[1][3] * seen[0]]
        for k, a in enumerate(axes):
            shown[k, t] = a.probe * a.behind_play(seen[k] + a.tones(t * dt)) / a.rig.probe_gain
            reference = waves["reference"][k, n] + (e.offset if k == 0 else 0.0)
            commands[k, t] = a.output(reference, shown[k, t], 0.0) + waves["current"][k, n]
            passed[k, t] = a.passed_on(commands[k, t])
        new = passed[:, t - whole].tolist() if t >= whole else [0.0] * len(axes)
        old = passed[:, t - whole - 1].tolist() if t >= whole + 1 else [0.0] * len(axes)
        currents[:, t] = [a.current(x, u) for a, u in zip(axes, old if fraction else new, strict=True)]
        for start, stop in spans:
            acting = new if start >= fraction else old
            arguments = (t * dt + start, acting, waves["force"][:, n].tolist())
            run = solve_ivp(
                rhs, (0, stop - start), x, "DOP853", rtol=rtol, atol=scale, args=arguments, max_step=max_step
            )
            x = run.y[:, -1]
    return shown, commands, currents


PLACES = ("force", "current", "reference")


def _scale(a: FullAxis) -> np.ndarray:
    sizes = np.full(a.size, 1e-12)
    mount = a.first_mount - a.first
    for j in (0, mount, mount + 2, a.first_body - a.first, a.first_further - a.first):
        sizes[j] = 1e-15
    sizes[a.first_sensor - a.first :] = 1e-15
    return sizes
