"""Pieces of a self-sensor for one lane, inlined where they are used: supply, coil, and parameter estimator.

Every piece takes the block x and the lane i and works on scalars; `first` is the row at which the sensor begins.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from selfsense.kernel_rows import (
    ACTUAL, ALPHA, BEFORE, BEHIND, BIAS_FIELD, COIL, CORE_SHARE, COUNTS, COUNT_MAX, DEAD, EDDY, EDDY_RATE,
    EDDY_RATES, EDDY_WEIGHTS, ESTIMATE, FALL, FORWARD, GAP, HIGHEST, INTEGRAL, INTERVAL, INVERSE_0, INVERSE_1,
    KI_INTERVAL, KP, LANES, LOWEST, MAGNET_EMF, MODEL, MODEL_INVERSE_0, MODEL_INVERSE_1, MODEL_RESISTANCE,
    MODEL_VOLTAGE, NOISE, OFF, ON, PERIOD, PER_COUNT, PER_FIELD, READING, RESISTANCE, RISE, SATURATED, SIMULATED,
    STATES_3, VOLTAGE, VOLT_SECONDS,
)  # fmt: skip
from maglev_lanes.noise import drawn
from maglev_lanes.pieces import piece

W = LANES
MODES = len(EDDY_RATES)


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

    @piece
    def saturated(x, i, linkage):
        """Current (A) that the core's saturation adds at a flux linkage."""
        rest = x[b + BIAS_FIELD * W + i]
        field = linkage * x[b + PER_FIELD * W + i] + rest
        square_now, square_rest = field * field, rest * rest
        bent = field * (square_now * square_now) * (square_now * square_now)
        return x[b + SATURATED * W + i] * (bent - rest * (square_rest * square_rest) * (square_rest * square_rest))

    @piece
    def current(x, i, gap):
        """Coil current, A, at a gap."""
        state = x[b + COIL * W + i]
        if not emf:
            return state
        now = state * (x[b + INVERSE_0 * W + i] + x[b + INVERSE_1 * W + i] * gap)
        if core:
            held = 0.0
            for mode in range(MODES):
                held += EDDY_WEIGHTS[mode] * (state - x[b + (EDDY + mode) * W + i])
            now = now + x[b + CORE_SHARE * W + i] * held + saturated(x, i, state)
        return now

    @piece
    def averaged(x):
        """(1 - e^-x) / x, the mean of e^-t over 0 .. x, to 1e-5 up to x = 0.3."""
        return 1.0 - x * (0.5 - x * (1.0 / 6.0 - x * (1.0 / 24.0 - x * (1.0 / 120.0))))

    @piece
    def faded(x):
        """e^-x to 3e-6 for any x above 0, however large: a series to the 16th power."""
        a = x * (1.0 / 16.0)
        e = 1.0 / (1.0 + a * (1.0 + a * (0.5 + a * (1.0 / 6.0 + a * (1.0 / 24.0)))))
        e = e * e
        e = e * e
        e = e * e
        return e * e

    @piece
    def segment(x, i, level, dt, gap_start, gap_end, speed):
        """Advance the coil over dt seconds at one level of the supply, its gap in between linear."""
        state = x[b + COIL * W + i]
        voltage = level * x[b + VOLTAGE * W + i]
        if emf:
            voltage = voltage + x[b + MAGNET_EMF * W + i] * speed
        resistance = x[b + RESISTANCE * W + i]
        inverse = x[b + INVERSE_0 * W + i] + x[b + INVERSE_1 * W + i] * (0.5 * (gap_start + gap_end))
        # The exact step of a coil with resistance at the mean of its reciprocal inductance.
        decay = resistance * inverse * dt
        if not emf:
            x[b + COIL * W + i] = state + (voltage - resistance * state) * inverse * dt * averaged(decay)
        elif not core:
            x[b + COIL * W + i] = state + (voltage - resistance * inverse * state) * dt * averaged(decay)
        else:
            tau, per_dt = 1.0 / x[b + EDDY_RATE * W + i], 1.0 / max(dt, 1e-18)
            drop = resistance * x[b + CORE_SHARE * W + i]
            # Mean drop over dt that the modes' lags at its start still cause, and what the flux's rise adds to it.
            left, added = 0.0, 0.0
            for mode in range(MODES):
                time = tau / EDDY_RATES[mode]
                fade = faded(dt * EDDY_RATES[mode] * x[b + EDDY_RATE * W + i])
                left += EDDY_WEIGHTS[mode] * (1.0 - fade) * time * (state - x[b + (EDDY + mode) * W + i])
                added += EDDY_WEIGHTS[mode] * time * (dt - (1.0 - fade) * time)
            phi = averaged(decay + 2.0 * drop * added * per_dt)
            linear = voltage * dt - decay * state - drop * left
            begun = saturated(x, i, state)
            rise = (linear - resistance * dt * begun) * phi
            middle, end = saturated(x, i, state + 0.5 * rise), saturated(x, i, state + rise)
            rise = (linear - resistance * dt * (1.0 / 6.0) * (begun + 4.0 * middle + end)) * phi
            slope = rise * per_dt
            for mode in range(MODES):
                time = tau / EDDY_RATES[mode]
                fade = faded(dt * EDDY_RATES[mode] * x[b + EDDY_RATE * W + i])
                kept = (1.0 - fade) * time
                # The resistance bends the flux's rise: its slope ends lower than its mean, by half of decay.
                kept = kept - decay * (0.5 * kept - (kept - dt * fade) * per_dt * time)
                r = b + (EDDY + mode) * W + i
                x[r] = state + rise - slope * kept - (state - x[r]) * fade
            x[b + COIL * W + i] = state + rise

    @piece
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
        whole = x[b + ALPHA * W + i] >= 1.0
        x[b + ALPHA * W + i] = alpha
        x[b + ON * W + i] = three * sign + (1.0 - three)
        x[b + OFF * W + i] = three - 1.0
        if dead:
            toward = now * (x[b + ON * W + i] - x[b + OFF * W + i])
            x[b + RISE * W + i] = 0.0 if whole or toward <= 0.0 else x[b + DEAD * W + i]

    @piece
    def conduct(x, i, start, share, gap_start, gap_end):
        """Advance the coil from `start` over `share` of a PWM period, its edges where they fall."""
        alpha, on, off = x[b + ALPHA * W + i], x[b + ON * W + i], x[b + OFF * W + i]
        period = x[b + PERIOD * W + i]
        per_share = (gap_end - gap_start) / share
        speed = per_share / period
        wait, until = 0.0, min(max(alpha - start, 0.0), share)
        if dead:
            wait = min(max(x[b + RISE * W + i] - start, 0.0), share)
            segment(x, i, off, wait * period, gap_start, gap_start + per_share * wait, speed)
            until = max(until, wait)
        edge = gap_start + per_share * until
        segment(x, i, on, (until - wait) * period, gap_start + per_share * wait, edge, speed)
        if dead:
            # The current at the falling edge decides how long that is put off; without a pulse there is no edge.
            against = current(x, i, edge) * (on - off) < 0.0 and alpha > 0.0 and alpha < 1.0
            decided = alpha + (x[b + DEAD * W + i] if against else 0.0)
            fall = decided if alpha >= start else x[b + FALL * W + i]
            x[b + FALL * W + i] = fall
            late = min(max(fall - start, until), share)
            segment(x, i, on, (late - until) * period, edge, gap_start + per_share * late, speed)
            until, edge = late, gap_start + per_share * late
        segment(x, i, off, (share - until) * period, edge, gap_end, speed)
        held = until - wait
        x[b + VOLT_SECONDS * W + i] += (on * held + off * (share - held)) * period

    @piece
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

    @piece
    def converge(x, i, reading, volt_seconds):
        """One sample of the parameter estimator from the current and the levels' integral since the last sample."""
        interval, model = x[b + INTERVAL * W + i], x[b + MODEL * W + i]
        inverse = x[b + MODEL_INVERSE_0 * W + i] + x[b + MODEL_INVERSE_1 * W + i] * x[b + ESTIMATE * W + i]
        resistance = x[b + MODEL_RESISTANCE * W + i]
        driven = x[b + MODEL_VOLTAGE * W + i] * volt_seconds - resistance * model * interval
        model = model + driven * inverse * averaged(resistance * inverse * interval)
        x[b + MODEL * W + i] = model
        forward = filtered(x, i, ACTUAL, reading)
        error = forward - filtered(x, i, SIMULATED, model)
        low, high = x[b + LOWEST * W + i], x[b + HIGHEST * W + i]
        integral = x[b + INTEGRAL * W + i] + x[b + KI_INTERVAL * W + i] * error
        integral = min(max(integral, low), high)
        x[b + INTEGRAL * W + i] = integral
        x[b + ESTIMATE * W + i] = min(max(integral + x[b + KP * W + i] * error, low), high)
        x[b + FORWARD * W + i] = forward

    @piece
    def advance(x, i, start, share, gap_end):
        """Advance the coil over a sample interval, `share` of a PWM period from `start` on, inside one period."""
        x[b + VOLT_SECONDS * W + i] = 0.0
        conduct(x, i, start, share, x[b + GAP * W + i], gap_end)
        x[b + GAP * W + i] = gap_end

    @piece
    def advance_across(x, i, start, share, gap_end, drive):
        """The same where a PWM period ends inside the interval and the next begins with a drive."""
        before, gap_start = 1.0 - start, x[b + GAP * W + i]
        edge = gap_start + (gap_end - gap_start) * (before / share)
        x[b + VOLT_SECONDS * W + i] = 0.0
        conduct(x, i, start, before, gap_start, edge)
        switch(x, i, drive, edge)
        conduct(x, i, 0.0, share - before, edge, gap_end)
        x[b + GAP * W + i] = gap_end

    @piece
    def read(x, i, seed, count):
        """Read the current at the end of a sample interval and let the estimator converge on it."""
        gap = x[b + GAP * W + i]
        reading = current(x, i, gap)
        if noise:
            reading = reading + x[b + NOISE * W + i] * drawn(seed, count)
        if adc:
            top = x[b + COUNT_MAX * W + i]
            counts = np.rint(reading * x[b + COUNTS * W + i])
            reading = min(max(counts, -top), top - 1.0) * x[b + PER_COUNT * W + i]
        x[b + READING * W + i] = reading
        converge(x, i, reading, x[b + VOLT_SECONDS * W + i])

    return switch, advance, advance_across, read, converge
