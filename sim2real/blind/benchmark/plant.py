"""The benchmark's rotor or ball: the pull of its magnets and what moves, written from textbooks.

Nothing here is shared with the simulator or with the first sealed set's twin. Values stand in one array `p`, indexed by
`at`. Two axes are integrated together. What a step calls makes no arrays and keeps none, so that it does not count
references, which took more time than the arithmetic.
"""

from math import exp, pi, sin, sqrt

import numpy as np
from numba import njit

from sim2real.blind.benchmark import at

STATES = 9  # y, v; attached bodies x1, v1, x2, v2; probe mount q, v; cable creep
SLIPS = 6  # elements of Iwan's friction


@njit(cache=True, error_model="numpy", _nrt=False)
def flux(current, x, p):
    """Flux through one gap x, as the root of its pull: the law, fringing, and iron that saturates with a knee."""
    if p[at.LAW] == at.PAIR:
        f = current / x
    elif p[at.LAW] == at.EXPONENTIAL:
        f = current * exp(-0.5 * x / p[at.LENGTH])
    else:
        f = current * (x + p[at.MAGNETIC_OFFSET]) ** (-0.5 * p[at.EXPONENT])
    if p[at.FRINGING] != 0.0:
        f *= exp(-0.5 * p[at.FRINGING] * (x - p[at.GAP]) / p[at.GAP])
    if p[at.FLUX_LIMIT] > 0.0:
        f /= (1.0 + abs(f / p[at.FLUX_LIMIT]) ** p[at.KNEE]) ** (1.0 / p[at.KNEE])
    return f


@njit(cache=True, error_model="numpy", _nrt=False)
def pull(j, y, p):
    """Force of the magnets (N) at a force-producing current j beyond the bias and a displacement y."""
    u = (y - p[at.ECCENTRICITY]) * (1.0 + p[at.STIFFENING])
    near = flux(p[at.BIAS] + j, p[at.GAP] - u, p)
    force = p[at.CONSTANT] * near * near
    if p[at.LAW] == at.PAIR:
        far = flux(p[at.BIAS] - j, p[at.GAP] + u, p)
        force -= p[at.CONSTANT] * far * far
    if p[at.COGGING] != 0.0:
        force += p[at.COGGING] * sin(2 * pi * y / p[at.PITCH])
    return force


@njit(cache=True, error_model="numpy", _nrt=False)
def contact(a, y, v, anchors, p):
    """Force on the rotor from springs, films, stops and dry contacts (N)."""
    force = -p[at.SUPPORT] * y - (p[at.SUPPORT_DAMPING] + p[at.DAMPING]) * v
    force -= p[at.SQUEEZE] * v * (y / p[at.GAP]) ** 2
    if p[at.STRING] > 0.0:  # a string in the middle of its length, pulled sideways
        force -= p[at.STRING] * y * (1.0 - 1.0 / sqrt(1.0 + (y / p[at.SAG_LENGTH]) ** 2))
    met = y > p[at.STOP] or (y < -p[at.STOP] and p[at.STOP_ABOVE] == 0.0)
    if p[at.STOP_STIFFNESS] > 0.0 and met:  # Hertz: a round bumper
        depth = abs(y) - p[at.STOP]
        force -= np.sign(y) * p[at.STOP_STIFFNESS] * depth * sqrt(depth / p[at.GAP])
    if p[at.FRICTION] > 0.0:
        static = 1.0 + p[at.STATIC] * exp(-((v / p[at.SLOW]) ** 2))
        for n in range(SLIPS):  # each spring slips at its own deflection
            most = p[at.SLIP] * (n + 1) / SLIPS
            force -= p[at.FRICTION] / SLIPS * static * min(max((y - anchors[a, n]) / most, -1.0), 1.0)
    return force


@njit(cache=True, error_model="numpy", _nrt=False)
def derivative(s, magnets, outside, echo, anchors, p, out):
    """Rates of all states s (axes, STATES) under currents `magnets`, outside forces and delayed positions (axes,)."""
    axes = s.shape[0]
    for a in range(axes):
        y, v = s[a, 0], s[a, 1]
        force = pull(magnets[a], y, p)
        reaction = force
        if axes == 2:
            force += p[at.CROSSED] * pull(magnets[1 - a], s[1 - a, 0], p)
            force += (1.0 - 2.0 * a) * p[at.WHIRL] * s[1 - a, 0]
        force += outside[a] - p[at.MASS] * p[at.GRAVITY] + contact(a, y, v, anchors, p) + p[at.ECHO] * echo[a]
        for n in range(2, STATES):
            out[a, n] = 0.0
        if p[at.CREEP] != 0.0:
            force -= p[at.CREEP] * (y - s[a, 8])
            out[a, 8] = (y - s[a, 8]) / p[at.CREEP_TIME]
        if p[at.BODY_RATIO] != 0.0:  # a large and a small body on springs
            for n in range(2):
                w = p[at.BODY] * (1.0 + 1.4 * n)
                push = w * w * (y - s[a, 2 + 2 * n]) + 2 * p[at.BODY_DAMPING] * w * (v - s[a, 3 + 2 * n])
                out[a, 2 + 2 * n] = s[a, 3 + 2 * n]
                out[a, 3 + 2 * n] = push
                force -= p[at.BODY_RATIO] * (0.9 if n == 0 else 0.1) * p[at.MASS] * push
        if p[at.MOUNT_RATIO] != 0.0:  # the probe's mount takes up the reaction
            w = p[at.MOUNT]
            out[a, 6] = s[a, 7]
            out[a, 7] = -2 * p[at.MOUNT_DAMPING] * w * s[a, 7] - w * w * s[a, 6]
            out[a, 7] -= p[at.MOUNT_RATIO] * reaction / p[at.MASS]
        out[a, 0] = v
        out[a, 1] = force / p[at.MASS]
