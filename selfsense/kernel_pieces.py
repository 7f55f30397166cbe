"""Pieces of a self-sensor for one lane, inlined where they are used: supply, coil, and parameter estimator.

Every piece takes the block x and the index k of the lane in the sensor's rows, and works on scalars.
"""

from collections.abc import Callable
from dataclasses import dataclass


from selfsense.kernel_rows import (
    ACTUAL, ALPHA, BEFORE, BEHIND, BIAS_FIELD, COIL, CORE_SHARE, COUNTS, COUNT_MAX, DEAD, EDDY, EDDY_RATE,
    EDDY_RATES, EDDY_WEIGHTS, ESTIMATE, FALL, FORWARD, GAP, HIGHEST, INTEGRAL, INTERVAL, INVERSE_0, INVERSE_1,
    KI_INTERVAL, KP, LOWEST, MAGNET_EMF, MODEL, MODEL_INVERSE_0, MODEL_INVERSE_1, MODEL_RESISTANCE,
    MODEL_VOLTAGE, NOISE, OFF, ON, PERIOD, PER_COUNT, PER_FIELD, READING, RESISTANCE, RISE, SATURATED, SIMULATED,
    STATES_3, VOLTAGE, VOLT_SECONDS,
)  # fmt: skip
from maglev_lanes.noise import drawn
from maglev_lanes.converter import quantised
from maglev_lanes.layout import LANES
from maglev_lanes.pieces import piece

W = LANES
MODES = len(EDDY_RATES)


@dataclass(frozen=True)
class SensorStructure:
    """Parts that are compiled in.

    They are true-rms (analog) paths, the voltage induced by motion, eddy currents, saturation, dead time, a converter,
    reading noise, a sampling rate at which PWM periods begin between samples, and a current regulator (without it the
    drive is given).
    """

    rms: bool
    emf: bool
    core: bool
    dead: bool
    adc: bool
    noise: bool
    drifting: bool
    regulated: bool


def sensor_pieces(structure: SensorStructure) -> tuple[Callable, ...]:
    """switch, advance, advance_across, read and converge of a sensor."""
    rms, emf, core = structure.rms, structure.emf, structure.core
    dead, regulated, adc, noise = structure.dead, structure.regulated, structure.adc, structure.noise

    @piece
    def saturated(x, k, linkage):
        """Current (A) that the core's saturation adds at a flux linkage."""
        rest = x[k + BIAS_FIELD]
        field = linkage * x[k + PER_FIELD] + rest
        square_now, square_rest = field * field, rest * rest
        bent = field * (square_now * square_now) * (square_now * square_now)
        return x[k + SATURATED] * (bent - rest * (square_rest * square_rest) * (square_rest * square_rest))

    @piece
    def current(x, k, gap):
        """Coil current, A, at a gap."""
        state = x[k + COIL]
        if not emf:
            return state
        now = state * (x[k + INVERSE_0] + x[k + INVERSE_1] * gap)
        if core:
            held = 0.0
            for mode in range(MODES):
                held += EDDY_WEIGHTS[mode] * (state - x[k + EDDY + mode * W])
            now = now + x[k + CORE_SHARE] * held + saturated(x, k, state)
        return now

    @piece
    def averaged(x):
        """(1 - e^-x) / x, the mean of e^-t over 0 .. x, with an error below 1e-5 up to x = 0.3."""
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
    def segment(x, k, level, dt, gap_start, gap_end, speed):
        """Advance the coil by dt (s) at one level of the supply, with a gap that changes linearly."""
        state = x[k + COIL]
        voltage = level * x[k + VOLTAGE]
        if emf:
            voltage = voltage + x[k + MAGNET_EMF] * speed
        resistance = x[k + RESISTANCE]
        inverse = x[k + INVERSE_0] + x[k + INVERSE_1] * (0.5 * (gap_start + gap_end))
        # The exact step of a coil with resistance at the mean of its reciprocal inductance.
        decay = resistance * inverse * dt
        if not emf:
            x[k + COIL] = state + (voltage - resistance * state) * inverse * dt * averaged(decay)
        elif not core:
            x[k + COIL] = state + (voltage - resistance * inverse * state) * dt * averaged(decay)
        else:
            tau, per_dt = 1.0 / x[k + EDDY_RATE], 1.0 / max(dt, 1e-18)
            drop = resistance * x[k + CORE_SHARE]
            # Mean drop over dt that the modes' lags at its start still cause, and what the flux's rise adds to it.
            left, added = 0.0, 0.0
            for mode in range(MODES):
                time = tau / EDDY_RATES[mode]
                fade = faded(dt * EDDY_RATES[mode] * x[k + EDDY_RATE])
                left += EDDY_WEIGHTS[mode] * (1.0 - fade) * time * (state - x[k + EDDY + mode * W])
                added += EDDY_WEIGHTS[mode] * time * (dt - (1.0 - fade) * time)
            phi = averaged(decay + 2.0 * drop * added * per_dt)
            linear = voltage * dt - decay * state - drop * left
            begun = saturated(x, k, state)
            rise = (linear - resistance * dt * begun) * phi
            middle, end = saturated(x, k, state + 0.5 * rise), saturated(x, k, state + rise)
            rise = (linear - resistance * dt * (1.0 / 6.0) * (begun + 4.0 * middle + end)) * phi
            slope = rise * per_dt
            for mode in range(MODES):
                time = tau / EDDY_RATES[mode]
                fade = faded(dt * EDDY_RATES[mode] * x[k + EDDY_RATE])
                kept = (1.0 - fade) * time
                # The resistance bends the flux's rise: its slope ends lower than its mean, by half of decay.
                kept = kept - decay * (0.5 * kept - (kept - dt * fade) * per_dt * time)
                r = k + EDDY + mode * W
                x[r] = state + rise - slope * kept - (state - x[r]) * fade
            x[k + COIL] = state + rise

    @piece
    def switch(x, k, drive, gap):
        """Begin a PWM period with a drive in -1 .. 1, or with the wanted mean current (A) at its end."""
        now = current(x, k, gap)
        three = x[k + STATES_3]
        if regulated:
            inverse = x[k + INVERSE_0] + x[k + INVERSE_1] * gap
            per_period = inverse * x[k + PERIOD]
            # Two states begin a period at the trough of the ripple, half its height below the mean.
            mean = now + (1.0 - three) * 0.25 * x[k + VOLTAGE] * per_period
            voltage = x[k + RESISTANCE] * mean + (drive - mean) / per_period
            drive = voltage / x[k + VOLTAGE]
        drive = min(max(drive, -1.0), 1.0)
        sign = 1.0 if drive >= 0.0 else -1.0
        alpha = three * drive * sign + (1.0 - three) * (0.5 + 0.5 * drive)
        whole = x[k + ALPHA] >= 1.0
        x[k + ALPHA] = alpha
        x[k + ON] = three * sign + (1.0 - three)
        x[k + OFF] = three - 1.0
        if dead:
            toward = now * (x[k + ON] - x[k + OFF])
            x[k + RISE] = 0.0 if whole or toward <= 0.0 else x[k + DEAD]

    @piece
    def conduct(x, k, start, share, gap_start, gap_end):
        """Advance the coil from `start` over `share` of a PWM period, with exact times of the edges."""
        alpha, on, off = x[k + ALPHA], x[k + ON], x[k + OFF]
        period = x[k + PERIOD]
        per_share = (gap_end - gap_start) / share
        speed = per_share / period
        wait, until = 0.0, min(max(alpha - start, 0.0), share)
        if dead:
            wait = min(max(x[k + RISE] - start, 0.0), share)
            segment(x, k, off, wait * period, gap_start, gap_start + per_share * wait, speed)
            until = max(until, wait)
        edge = gap_start + per_share * until
        segment(x, k, on, (until - wait) * period, gap_start + per_share * wait, edge, speed)
        if dead:
            # The current at the falling edge decides how long that is put off; without a pulse there is no edge.
            against = current(x, k, edge) * (on - off) < 0.0 and alpha > 0.0 and alpha < 1.0
            decided = alpha + (x[k + DEAD] if against else 0.0)
            fall = decided if alpha >= start else x[k + FALL]
            x[k + FALL] = fall
            late = min(max(fall - start, until), share)
            segment(x, k, on, (late - until) * period, edge, gap_start + per_share * late, speed)
            until, edge = late, gap_start + per_share * late
        segment(x, k, off, (share - until) * period, edge, gap_end, speed)
        held = until - wait
        x[k + VOLT_SECONDS] += (on * held + off * (share - held)) * period

    @piece
    def filtered(x, k, path, value):
        """One sample through a forward path (transposed direct form II)."""
        for stage in range(2 if rms else 1):
            f, s = k + BEFORE + 5 * stage * W, k + path + 2 * stage * W
            y = x[f] * value + x[s]
            x[s] = x[f + W] * value - x[f + 3 * W] * y + x[s + W]
            x[s + W] = x[f + 2 * W] * value - x[f + 4 * W] * y
            value = y
        value = value * value if rms else abs(value)
        f, s = k + BEHIND, k + path + 4 * W
        y = x[f] * value + x[s]
        x[s] = x[f + W] * value - x[f + 3 * W] * y + x[s + W]
        x[s + W] = x[f + 2 * W] * value - x[f + 4 * W] * y
        return max(y, 0.0) ** 0.5 if rms else y

    @piece
    def converge(x, k, reading, volt_seconds):
        """One sample of the parameter estimator from the current and the levels' integral since the last sample."""
        interval, model = x[k + INTERVAL], x[k + MODEL]
        inverse = x[k + MODEL_INVERSE_0] + x[k + MODEL_INVERSE_1] * x[k + ESTIMATE]
        resistance = x[k + MODEL_RESISTANCE]
        driven = x[k + MODEL_VOLTAGE] * volt_seconds - resistance * model * interval
        model = model + driven * inverse * averaged(resistance * inverse * interval)
        x[k + MODEL] = model
        forward = filtered(x, k, ACTUAL, reading)
        error = forward - filtered(x, k, SIMULATED, model)
        low, high = x[k + LOWEST], x[k + HIGHEST]
        integral = x[k + INTEGRAL] + x[k + KI_INTERVAL] * error
        integral = min(max(integral, low), high)
        x[k + INTEGRAL] = integral
        x[k + ESTIMATE] = min(max(integral + x[k + KP] * error, low), high)
        x[k + FORWARD] = forward

    @piece
    def advance(x, k, start, share, gap_end):
        """Advance the coil over a sample interval, `share` of a PWM period from `start` on, inside one period."""
        x[k + VOLT_SECONDS] = 0.0
        conduct(x, k, start, share, x[k + GAP], gap_end)
        x[k + GAP] = gap_end

    @piece
    def advance_across(x, k, start, share, gap_end, drive):
        """The same if a PWM period ends inside the interval and the next one begins with a drive."""
        before, gap_start = 1.0 - start, x[k + GAP]
        edge = gap_start + (gap_end - gap_start) * (before / share)
        x[k + VOLT_SECONDS] = 0.0
        conduct(x, k, start, before, gap_start, edge)
        switch(x, k, drive, edge)
        conduct(x, k, 0.0, share - before, edge, gap_end)
        x[k + GAP] = gap_end

    @piece
    def read(x, k, seed, count):
        """Read the current at the end of a sample interval and let the estimator converge on it."""
        gap = x[k + GAP]
        reading = current(x, k, gap)
        if noise:
            reading = reading + x[k + NOISE] * drawn(seed, count)
        if adc:
            top = x[k + COUNT_MAX]
            reading = quantised(reading * x[k + COUNTS], -top, top - 1.0, 1.0) * x[k + PER_COUNT]
        x[k + READING] = reading
        converge(x, k, reading, x[k + VOLT_SECONDS])

    return switch, advance, advance_across, read, converge
