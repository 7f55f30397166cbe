"""Pieces of a self-sensor for one lane, inlined where they are used: supply, coil, and parameter estimator.

Every piece takes the block x and the lane i and works on scalars; `first` is the row at which the sensor begins.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numba.extending import register_jitable

from selfsense.kernel_rows import (
    ACTUAL, ALPHA, BEFORE, BEHIND, BIAS_FIELD, COIL, CORE_SHARE, COUNTS, COUNT_MAX, DEAD, EDDY, EDDY_RATE, EDDY_TAIL,
    ESTIMATE, FALL, FORWARD, GAP, HIGHEST, INTEGRAL, INTERVAL, INVERSE_0, INVERSE_1, KI_INTERVAL, KP, LANES, LEVEL,
    LOWEST, MAGNET_EMF, MODEL, MODEL_INVERSE_0, MODEL_INVERSE_1, MODEL_RESISTANCE, MODEL_VOLTAGE, NOISE, OFF, ON,
    PERIOD, PER_COUNT, PER_FIELD, READING, RESISTANCE, RISE, SATURATED, SIMULATED, STATES_3, VOLTAGE, VOLT_SECONDS,
)  # fmt: skip
from selfsense.noise import normal

W = LANES
# As a plain function: a compiled one has another name in every process, and kernels that hold it no disk cache.
drawn = register_jitable(forceinline=True)(normal.py_func)


@dataclass(frozen=True)
class SensorStructure:
    """What is compiled in: true-rms (analog) paths, the motion's voltage, eddy currents and saturation, dead time,
    a converter, reading noise, a sampling rate at which PWM periods begin between samples, and a current regulator
    (else the drive is given)."""

    rms: bool
    emf: bool
    core: bool
    dead: bool
    adc: bool
    noise: bool
    drifting: bool
    regulated: bool


def sensor_pieces(first: int, structure: SensorStructure) -> tuple[Callable, ...]:
    """switch, advance, advance_across, read and converge of the sensor whose rows begin at row `first`."""
    b = first * W
    rms, emf, core = structure.rms, structure.emf, structure.core
    dead, regulated, adc, noise = structure.dead, structure.regulated, structure.adc, structure.noise

    @register_jitable(forceinline=True)
    def current(x, i, gap):
        """Coil current, A, at a gap, without the sheath."""
        state = x[b + COIL * W + i]
        if not emf:
            return state
        inverse = x[b + INVERSE_0 * W + i] + x[b + INVERSE_1 * W + i] * gap
        now = state * inverse
        if core:
            held = 4.0 * state - x[b + EDDY * W + i] - x[b + (EDDY + 1) * W + i]
            held = 2.0 * (held - x[b + (EDDY + 2) * W + i] - x[b + (EDDY + 3) * W + i])
            field = state * x[b + PER_FIELD * W + i] + x[b + BIAS_FIELD * W + i]
            rest = x[b + BIAS_FIELD * W + i]
            square_now, square_rest = field * field, rest * rest
            bent = field * (square_now * square_now) * (square_now * square_now)
            bent = bent - rest * (square_rest * square_rest) * (square_rest * square_rest)
            now = now + x[b + CORE_SHARE * W + i] * held + x[b + SATURATED * W + i] * bent
        return now

    @register_jitable(forceinline=True)
    def segment(x, i, level, dt, gap_start, gap_end, speed):
        """Advance the coil over dt seconds at one level of the supply, its gap in between linear."""
        state = x[b + COIL * W + i]
        voltage = level * x[b + VOLTAGE * W + i]
        if emf:
            voltage = voltage + x[b + MAGNET_EMF * W + i] * speed
        resistance = x[b + RESISTANCE * W + i]
        inverse = x[b + INVERSE_0 * W + i] + x[b + INVERSE_1 * W + i] * (0.5 * (gap_start + gap_end))
        decay = resistance * inverse * dt
        # (1 - e^-x) / x: the exact step of a coil with resistance at the mean of its reciprocal inductance.
        phi = 1.0 - decay * (0.5 - decay * (1.0 / 6.0 - decay * (1.0 / 24.0 - decay * (1.0 / 120.0))))
        if not emf:
            x[b + COIL * W + i] = state + (voltage - resistance * state) * inverse * dt * phi
        elif not core:
            x[b + COIL * W + i] = state + (voltage - resistance * inverse * state) * dt * phi
        else:
            before = current(x, i, gap_start)
            slope = (voltage - resistance * before) * phi
            moved = state + slope * dt
            for mode in range(4):
                rate = x[b + EDDY_RATE * W + i] * float((mode + 1) * (mode + 1))
                a = rate * dt * (1.0 / 16.0)
                e = (1.0 - a * (0.5 - a * (1.0 / 12.0))) / (1.0 + a * (0.5 + a * (1.0 / 12.0)))
                e = e * e
                e = e * e
                e = e * e
                e = e * e
                r = b + (EDDY + mode) * W + i
                lag = slope / rate
                x[r] = moved - lag + (x[r] - state + lag) * e
            x[b + COIL * W + i] = moved
            after = current(x, i, gap_end)
            predicted = before + slope * inverse * dt
            # What the core adds to the current costs voltage too.
            correction = 0.5 * resistance * (predicted - after) * dt
            x[b + COIL * W + i] = moved + correction

    @register_jitable(forceinline=True)
    def switch(x, i, drive, gap):
        """Begin a PWM period with a drive in -1 .. 1, or with the mean current that its end should have."""
        now = current(x, i, gap)
        three = x[b + STATES_3 * W + i]
        if regulated:
            inverse = x[b + INVERSE_0 * W + i] + x[b + INVERSE_1 * W + i] * gap
            per_period = inverse * x[b + PERIOD * W + i]
            # Two states begin a period at the trough of the ripple, half its height below the mean.
            mean = now + (1.0 - three) * 0.25 * x[b + VOLTAGE * W + i] * per_period
            voltage = x[b + RESISTANCE * W + i] * mean + (drive - mean) / per_period
            drive = voltage / x[b + VOLTAGE * W + i]
        drive = min(max(drive, -1.0), 1.0)
        sign = 1.0 if drive >= 0.0 else -1.0
        alpha = three * drive * sign + (1.0 - three) * (0.5 + 0.5 * drive)
        x[b + ALPHA * W + i] = alpha
        x[b + ON * W + i] = three * sign + (1.0 - three)
        x[b + OFF * W + i] = three - 1.0
        if dead:
            toward = now * (x[b + ON * W + i] - x[b + OFF * W + i])
            x[b + RISE * W + i] = x[b + DEAD * W + i] if toward > 0.0 else 0.0
            x[b + FALL * W + i] = alpha

    @register_jitable(forceinline=True)
    def conduct(x, i, start, share, gap_start, gap_end):
        """Advance the coil from `start` over `share` of a PWM period, its edges where they fall."""
        alpha, on, off = x[b + ALPHA * W + i], x[b + ON * W + i], x[b + OFF * W + i]
        period = x[b + PERIOD * W + i]
        per_share = (gap_end - gap_start) / share
        speed = per_share / period
        fall, wait = alpha, 0.0
        if dead:
            toward = current(x, i, gap_start) * (on - off)
            decided = alpha + (x[b + DEAD * W + i] if toward < 0.0 else 0.0)
            fall = decided if alpha >= start else x[b + FALL * W + i]
            x[b + FALL * W + i] = fall
            fall = max(fall, x[b + RISE * W + i])
            wait = min(max(x[b + RISE * W + i] - start, 0.0), share)
        until = min(max(fall - start, 0.0), share)
        held = until - wait
        if dead:
            segment(x, i, off, wait * period, gap_start, gap_start + per_share * wait, speed)
        middle = gap_start + per_share * until
        segment(x, i, on, held * period, gap_start + per_share * wait, middle, speed)
        segment(x, i, off, (share - until) * period, middle, gap_end, speed)
        x[b + VOLT_SECONDS * W + i] += (on * held + off * (share - held)) * period
        if core:
            x[b + LEVEL * W + i] = off if until < share or wait == share else on

    @register_jitable(forceinline=True)
    def sheath(x, i, gap):
        """Current of the fast eddy currents (A), which follow the voltage at once: the jump at every edge."""
        if not core:
            return 0.0
        inverse = x[b + INVERSE_0 * W + i] + x[b + INVERSE_1 * W + i] * gap
        drop = x[b + RESISTANCE * W + i] * inverse * x[b + COIL * W + i]
        return x[b + EDDY_TAIL * W + i] * (x[b + LEVEL * W + i] * x[b + VOLTAGE * W + i] - drop)

    @register_jitable(forceinline=True)
    def filtered(x, i, path, value):
        """One sample through a forward path (transposed direct form II)."""
        for stage in range(2 if rms else 1):
            f, s = b + (BEFORE + 5 * stage) * W + i, b + (path + 2 * stage) * W + i
            y = x[f] * value + x[s]
            x[s] = x[f + W] * value - x[f + 3 * W] * y + x[s + W]
            x[s + W] = x[f + 2 * W] * value - x[f + 4 * W] * y
            value = y
        value = value * value if rms else abs(value)
        f, s = b + BEHIND * W + i, b + (path + 4) * W + i
        y = x[f] * value + x[s]
        x[s] = x[f + W] * value - x[f + 3 * W] * y + x[s + W]
        x[s + W] = x[f + 2 * W] * value - x[f + 4 * W] * y
        return max(y, 0.0) ** 0.5 if rms else y

    @register_jitable(forceinline=True)
    def converge(x, i, reading, volt_seconds):
        """One sample of the parameter estimator from the current and the levels' integral since the last sample."""
        interval, model = x[b + INTERVAL * W + i], x[b + MODEL * W + i]
        inverse = x[b + MODEL_INVERSE_0 * W + i] + x[b + MODEL_INVERSE_1 * W + i] * x[b + ESTIMATE * W + i]
        resistance = x[b + MODEL_RESISTANCE * W + i]
        decay = resistance * inverse * interval
        phi = 1.0 - decay * (0.5 - decay * (1.0 / 6.0 - decay * (1.0 / 24.0 - decay * (1.0 / 120.0))))
        driven = x[b + MODEL_VOLTAGE * W + i] * volt_seconds - resistance * model * interval
        model = model + driven * inverse * phi
        x[b + MODEL * W + i] = model
        forward = filtered(x, i, ACTUAL, reading)
        error = forward - filtered(x, i, SIMULATED, model)
        low, high = x[b + LOWEST * W + i], x[b + HIGHEST * W + i]
        integral = x[b + INTEGRAL * W + i] + x[b + KI_INTERVAL * W + i] * error
        integral = min(max(integral, low), high)
        x[b + INTEGRAL * W + i] = integral
        x[b + ESTIMATE * W + i] = min(max(integral + x[b + KP * W + i] * error, low), high)
        x[b + FORWARD * W + i] = forward

    @register_jitable(forceinline=True)
    def advance(x, i, start, share, gap_end):
        """Advance the coil over a sample interval, `share` of a PWM period from `start` on, inside one period."""
        x[b + VOLT_SECONDS * W + i] = 0.0
        conduct(x, i, start, share, x[b + GAP * W + i], gap_end)
        x[b + GAP * W + i] = gap_end

    @register_jitable(forceinline=True)
    def advance_across(x, i, start, share, gap_end, drive):
        """The same where a PWM period ends inside the interval and the next begins with a drive."""
        before, gap_start = 1.0 - start, x[b + GAP * W + i]
        edge = gap_start + (gap_end - gap_start) * (before / share)
        x[b + VOLT_SECONDS * W + i] = 0.0
        conduct(x, i, start, before, gap_start, edge)
        switch(x, i, drive, edge)
        conduct(x, i, 0.0, share - before, edge, gap_end)
        x[b + GAP * W + i] = gap_end

    @register_jitable(forceinline=True)
    def read(x, i, seed, count):
        """Read the current at the end of a sample interval and let the estimator converge on it."""
        gap = x[b + GAP * W + i]
        reading = current(x, i, gap) + sheath(x, i, gap)
        if noise:
            reading = reading + x[b + NOISE * W + i] * drawn(seed, count)
        if adc:
            top = x[b + COUNT_MAX * W + i]
            counts = np.rint(reading * x[b + COUNTS * W + i])
            reading = min(max(counts, -top), top - 1.0) * x[b + PER_COUNT * W + i]
        x[b + READING * W + i] = reading
        converge(x, i, reading, x[b + VOLT_SECONDS * W + i])

    return switch, advance, advance_across, read, converge
