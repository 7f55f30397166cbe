"""A rotor on its PID loop in plain matrices: pushed while it hovers, or released beside the centre."""

import numpy as np
from scipy.linalg import expm

GAIN, STIFFNESS = 5.7, -12.5e3  # of hmb_free, N/A and N/m


def followed(rig, gains, samples, force=0.0, impulse=0.0, start=0.0):
    """Reading and current (samples,) of the linear loop without noise under a step (N), an impulse (N s), or a release.

    A released rotor's derivative filter holds what it read while it lay, and its integral is nearly empty.
    """
    dt, t_a, t_s = 1 / rig.control_rate, rig.amplifier_time_constant, rig.sensor_time_constant
    # States: y, v, current, reading; inputs: command and force, both held.
    rates = np.zeros((6, 6))
    rates[0, 1] = 1.0
    rates[1, [0, 2, 5]] = -STIFFNESS / rig.mass, GAIN / rig.mass, 1 / rig.mass
    rates[2, [2, 4]] = -1 / t_a, 1 / t_a
    rates[3, [0, 3]] = 1 / t_s, -1 / t_s
    step = expm(rates * dt)
    x = np.array([start, impulse / rig.mass, 0.0, start])
    d, integral = -start, 0.0
    a_d, a_i = np.exp(-dt / gains.td), np.exp(-dt / gains.ti)
    found = np.empty((2, samples))
    for n in range(samples):
        found[:, n] = x[3], x[2]
        e = -x[3]
        u = gains.kp * e + gains.kd / gains.td * (e - d) + gains.ki * integral
        d, integral = a_d * d + (1 - a_d) * e, a_i * integral + (1 - a_i) * e
        x = (step @ np.concatenate([x, [u, force]]))[:4]
    return found
