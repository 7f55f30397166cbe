"""Time stepping of the twin: classical Runge-Kutta steps of every state between control samples, compiled.

Small functions are inlined by LLVM: inlining by numba runs as fast, but takes two and a half times as long to compile.
They make no arrays and keep none, so that they do not count references: counted at every call, those to the arrays of
the constants took nine tenths of the time.
"""

import numba as nb
import numpy as np

from sim2real.blind.machine import ARCTAN, DECAYING, LUGRE, PLATE, ROUND, SOFT, WARMING

OK, TOUCHDOWN, CLIPPED = 0, 1, 2
# Indices of the mechanical states; a plain rotor has the first two.
Y, V, BODY, BODY_V, BASE, BASE_V, PLATE_Y, PLATE_V, BRISTLE, STATES = range(10)
BASE_RATIO, BASE_DAMPING = (
    3.5,
    0.1,
)  # of the base below the probe's plate: frequency relative to the plate's, damping ratio
TANH_SPEED = 2e-4  # speed over which friction without bristles changes its sign, m/s
LIMIT_SHARPNESS = 6.0
WARM = 2.0  # time constants of the warming in a recording


@nb.njit(cache=True, forceinline=True, _nrt=False)
def _iron(m, field):
    """Field of saturating iron (T) in place of the field that iron without a knee would have."""
    x = field / m.knee
    if m.knee_kind == ARCTAN:
        return m.knee * (2 / np.pi) * np.arctan(np.pi / 2 * x)
    return field / (1.0 + abs(x) ** 3) ** (1.0 / 3.0)


@nb.njit(cache=True, forceinline=True, _nrt=False)
def _steeper(m, x):
    """Factor on the pull of a magnet at the gap x, 1 at the resting gap: a decay, or a power of a longer gap."""
    if m.steepness_kind == DECAYING:
        return np.exp(m.steepness * (m.gap - x) / m.gap)
    return (2.0 * m.gap / (m.gap + x)) ** (2.0 * m.steepness)


@nb.njit(cache=True, forceinline=True, _nrt=False)
def _pull(m, y, i):
    """Calibrated force (N) of the magnets at displacement y and current i, from the four gap fields."""
    up, down = m.gap - y, m.gap + y
    coil_up, coil_down, driving = m.coil_flux / up, m.coil_flux / down, m.gain_scale * i
    rest_up = m.magnet_flux / (up + m.magnet_gap) + coil_up * m.bias
    rest_down = m.magnet_flux / (down + m.magnet_gap) + coil_down * m.bias
    driven_up, driven_down = rest_up + coil_up * driving, rest_down - coil_down * driving
    if m.knee != np.inf:
        rest_up, rest_down = _iron(m, rest_up), _iron(m, rest_down)
        driven_up, driven_down = _iron(m, driven_up), _iron(m, driven_down)
    above = below = 1.0
    if m.steepness != 0.0:
        above, below = _steeper(m, up), _steeper(m, down)
    at_rest = above * rest_up * rest_up - below * rest_down * rest_down
    driven = above * driven_up * driven_up - below * driven_down * driven_down
    return m.area * (driven + (m.stiffness_scale - 1.0) * at_rest)


@nb.njit(cache=True, forceinline=True, _nrt=False)
def _springs(m, y):
    """Force (N) of the support's springs: straight, hardening, and a soft stop."""
    push = m.spring * y
    if m.spring_cubic != 0.0:
        if m.spring_reach == np.inf:
            push += m.spring_cubic * y * y * y
        else:
            x = y / m.spring_reach
            push += 6.0 * m.spring_cubic * m.spring_reach**3 * (np.sinh(x) - x)
    into = abs(y) - m.stop_at
    if into > 0.0:
        # The exponent leaves the force at an indentation of a micrometre as it is.
        push += np.sign(y) * m.stop_stiffness * 1e-6 * (into / 1e-6) ** m.stop_power
    return push


@nb.njit(cache=True, forceinline=True, _nrt=False)
def _deadened(m, u):
    """The command (A) that is left of u behind the dead band."""
    if m.deadband_kind == ROUND:
        return u - m.deadband * np.tanh(u / m.deadband)
    return np.sign(u) * max(abs(u) - m.deadband, 0.0)


@nb.njit(cache=True, forceinline=True, _nrt=False)
def _slopes(m, s, i, outside, full, d):
    """Time derivatives d of the mechanical states s, under the current i (A) and the external force (N)."""
    y, v = s[0], s[1]
    bearing = _pull(m, y + m.offset, i)
    bearing -= _springs(m, y) + (m.damper + m.drag_square * abs(v)) * v
    d[0] = v
    if not full:
        d[1] = (bearing + outside) / m.mass
        return
    if m.friction_kind:
        level = m.coulomb + (m.static - m.coulomb) * np.exp(-((v / m.stribeck) ** 2))
        if m.friction_kind == LUGRE:
            stiffness = m.coulomb / m.bristle
            d[8] = v - stiffness * abs(v) * s[8] / level
            bearing -= stiffness * s[8]
        else:
            bearing -= level * np.tanh(v / TANH_SPEED)
    total = bearing + outside
    if m.body_mass > 0.0:
        tie = m.body_mass * (m.body_rate**2 * (s[2] - y) + 2.0 * m.body_damping * m.body_rate * (s[3] - v))
        d[2], d[3] = s[3], -tie / m.body_mass
        total += tie
    d[1] = total / m.mass
    if m.mount_kind:
        w, kick = m.mount_rate, -m.mount_coupling * bearing / m.mass
        if m.mount_kind == PLATE:
            shake = kick
        else:
            w_base = BASE_RATIO * w
            d[4], d[5] = s[5], kick * BASE_RATIO**2 - 2.0 * BASE_DAMPING * w_base * s[5] - w_base**2 * s[4]
            shake = w * w * s[4] + 2.0 * m.mount_damping * w * s[5]
        d[6], d[7] = s[7], shake - 2.0 * m.mount_damping * w * s[7] - w * w * s[6]


@nb.njit(cache=True, forceinline=True, _nrt=False)
def _coil(m, i, u):
    """di/dt (A/s) of the amplifier at current i under the command u, with a limited coil voltage."""
    if m.voltage == np.inf:
        return (u - i) / m.amplifier
    asked = m.inductance * (u - i) / m.amplifier + m.resistance * i
    if m.voltage_kind == SOFT:
        given = asked / (1.0 + (abs(asked) / m.voltage) ** LIMIT_SHARPNESS) ** (1.0 / LIMIT_SHARPNESS)
    else:
        given = min(max(asked, -m.voltage), m.voltage)
    return (given - m.resistance * i) / m.inductance


@nb.njit(cache=True, forceinline=True, _nrt=False)
def _through(state, rates, j, old, new, span):
    """Advance a first-order lag whose input runs linearly from old to new; returns and stores its output."""
    x = rates[j] * span
    left = np.exp(-x)
    slope = (1.0 - left) / x
    state[j] = state[j] * left + old * (slope - left) + new * (1.0 - slope)
    return state[j]


@nb.njit(cache=True, forceinline=True, _nrt=False)
def _magnetised(m, i, eddy, stops):
    """The current that produces the force (A), after eddy currents and hysteresis; moves the stop operators to i."""
    seen = i
    for j in range(eddy.size):
        seen += m.eddy_shares[j] * (eddy[j] - i)
    through = seen
    for j in range(stops.size):  # stops hold the positions of the play; current minus play is the stop operator
        stops[j] = min(max(stops[j], through - m.stops[j]), through + m.stops[j])
        seen -= m.stop_shares[j] * (through - stops[j])
    if m.curve_at.size:
        j = 0
        while j < m.curve_at.size - 2 and seen > m.curve_at[j + 1]:
            j += 1
        slope = (m.curve_to[j + 1] - m.curve_to[j]) / (m.curve_at[j + 1] - m.curve_at[j])
        seen = m.curve_to[j] + slope * (seen - m.curve_at[j])
    return seen


@nb.njit(cache=True, error_model="numpy")
def step_record(m, gains, force, injection, reference, noise, misread, push, held, substeps, quantised, out):
    """Advance a loop from rest over out.shape[1] control samples; force and injection repeat.

    Args:
        m: Constants of the twin.
        gains: kp, ki, kd, td, ti, (5,).
        force: One period of the force, N.
        injection: One period of the injection, A.
        reference: Static reference, m.
        noise: Noise of the probe (samples,), m.
        misread: Error of the probe's reading (samples,), m.
        push: External force (samples + 1,), linear between samples, N.
        held: Samples at which the command is dropped (samples,).
        substeps: Runge-Kutta steps per control sample.
        quantised: Whether converters round.
        out: Result (3, samples): displacement, command, current.

    Returns:
        OK, TOUCHDOWN or CLIPPED.
    """
    samples, period = out.shape[1], force.size
    dt = 1.0 / m.rate
    h = dt / substeps
    kp, ki, kd, td, ti = gains
    keep_d, keep_i = np.exp(-dt / td), np.exp(-dt / ti)
    lag_d = lag_i = 0.0
    full = m.friction_kind > 0 or m.mount_kind > 0 or m.body_mass > 0.0
    n = STATES if full else 2
    s, trial, start = np.zeros(STATES), np.zeros(STATES), np.zeros(STATES)
    k1, k2, k3, k4 = np.zeros(STATES), np.zeros(STATES), np.zeros(STATES), np.zeros(STATES)
    poles, senses = 1.0 / m.amplifier_extra, 1.0 / m.sensor_extra
    lagged, sensed_late = np.zeros(poles.size), np.zeros(senses.size)
    eddy, stops = np.zeros(m.eddy_rates.size), np.zeros(m.stops.size)
    acting = np.zeros(samples)
    coil = sensor = shown = 0.0
    plays = np.zeros(m.plays.size)
    i_out = i_force = 0.0
    whole = int(np.floor(m.delay / h))
    part = m.delay / h - whole
    for k in range(samples):
        seen = shown + misread[k]
        seen += m.probe_square * seen * seen - m.probe_cube * seen * seen * seen
        if m.plays.size:
            followed = 0.0
            for j in range(plays.size):
                plays[j] = min(max(plays[j], seen - m.plays[j]), seen + m.plays[j])
                followed += plays[j] / plays.size
            seen = followed
        volts = m.probe * (seen + noise[k])
        if quantised:
            volts = np.round(volts / m.adc_step) * m.adc_step
        if abs(volts) > m.volts:
            return CLIPPED
        displacement = volts / m.probe_nominal
        e = reference - displacement
        u = kp * e + kd * (e - lag_d) / td + ki * lag_i + injection[k % period]
        lag_d, lag_i = e + (lag_d - e) * keep_d, e + (lag_i - e) * keep_i
        if quantised:
            u = np.round(u / m.dac_step) * m.dac_step
        if abs(u) > m.volts:
            return CLIPPED
        out[0, k], out[1, k], out[2, k] = displacement, u, i_out
        acting[k] = acting[k - 1] if held[k] and k > 0 else u
        if m.deadband > 0.0 and not (held[k] and k > 0):
            acting[k] = _deadened(m, u)
        past = k / samples
        if m.drift_kind == WARMING:
            past = (1.0 - np.exp(-WARM * past)) / (1.0 - np.exp(-WARM))
        scale = 1.0 + m.drift * past
        f = force[k % period]
        for j in range(substeps):
            late = k * substeps + j - whole
            newer, older = late // substeps, (late - 1) // substeps
            u_now = (1.0 - part) * acting[newer] if newer >= 0 else 0.0
            if part > 0.0 and older >= 0:
                u_now += part * acting[older]
            # The coil and what follows it, at the start, middle and end of the step; the mechanics do not act back.
            c1 = _coil(m, coil, u_now)
            c2 = _coil(m, coil + 0.5 * h * c1, u_now)
            c3 = _coil(m, coil + 0.5 * h * c2, u_now)
            c4 = _coil(m, coil + h * c3, u_now)
            new = coil + h / 6.0 * (c1 + 2.0 * c2 + 2.0 * c3 + c4)
            half = 0.5 * (coil + new) + h / 8.0 * (c1 - _coil(m, new, u_now))
            coil_0, coil = coil, new
            at_start = i_force
            at_half = at_end = 0.0
            for part_of in range(2):
                old_in = coil_0 if part_of == 0 else half
                new_in = half if part_of == 0 else coil
                for p in range(poles.size):
                    before = lagged[p]
                    new_in_next = _through(lagged, poles, p, old_in, new_in, 0.5 * h)
                    old_in, new_in = before, new_in_next
                for p in range(eddy.size):
                    _through(eddy, m.eddy_rates, p, i_out, new_in, 0.5 * h)
                i_out = new_in
                i_force = scale * _magnetised(m, i_out, eddy, stops)
                if part_of == 0:
                    at_half = i_force
                else:
                    at_end = i_force
            f0 = f + push[k] + (push[k + 1] - push[k]) * j / substeps
            f2 = f + push[k] + (push[k + 1] - push[k]) * (j + 1) / substeps
            f1 = 0.5 * (f0 + f2)
            for q in range(n):
                start[q] = s[q]
            _slopes(m, s, at_start, f0, full, k1)
            for q in range(n):
                trial[q] = s[q] + 0.5 * h * k1[q]
            _slopes(m, trial, at_half, f1, full, k2)
            for q in range(n):
                trial[q] = s[q] + 0.5 * h * k2[q]
            _slopes(m, trial, at_half, f1, full, k3)
            for q in range(n):
                trial[q] = s[q] + h * k3[q]
            _slopes(m, trial, at_end, f2, full, k4)
            for q in range(n):
                s[q] += h / 6.0 * (k1[q] + 2.0 * k2[q] + 2.0 * k3[q] + k4[q])
            if not abs(s[0]) < m.gap:
                return TOUCHDOWN
            # The probe measures the rotor relative to its mount.
            y0, y2 = start[0] - start[6], s[0] - s[6]
            middle = 0.5 * (y0 + y2) + h / 8.0 * (start[1] - start[7] - s[1] + s[7])
            g1 = (y0 - sensor) / m.sensor
            g2 = (middle - sensor - 0.5 * h * g1) / m.sensor
            g3 = (middle - sensor - 0.5 * h * g2) / m.sensor
            g4 = (y2 - sensor - h * g3) / m.sensor
            before_s = sensor
            sensor += h / 6.0 * (g1 + 2.0 * g2 + 2.0 * g3 + g4)
            old_in, new_in = before_s, sensor
            for p in range(senses.size):
                before = sensed_late[p]
                new_in_next = _through(sensed_late, senses, p, old_in, new_in, h)
                old_in, new_in = before, new_in_next
            shown = new_in
    return OK
