"""A slow levitation loop on self-sensing, written from its definition: rotor and amplifier by scipy, every edge of the
switching voltage where it falls, the estimator as difference equations. One axis, no noise, ideal current converter."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from math import exp

import numpy as np
from reference_simulator import Axis
from scipy.integrate import solve_ivp
from scipy.signal import bilinear, butter

from maglev_env.experiment import Experiment, self_sensors
from maglev_env.loop.effect import effect_value
from maglev_env.loop.magnets.kinds import force_law
from selfsense.sensor import SelfSensor

MU_0 = 4e-7 * np.pi
TINY = 1e-12  # s: nearer instants are one


@dataclass(frozen=True)
class Run:
    """At every control instant (samples,): reading and true position (m), command and amplifier's current (A), current
    in the coil (A). Per whole PWM period (periods,): its begin (s), mean coil current (A), share at +voltage."""

    reading: np.ndarray
    position: np.ndarray
    command: np.ndarray
    current: np.ndarray
    coil: np.ndarray
    begin: np.ndarray
    mean: np.ndarray
    duty: np.ndarray


class Filter:
    """A digital filter by its difference equation, newest values first."""

    def __init__(self, numerator: np.ndarray, denominator: np.ndarray) -> None:
        self.b, self.a = numerator.tolist(), denominator.tolist()
        self.x, self.y = [0.0] * len(self.b), [0.0] * len(self.a)

    def __call__(self, value: float) -> float:
        self.x = [value, *self.x[:-1]]
        fed = sum(b * x for b, x in zip(self.b, self.x, strict=True))
        out = fed - sum(a * y for a, y in zip(self.a[1:], self.y, strict=False))
        self.y = [out, *self.y[:-1]]
        return out


class Path:
    """Amplitude of a current's ripple: Butterworth high-pass, rectifier, Butterworth low-pass, Tustin's rule."""

    def __init__(self, sensor: SelfSensor) -> None:
        rate, path = sensor.acquisition.rate, sensor.estimator.path
        corners = ((path.high_pass, "highpass"), (path.low_pass, "lowpass"))
        self.high, self.low = (
            Filter(*bilinear(*butter(2, 2 * np.pi * corner, kind, analog=True), fs=rate)) for corner, kind in corners
        )

    def __call__(self, current: float) -> float:
        return self.low(abs(self.high(current)))


class Estimator:
    """The gap whose simulated inductor ripples as the coil does."""

    def __init__(self, sensor: SelfSensor) -> None:
        self.e, self.interval = sensor.estimator, 1 / sensor.acquisition.rate
        self.constant = MU_0 * self.e.coil.turns**2 * self.e.coil.pole_area
        self.model, self.gap, self.integral = 0.0, sensor.gap, sensor.gap
        self.real, self.simulated = Path(sensor), Path(sensor)

    def __call__(self, current: float, level: float) -> None:
        """One sample of the current and the mean level of the supply since the one before."""
        e = self.e
        inductance = self.constant / (e.coil.core_length + 2 * self.gap)
        final, decay = level * e.voltage / e.coil.resistance, exp(-e.coil.resistance * self.interval / inductance)
        self.model = final + (self.model - final) * decay
        error = self.real(current) - self.simulated(self.model)
        low, high = e.gap_range
        self.integral = min(max(self.integral + e.ki * self.interval * error, low), high)
        self.gap = min(max(self.integral + e.kp * error, low), high)


class SwitchedCoil:
    """A coil on a supply of two states: D eq 6.12 for its current, and a regulator that sets each period's duty."""

    def __init__(self, sensor: SelfSensor) -> None:
        self.coil, self.voltage, self.period = sensor.coil, sensor.supply.voltage, 1 / sensor.supply.frequency
        self.constant = MU_0 * self.coil.turns**2 * self.coil.pole_area
        self.dead, self.current, self.charge = sensor.supply.dead_time, 0.0, 0.0
        self.level, self.edges = 1.0, []

    def inductance(self, gap: float) -> float:
        return self.constant / (self.coil.core_length + 2 * gap)

    def begin(self, time: float, gap: float, wanted: float) -> float:
        """Begin a period: how much of it at +voltage brings the mean current (A) to what is wanted at its end."""
        inductance = self.inductance(gap)
        mean = self.current + self.voltage / inductance * self.period / 4  # half of the ripple at half duty
        voltage = self.coil.resistance * mean + inductance * (wanted - mean) / self.period
        duty = min(max((1 + voltage / self.voltage) / 2, 0.0), 1.0)
        self.edges, self.charge = [(time, 1.0, self.dead), (time + duty * self.period, -1.0, self.dead)], 0.0
        return duty

    def next_edge(self) -> float:
        return self.edges[0][0] if self.edges else np.inf

    def switch(self, time: float) -> None:
        """Take the edge due now; a current that flows against it keeps the voltage for the dead time."""
        (_, level, dead), *self.edges = self.edges
        if dead and level != self.level and level * self.current > 0:
            self.edges = [(time + dead, level, 0.0), *self.edges]
        else:
            self.level = level

    def slope(self, current: float, gap: float, speed: float) -> float:
        inductance = self.inductance(gap)
        motion = self.coil.magnet_emf + 2 * self.constant / (self.coil.core_length + 2 * gap) ** 2 * current
        return (self.level * self.voltage - self.coil.resistance * current + motion * speed) / inductance

    def carry(self, h: float, gaps: list, speeds: list) -> None:
        """One step of Runge and Kutta at one level, at most a seventieth of the coil's time constant."""
        i = self.current
        k1 = self.slope(i, gaps[0], speeds[0])
        k2 = self.slope(i + h / 2 * k1, gaps[1], speeds[1])
        k3 = self.slope(i + h / 2 * k2, gaps[1], speeds[1])
        k4 = self.slope(i + h * k3, gaps[2], speeds[2])
        self.current = i + h / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
        self.charge += h / 2 * (i + self.current) + h**2 / 12 * (k1 - self.slope(self.current, gaps[2], speeds[2]))


class Motion:
    """Rotor and amplifier over one control sample: the command that acts changes where its delay ends."""

    def __init__(self, switch: float) -> None:
        self.switch, self.reached, self.parts = switch, 0.0, []

    def go(self, slopes: Callable, x: np.ndarray, stop: float, scale: np.ndarray) -> np.ndarray:
        kind = {"method": "DOP853", "rtol": 1e-11, "atol": scale, "dense_output": True}
        run = solve_ivp(slopes, (self.reached, stop), x, **kind)
        self.reached, self.parts = stop, [*self.parts, run.sol]
        return run.y[:, -1]

    def __call__(self, time: float) -> np.ndarray:
        return self.parts[0 if time < self.switch else -1](time)


def simulate(e: Experiment, samples: int) -> Run:
    """The experiment for so many control samples; its rig has one axis and an amplifier's pole."""
    (sensor,), rig = self_sensors(e), e.rig
    dt, interval, period = 1 / rig.control_rate, 1 / sensor.acquisition.rate, 1 / sensor.supply.frequency
    axis = Axis(replace(e, sensor="probe", rig=replace(rig, sensor_time_constant=0.0)), 0, 0)
    bias, top = force_law(rig).bias_current, rig.voltage_range * rig.amplifier_gain
    count = 2 * top / 2**rig.dac_bits if rig.dac_bits else 0.0
    waves = {place: np.resize(e.waveform(place), samples) for place in ("force", "current", "reference")}
    delay = effect_value(e.effects, "delay")
    whole = int(delay / dt * (1 + 1e-12))
    switch = delay - whole * dt
    estimator, coil = Estimator(sensor), SwitchedCoil(sensor)
    x = np.zeros(axis.size)
    scale = np.array([1e-15, 1e-12, *[1e-12] * len(axis.amplifier)])
    kept, cycles, commands, begun = [], [], [], None
    sampled = switched = 0  # samples taken and PWM periods begun
    now, volt_seconds = 0.0, 0.0
    for t in range(samples):
        reading = sensor.scale * (sensor.gap - estimator.gap) + sensor.shift
        u = axis.output(waves["reference"][t] + e.offset, reading, axis.current(x, 0.0)) + waves["current"][t]
        u = count * np.rint(u / count) if count else u
        u = min(max(u, -top), top)
        kept.append((reading, x[0], u, axis.current(x, u), coil.current))
        commands.append(u)
        start, end, before, force = t * dt, (t + 1) * dt, axis.current(x, u), waves["force"][t]
        motion = Motion(switch)
        for behind, stop in ((whole + 1, switch), (whole, dt)):
            acting = commands[t - behind] if t >= behind else 0.0
            if stop > motion.reached:
                x = motion.go(lambda _t, s, u=acting, f=force: axis.slopes(s.tolist(), u, f), x, stop, scale)
        change = axis.current(x, u) - before
        while end - now > TINY:
            if switched * period - now < TINY:
                if begun is not None:
                    cycles.append((begun[0], coil.charge / period, begun[1]))
                wanted = bias + before + change * (now + period - start) / dt
                begun = now, coil.begin(now, rig.gap - motion(now - start)[0], wanted)
                switched += 1
            while coil.next_edge() - now < TINY:
                coil.switch(now)
            until = min(end, coil.next_edge(), (sampled + 1) * interval, switched * period)
            at = [motion(s - start) for s in (now, (now + until) / 2, until)]
            coil.carry(until - now, [rig.gap - s[0] for s in at], [-s[1] for s in at])
            volt_seconds += coil.level * (until - now)
            now = until
            if (sampled + 1) * interval - now < TINY:
                estimator(coil.current, volt_seconds / interval)
                sampled, volt_seconds = sampled + 1, 0.0
    return Run(*np.array(kept).T, *np.array(cycles).T)
