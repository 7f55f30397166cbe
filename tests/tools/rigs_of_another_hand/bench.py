"""A bench: a digital controller around a body, its converters, delays and meters, tick by tick."""

from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

import numpy as np
from physics import Body, CurrentDrive, VoltageDrive, equations, runge_kutta
from regulators import Cascade, Pid


@dataclass(frozen=True)
class Bench:
    """Everything of a rig except controller and excitation. Times in s, lengths in m.

    rest: A in the coil where y = 0 balances the weight. step, noise: quantum and rms of the reading; command_step:
    quantum of the command, A or V. delay: of the command. stops: y at which the body lies or sticks. jitter: rms of
    the tick's interval over dt. meter_*: the current's own filter, relative scale error, noise rms, and whether it
    is read at the end of the tick. log_lag: first-order filter of the logged displacement alone. reading: metres
    read per metre moved.
    """

    body: Body
    drive: CurrentDrive | VoltageDrive
    dt: float
    rest: float = 0.0
    noise: float = 0.0
    step: float = 0.0
    command_step: float = 0.0
    delay: float = 0.0
    sensor_lag: float = 0.0
    substeps: int = 4
    stops: tuple[float, float] = (-np.inf, np.inf)
    jitter: float = 0.0
    meter_lag: float = 0.0
    meter_scale: float = 0.0
    meter_noise: float = 0.0
    meter_step: float = 0.0
    meter_late: bool = False
    log_lag: float = 0.0
    reading: float = 1.0
    limits: tuple[float, float] = (-np.inf, np.inf)


def quantised(value: float, step: float) -> float:
    return round(value / step) * step if step else value


def run(
    bench: Bench,
    controller: Pid | Cascade,
    reference: np.ndarray,
    injection: np.ndarray | None,
    rng: np.random.Generator,
    start: float = 0.0,
) -> dict[str, np.ndarray]:
    """Logged channels of a run, SI and total values: t, reference, displacement, command, current, acceleration(s).

    reference (m) and injection (A, added to the command) have one value per tick. start: displacement at first, m. The
    run before the log (20 % of its length, at most 3 s) lets the loop settle at the first reference.
    """
    plant = equations(bench.body, bench.drive, bench.sensor_lag, bench.meter_lag)
    advance: Callable = partial(runge_kutta, plant)
    lag = bool(bench.sensor_lag)
    immediate = isinstance(bench.drive, CurrentDrive) and not bench.drive.lag
    settle = int(min(0.2 * len(reference), 3.0 / bench.dt))
    state = [start, 0.0, bench.rest, start, bench.rest, start, 0.0]
    rest_input = bench.rest * (bench.drive.resistance if isinstance(bench.drive, VoltageDrive) else 1.0)
    if isinstance(controller, Cascade):
        controller.total = rest_input - controller.feed * bench.rest
    names = ("t", "reference", "displacement", "command", "current", "acceleration", "acceleration2", "wanted", "true")
    log: dict[str, list[float]] = {name: [] for name in names}
    clock, logged = 0.0, start
    late: deque[float] = deque([rest_input] * round(bench.delay / bench.dt * bench.substeps))
    keep = np.exp(-bench.dt / bench.log_lag) if bench.log_lag else 0.0
    for k in range(-settle, len(reference)):
        r = float(reference[max(k, 0)])
        span = bench.dt * (1 + bench.jitter * float(rng.standard_normal())) if bench.jitter else bench.dt
        span = max(span, 0.3 * bench.dt)
        seen = state[3] if lag else state[0]
        reading = quantised(bench.reading * seen + bench.noise * float(rng.standard_normal()), bench.step)
        metered = meter(bench, state, rng)
        if isinstance(controller, Cascade):
            command = controller.voltage(r - reading, metered)
        else:
            command = bench.rest + controller(r - reading)
        if injection is not None and k >= 0:
            command += float(injection[k])
        if isinstance(bench.drive, VoltageDrive):
            command = min(max(command, bench.drive.rails[0]), bench.drive.rails[1])
        command = min(max(quantised(command, bench.command_step), bench.limits[0]), bench.limits[1])
        slope = plant(state, command)
        for _ in range(bench.substeps):
            late.append(command)
            applied = late.popleft()
            if immediate:
                state[2] = applied
            state = advance(state, applied, span / bench.substeps)
            if not bench.stops[0] < state[0] < bench.stops[1]:
                state[0] = min(max(state[0], bench.stops[0]), bench.stops[1])
                state[1] = 0.0
        logged = keep * logged + (1 - keep) * reading if bench.log_lag else reading
        if k >= 0:
            row = (clock, r, logged, command, meter(bench, state, rng) if bench.meter_late else metered, slope[1])
            wanted = controller.wanted if isinstance(controller, Cascade) else command
            for name, value in zip(names, (*row, slope[6], wanted, state[0]), strict=True):
                log[name].append(value)
            clock += span
    return {name: np.array(values) for name, values in log.items()}


def meter(bench: Bench, state: list[float], rng: np.random.Generator) -> float:
    """The current as the bench's own meter reads it."""
    raw = state[4] if bench.meter_lag else state[2]
    return quantised(raw * (1 + bench.meter_scale) + bench.meter_noise * float(rng.standard_normal()), bench.meter_step)
