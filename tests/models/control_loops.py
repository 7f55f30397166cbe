"""Loops as python-control builds them."""

import control as ct
import numpy as np

DT = 1 / 20000.0


def control_loop(e):
    """The loop gain from python-control's own discretisation of transfer functions."""
    s, z = ct.tf("s"), ct.tf([1, 0], [1], DT)
    rig, g = e.rig, e.gains
    k = rig.support_stiffness - 12.5e3
    plant = 5.7 / (rig.mass * s**2 + rig.support_damping * s + k)
    plant = plant / (1 + rig.amplifier_time_constant * s) / (1 + rig.sensor_time_constant * s)
    a_d, a_i = np.exp(-DT / g.td), np.exp(-DT / g.ti)
    pid = g.kp + g.kd / g.td * (z - 1) / (z - a_d) + g.ki * (1 - a_i) / (z - a_i)
    return ct.sample_system(ct.ss(plant), DT, "zoh") * ct.ss(pid)
