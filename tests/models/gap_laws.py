"""Force laws over the gap written out in numpy, and a ball that an integrator of its own keeps in the air."""

from math import exp

import numpy as np

MU_0 = 4e-7 * np.pi


def changed_law(rig, exponent, offset):
    """f(y, i) without calibration, each magnet pulling as 1 / (x + o)^(n + exponent) and as ever at the resting gap.

    A field that falls off as 1 / (x + c) then falls off as 1 / (x + c + o).
    """
    g, weight = rig.gap, rig.mass * rig.gravity
    o = offset * g
    mu_m = rig.recoil_permeability * MU_0
    source = rig.remanence * rig.magnet_length / mu_m  # A
    magnet = rig.magnet_length * rig.pole_area / (mu_m * rig.magnet_area)  # A/Wb, over the pole area
    own = MU_0 / 2 * magnet  # the same as an air gap

    def field(x, current):
        """T, at the gap x by the current of the coil and the permanent magnet."""
        coil = own if rig.flux_path == "magnet" else 0.0
        by_magnet = source / (2 * g / MU_0 + magnet) * (g + own + o) / (x + own + o)
        by_coil = rig.turns * current / (2 * (g + coil) / MU_0) * (g + coil + o) / (x + coil + o)
        return by_magnet + by_coil

    def steeper(x):
        return ((g + o) / (x + o)) ** exponent

    i0 = rig.bias_current
    if rig.magnet in ("hybrid_pair", "electromagnet_pair"):
        faces = 1 if rig.magnet == "hybrid_pair" else 2
        area = faces * rig.bearings * rig.pole_area / (2 * MU_0)

        def pair(y, i):
            upper, lower = g - y, g + y
            return area * (field(upper, i0 + i) ** 2 * steeper(upper) - field(lower, i0 - i) ** 2 * steeper(lower))

        return pair
    if rig.magnet == "electromagnet":
        constant = rig.bearings * MU_0 * rig.turns**2 * rig.pole_area / 4
        i0 = i0 or g * np.sqrt(weight / constant)
        return lambda y, i: constant * ((i0 + i) / g) ** 2 * ((g + o) / (g - y + o)) ** (2 + exponent) - weight
    n = rig.force_exponent
    attraction = rig.pole_area / (2 * MU_0)
    i0 = (weight - attraction * (source / (2 * g / MU_0 + magnet)) ** 2) * g**n / rig.force_constant
    return lambda y, i: (
        rig.force_constant * (i0 + i) / g**n * ((g + o) / (g - y + o)) ** (n + exponent)
        + attraction * (source / (2 * (g - y) / MU_0 + magnet)) ** 2
        - weight
    )


def levitated(force, mass, gains, rate, wave, inner=8):
    """Displacement and command at every sample, under a digital PID: Runge-Kutta steps of the motion alone.

    Args:
        force: f(y, i) in N, of an array of axes; the current is the command, held over a sample.
        mass: kg.
        gains: of the PID.
        rate: Hz.
        wave: held force (samples, axes), N.
        inner: steps within a sample.
    """
    dt = 1 / rate
    h, keep_d, keep_i = dt / inner, exp(-dt / gains.td), exp(-dt / gains.ti)
    y, v, low, leak = (np.zeros(wave.shape[1]) for _ in range(4))
    out = []
    for outside in wave:
        e = -y
        u = gains.kp * e + gains.kd * (e - low) / gains.td + gains.ki * leak
        low, leak = e + (low - e) * keep_d, e + (leak - e) * keep_i
        out.append((y, u))

        def a(y, u=u, outside=outside):
            return (force(y, u) + outside) / mass

        for _ in range(inner):
            k1 = a(y)
            k2 = a(y + h / 2 * v)
            k3 = a(y + h / 2 * v + h * h / 4 * k1)
            k4 = a(y + h * v + h * h / 2 * k2)
            y, v = y + h * v + h * h / 6 * (k1 + k2 + k3), v + h / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
    return np.array(out).swapaxes(0, 1)
