"""Slow references: scipy's integrator between edges and samples, a sheet by its diffusion, a plain estimator loop."""

from collections.abc import Callable
from math import exp, pi, tan

import numpy as np
from scipy.integrate import solve_ivp
from scipy.signal import bilinear, butter

from selfsense.coil import MU_0, Coil
from selfsense.forward_path import AnalogPath
from selfsense.sensor import SelfSensor

SHAPES = 24  # even Legendre polynomials across a sheet
TINY = 1e-13  # s: nearer instants are one


class Plain:
    """D eq 6.12 (or 6.13) as written, in the current; dL/dt by the chain rule."""

    method, rtol, atol = "DOP853", 1e-10, 1e-14

    def __init__(self, coil: Coil) -> None:
        self.coil, self.constant = coil, MU_0 * coil.turns**2 * coil.pole_area
        self.rest = np.zeros(1)

    def current(self, state: np.ndarray, gap: float) -> float:
        return state[0]

    def rate(self, state: np.ndarray, voltage: float, gap: float, speed: float) -> np.ndarray:
        length = self.coil.core_length + 2 * gap
        drop = self.coil.resistance * state[0]
        if self.coil.back_emf:
            drop += state[0] * speed * -2 * self.constant / length**2 - self.coil.magnet_emf * speed
        return np.array([(voltage - drop) * length / self.constant])

    def jacobian(self, state: np.ndarray, gap: float) -> None:
        return None


class Sheet:
    """Flux that diffuses into the core's sheets, by Galerkin's method in even Legendre polynomials across a sheet.

    u(xi, t), xi = -1 .. 1: the linkage if the field were everywhere as at xi. u_t = u_xixi / tau; u_xi at the surface
    is tau times the voltage on the flux; the core's magnetomotive force goes with u at the surface, the gaps' with
    its mean, and saturation with the mean field.
    """

    method, rtol, atol = "LSODA", 1e-7, 1e-12

    def __init__(self, coil: Coil) -> None:
        self.coil, self.constant = coil, MU_0 * coil.turns**2 * coil.pole_area
        tau = MU_0 * coil.permeability * coil.conductivity * (coil.lamination / 2) ** 2
        order = 2 * np.arange(SHAPES if tau else 1)
        least = np.minimum.outer(order, order)
        self.weight = 2.0 * order + 1
        self.decay = self.weight[:, None] * (least * (least + 1) / 2) / (tau or 1.0)
        self.rest = np.zeros(len(order))

    def current(self, state: np.ndarray, gap: float) -> float:
        coil = self.coil
        core = coil.core_length * state.sum()
        if coil.saturation_field is not None:
            per_field = coil.turns * coil.pole_area * coil.saturation_field
            rest = coil.bias_field / coil.saturation_field
            core += coil.core_length * per_field * ((rest + state[0] / per_field) ** 9 - rest**9)
        return (core + 2 * gap * state[0]) / self.constant

    def rate(self, state: np.ndarray, voltage: float, gap: float, speed: float) -> np.ndarray:
        on_flux = voltage + self.coil.magnet_emf * speed - self.coil.resistance * self.current(state, gap)
        return self.weight * on_flux - self.decay @ state

    def jacobian(self, state: np.ndarray, gap: float) -> np.ndarray:
        coil, per_linkage = self.coil, np.full(len(state), self.coil.core_length)
        per_linkage[0] += 2 * gap
        if coil.saturation_field is not None:
            field = coil.bias_field + state[0] / (coil.turns * coil.pole_area)
            per_linkage[0] += coil.core_length * 9 * (field / coil.saturation_field) ** 8
        return -self.decay - np.outer(self.weight, per_linkage) * (coil.resistance / self.constant)

    def reluctance(self, s: complex) -> complex:
        """The core's reluctance at s over that at rest."""
        state = np.linalg.solve(s * np.eye(len(self.weight)) + self.decay, self.weight)
        return state.sum() / state[0]


class Run:
    """One coil carried through the supply's edges and the gap's samples."""

    def __init__(self, sensor: SelfSensor, gap: np.ndarray) -> None:
        self.model = Sheet(sensor.coil) if sensor.coil.has_core_losses else Plain(sensor.coil)
        self.interval, self.voltage = 1 / sensor.acquisition.rate, sensor.supply.voltage
        self.gaps = np.concatenate([[sensor.gap], gap])
        self.time, self.state, self.n = 0.0, self.model.rest, 0
        self.current, self.switching = np.zeros(len(gap)), np.zeros(len(gap))

    def gap(self, t: float) -> float:
        return self.gaps[self.n] + self.speed() * (t - self.n * self.interval)

    def speed(self) -> float:
        return (self.gaps[self.n + 1] - self.gaps[self.n]) / self.interval

    def amps(self) -> float:
        if self.n == len(self.current):
            return self.current[-1]
        return self.model.current(self.state, self.gap(self.time))

    def to(self, end: float, level: float) -> None:
        """Advance to an instant at one level of the supply."""
        while end - self.time > TINY and self.n < len(self.current):
            sample = (self.n + 1) * self.interval
            stop = min(end, sample) if sample - end > TINY else sample
            self.stretch(stop, level * self.voltage)
            self.switching[self.n] += level * (stop - self.time) / self.interval
            self.time = stop
            if stop == sample:
                self.current[self.n] = self.amps()
                self.n += 1

    def stretch(self, stop: float, voltage: float) -> None:
        model, speed = self.model, self.speed()
        solved = solve_ivp(
            lambda t, y: model.rate(y, voltage, self.gap(t), speed),
            (self.time, stop),
            self.state,
            method=model.method,
            rtol=model.rtol,
            atol=model.atol,
            **({"jac": lambda t, y: model.jacobian(y, self.gap(t))} if model.method == "LSODA" else {}),
        )
        assert solved.success
        self.state = solved.y[:, -1]


def reference_current(
    sensor: SelfSensor, gap: np.ndarray, drive: Callable[[int], float]
) -> tuple[np.ndarray, np.ndarray]:
    """Current (A) and mean switching voltage over the supply's since the sample before, at gap's samples (n,).

    gap (m) is linear between samples and starts at sensor.gap; drive(k) is that of PWM period k.
    """
    run, supply = Run(sensor, gap), sensor.supply
    period, k, before = 1 / supply.frequency, 0, 0.5
    while run.n < len(gap):
        t, d = k * period, drive(k)
        sign = 1.0 if d >= 0 else -1.0
        alpha, on, off = (abs(d), sign, 0.0) if supply.states == 3 else ((1 + d) / 2, 1.0, -1.0)
        # Between two switches the coil's current holds the voltage against itself; without a pulse nothing switches.
        rise = supply.dead_time if alpha > 0 and before < 1 and run.amps() * (on - off) > 0 else 0.0
        run.to(t + rise, off)
        run.to(t + max(rise, alpha * period), on)
        fall = supply.dead_time if 0 < alpha < 1 and run.amps() * (on - off) < 0 else 0.0
        run.to(min(t + alpha * period + fall, t + period), on)
        run.to(t + period, off)
        k, before = k + 1, alpha
    return run.current, run.switching


def drive_at_samples(sensor: SelfSensor, samples: int, drive: Callable[[int], float]) -> np.ndarray:
    """drive(k) of the PWM period that begins with the interval before a sample, or within it, else that under way."""
    share = sensor.supply.frequency / sensor.acquisition.rate
    begun = [int((n + 1) * share - 1e-9) for n in range(samples)]
    return np.array([drive(k) for k in begun])


def filters(path, rate: float) -> tuple[list[tuple[np.ndarray, np.ndarray]], tuple[np.ndarray, np.ndarray]]:
    """(b, a) of the filters before and behind the rectifier, from scipy's analog prototypes by Tustin's rule."""
    behind = bilinear(*butter(2, 2 * pi * path.low_pass, analog=True), fs=rate)
    if isinstance(path, AnalogPath):
        w = 2 * pi * path.centre
        # s of Tustin's rule scaled so that the centre stays in place.
        stage = bilinear(
            [path.gain * w / path.quality, 0.0], [1.0, w / path.quality, w**2], fs=w / 2 / tan(w / 2 / rate)
        )
        return [stage, stage], behind
    return [bilinear(*butter(2, 2 * pi * path.high_pass, "highpass", analog=True), fs=rate)], behind


class Filter:
    """A filter of second order as its difference equation reads."""

    def __init__(self, section: tuple[np.ndarray, np.ndarray]) -> None:
        b, self.a = section
        self.b = np.concatenate([np.zeros(3 - len(b)), b])
        self.x, self.y = [0.0, 0.0], [0.0, 0.0]

    def __call__(self, value: float) -> float:
        b, a, x, y = self.b, self.a, self.x, self.y
        out = (b[0] * value + b[1] * x[0] + b[2] * x[1] - a[1] * y[0] - a[2] * y[1]) / a[0]
        self.x, self.y = [value, x[0]], [out, y[0]]
        return out


def reference_estimate(sensor: SelfSensor, current: np.ndarray, switching: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Estimated gap (m) and ripple amplitude (A) at the samples (n,) of the current and the switching voltage read."""
    estimator, rate = sensor.estimator, sensor.acquisition.rate
    coil, rms, (low, high) = estimator.coil, isinstance(estimator.path, AnalogPath), estimator.gap_range
    paths = []
    for _ in range(2):
        before, behind = filters(estimator.path, rate)
        paths.append(([Filter(f) for f in before], Filter(behind)))

    def amplitude(path, value):
        for stage in path[0]:
            value = stage(value)
        if rms:
            return max(path[1](value**2), 0.0) ** 0.5
        return path[1](abs(value))

    gap = integral = sensor.gap
    model, out = 0.0, np.empty((2, len(current)))
    for n in range(len(current)):
        inductance = MU_0 * coil.turns**2 * coil.pole_area / (coil.core_length + 2 * gap)
        kept = exp(-coil.resistance / inductance / rate)
        volts = estimator.voltage * switching[n]
        model = model * kept + volts * ((1 - kept) / coil.resistance if coil.resistance else 1 / inductance / rate)
        actual = amplitude(paths[0], current[n])
        error = actual - amplitude(paths[1], model)
        integral = min(max(integral + estimator.ki / rate * error, low), high)
        gap = min(max(integral + estimator.kp * error, low), high)
        out[:, n] = gap, actual
    return out[0], out[1]
