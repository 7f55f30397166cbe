"""The benchmark's sampled loop: reading, controller, converters, amplifier, and Runge-Kutta steps of what moves."""

from math import exp, floor, pi, sin, sqrt, tanh

import numpy as np
from numba import njit

from sim2real.blind.benchmark import at
from sim2real.blind.benchmark.plant import SLIPS, STATES, derivative

_PARALLEL = 4  # modes of diffusion into the iron
_ECHO_LENGTH = 8192


@njit(cache=True, error_model="numpy", _nrt=False)
def _weights(h, time):
    """(a, b, c) of a first-order lag over a step with a straight input: x' = a x + b u + c u'. Any time, also 0."""
    if time <= 1e-12:
        return 0.0, 0.0, 1.0
    a = exp(-h / time)
    r = time / h * (1.0 - a)
    return a, r - a, 1.0 - r


@njit(cache=True, error_model="numpy", _nrt=False)
def _read(a, y, other, t, angle, held, p):
    """What the converter sees of one axis (m), without noise; `held` (1,) is the memory of a loose linkage."""
    x = y + p[at.CROSSTALK] * other + p[at.TILT] * y * y / p[at.GAP]
    turn = angle - 0.5 * pi * a
    x += p[at.RUNOUT] * (sin(turn + p[at.RUNOUT_PHASE]) + p[at.RUNOUT_SHAPE] * sin(2 * turn + 1.3))
    main = 2 * pi * p[at.MAINS] * t + p[at.MAINS_PHASE]
    x += p[at.PICKUP] * (sin(main) + p[at.MAINS_SHAPE] * sin(3 * main + 0.5) + 0.4 * p[at.MAINS_SHAPE] * sin(5 * main))
    if p[at.PLAY] > 0.0:
        held[0] = min(max(held[0], x - p[at.PLAY]), x + p[at.PLAY])
        x = held[0]
    x *= 1.0 + p[at.SCALE]
    if p[at.UNEVEN] > 0.0:  # integral nonlinearity of the converter, from segment to segment
        x += p[at.UNEVEN] * (2.0 * abs(2.0 * (x / p[at.UNEVEN_PITCH] - floor(x / p[at.UNEVEN_PITCH] + 0.5))) - 1.0)
    return x


@njit(cache=True, error_model="numpy")
def run(p, b, c, reference, injection, force, noise, lost, quantised, steps, lead=0):
    """Run the loop from the middle of the gap.

    Args:
        p: Values of rig and effects (VALUES,).
        b: Numerator of the controller in 1/z (3,), A/m.
        c: Denominator of it (3,), the first 1.
        reference: (samples, axes), m.
        injection: (samples, axes), A.
        force: (samples, axes), N, held between samples.
        noise: Of the readings (samples, axes), m.
        lost: Whether the new command is lost (samples,).
        quantised: Whether the converters round.
        steps: Runge-Kutta steps in a control period.
        lead: Samples before time zero.

    Returns:
        Displacement, command and current (samples, axes), and whether the rotor stayed off its stops.
    """
    samples, axes = reference.shape
    h = 1.0 / p[at.RATE] / steps
    reading, command, current = np.zeros((3, samples, axes))
    sent = np.zeros((samples, axes))
    s, trial, k = np.zeros((axes, STATES)), np.zeros((axes, STATES)), np.zeros((4, axes, STATES))
    anchors, held, echoes = np.zeros((axes, SLIPS)), np.zeros((axes, 1)), np.zeros((axes, _ECHO_LENGTH))
    errors, asked = np.zeros((axes, 3)), np.zeros((axes, 3))
    supply, sag, first, second = np.zeros((4, axes))
    i, before, after, middle, lagged = np.zeros((5, axes))
    faced, memory, sensed, slow, slower, outside, echo = np.zeros((7, axes))
    modes = np.zeros((axes, _PARALLEL))
    amp_a = exp(-h / p[at.AMPLIFIER])
    lag = _weights(h, 0.5 * p[at.LAG])
    probe = _weights(h, p[at.PROBE])
    sluggish, sluggish2 = _weights(h, 0.7 * p[at.SLUGGISH]), _weights(h, 0.3 * p[at.SLUGGISH])
    share = np.array([8.0 / (pi * (2 * n + 1)) ** 2 for n in range(_PARALLEL)])
    share[0] += 1.0 - share.sum()
    depth = [_weights(h, p[at.DIFFUSION] / (2 * n + 1) ** 2) for n in range(_PARALLEL)]
    behind = round(p[at.ECHO_TIME] / h)
    count = 0
    for n in range(samples):
        t0 = (n - lead) / p[at.RATE]
        angle = p[at.SPEED] * t0 + p[at.ANGLE]
        for a in range(axes):
            x = _read(a, slower[a], slower[1 - a] if axes == 2 else 0.0, t0, angle, held[a], p) + noise[n, a]
            if quantised:
                x = p[at.READ_STEP] * np.rint(x / p[at.READ_STEP])
            reading[n, a] = x
            current[n, a] = i[a]
            errors[a, 2], errors[a, 1], errors[a, 0] = errors[a, 1], errors[a, 0], reference[n, a] - x
            new = (
                b[0] * errors[a, 0]
                + b[1] * errors[a, 1]
                + b[2] * errors[a, 2]
                - c[1] * asked[a, 0]
                - c[2] * asked[a, 1]
            )
            asked[a, 1], asked[a, 0] = asked[a, 0], new
            new += injection[n, a]
            if quantised:
                new = p[at.COMMAND_STEP] * np.rint(new / p[at.COMMAND_STEP])
            new = min(max(new, -p[at.COMMAND_RANGE]), p[at.COMMAND_RANGE])
            command[n, a] = new
            sent[n, a] = sent[n - 1, a] if lost[n] and n > 0 else new
        for m in range(steps):
            t = t0 + m * h
            late = floor((t + h - p[at.DELAY]) * p[at.RATE] - 1e-9) + lead
            switch = min(max(((late - lead) / p[at.RATE] + p[at.DELAY] - t) / h, 0.0), 1.0)
            for a in range(axes):
                u = (1 - switch) * (sent[late, a] if late >= 0 else 0.0)
                u += switch * (sent[late - 1, a] if late >= 1 else 0.0)
                if p[at.DEADBAND] > 0.0:
                    u -= p[at.DEADBAND] * tanh(u / p[at.DEADBAND])
                sag[a] += h / p[at.SAG_TIME] * (abs(i[a]) - sag[a])
                u *= 1.0 - p[at.SAG] * sag[a]
                new1 = lag[0] * first[a] + lag[1] * supply[a] + lag[2] * u
                new2 = lag[0] * second[a] + lag[1] * first[a] + lag[2] * new1
                supply[a], first[a], second[a] = u, new1, new2
                target = amp_a * i[a] + (1 - amp_a) * new2
                rate = (target - i[a]) / h - p[at.INDUCED] * s[a, 1]
                if p[at.VOLTAGE] > 0.0:
                    v = p[at.INDUCTANCE] * rate + p[at.RESISTANCE] * i[a]
                    v /= (1.0 + abs(v / p[at.VOLTAGE]) ** 10) ** 0.1
                    rate = (v - p[at.RESISTANCE] * i[a]) / p[at.INDUCTANCE]
                old = i[a]
                i[a] += h * rate
                magnet = i[a]
                if p[at.DIFFUSION] > 0.0:
                    magnet = 0.0
                    for d in range(_PARALLEL):
                        w = depth[d]
                        modes[a, d] = w[0] * modes[a, d] + w[1] * old + w[2] * i[a]
                        magnet += share[d] * modes[a, d]
                if p[at.HYSTERESIS] > 0.0:
                    step = magnet - lagged[a]
                    memory[a] += abs(step) / p[at.WIDTH] * (magnet - memory[a])
                    lagged[a] = magnet
                    magnet += p[at.HYSTERESIS] * (memory[a] - magnet)
                magnet *= 1.0 + p[at.GAIN]
                if p[at.DRIFT] != 0.0:
                    magnet *= 1.0 + p[at.DRIFT] * (1.0 - exp(-max(t + h, 0.0) / p[at.DRIFT_TIME]))
                if p[at.ASYMMETRY] != 0.0:
                    magnet += p[at.ASYMMETRY] * sqrt(magnet * magnet + 1e-8)
                after[a] = magnet + p[at.OFFSET]
                middle[a] = 0.5 * (before[a] + after[a])
                echo[a] = echoes[a, (count - behind) % _ECHO_LENGTH] if p[at.ECHO] != 0.0 else 0.0
                outside[a] = force[n, a]
                if p[at.UNBALANCE] != 0.0:
                    turn = p[at.SPEED] * (t + 0.5 * h) + p[at.ANGLE] - 0.5 * pi * a
                    outside[a] += p[at.UNBALANCE] * p[at.SPEED] ** 2 * sin(turn)
                if p[at.SHAKE] != 0.0:
                    shake = 2 * pi * p[at.SHAKE_FREQUENCY] * (t + 0.5 * h) + p[at.SHAKE_PHASE]
                    outside[a] += p[at.SHAKE] * (sin(shake) + 0.15 * sin(2 * shake))
                faced[a] = s[a, 0] - s[a, 6]
            for stage in range(4):
                ahead = h if stage == 3 else 0.5 * h if stage else 0.0
                for a in range(axes):
                    for e in range(STATES):
                        trial[a, e] = s[a, e] + ahead * k[stage - 1, a, e] if stage else s[a, e]
                magnets = before if stage == 0 else after if stage == 3 else middle
                derivative(trial, magnets, outside, echo, anchors, p, k[stage])
            for a in range(axes):
                for e in range(STATES):
                    s[a, e] += h / 6 * (k[0, a, e] + 2 * k[1, a, e] + 2 * k[2, a, e] + k[3, a, e])
            count += 1
            for a in range(axes):
                before[a] = after[a]
                y = s[a, 0]
                if not abs(y) < 0.9 * p[at.GAP]:
                    return reading, command, current, False
                for e in range(SLIPS):
                    most = p[at.SLIP] * (e + 1) / SLIPS
                    anchors[a, e] = min(max(anchors[a, e], y - most), y + most)
                echoes[a, count % _ECHO_LENGTH] = y
                seen = y - s[a, 6]
                new0 = probe[0] * sensed[a] + probe[1] * faced[a] + probe[2] * seen
                new1 = sluggish[0] * slow[a] + sluggish[1] * sensed[a] + sluggish[2] * new0
                slower[a] = sluggish2[0] * slower[a] + sluggish2[1] * slow[a] + sluggish2[2] * new1
                sensed[a], slow[a] = new0, new1
    return reading, command, current, True
