"""A slow simulator written from the loop's definition alone, with scipy's integrator at tight tolerance."""

import numpy as np
from scipy.integrate import solve_ivp

from maglev_env.effects import effect_value
from maglev_env.experiment import Experiment

MU_0 = 4e-7 * np.pi


def force_law(rig, gain_change=0.0, stiffness_change=0.0):
    """f(y, i) as the dissertation writes it, calibrated numerically."""
    if rig.magnet == "none":
        return lambda y, i: 0.0 * y
    mu_m = rig.recoil_permeability * MU_0
    m = rig.remanence * rig.magnet_length / mu_m
    r_m = rig.magnet_length * rig.pole_area / (mu_m * rig.magnet_area)
    n, g0, i0 = rig.turns, rig.gap, rig.bias_current

    def field(gap, current):
        if rig.flux_path == "magnet":
            return (n * current + m) / (2 * gap / MU_0 + r_m)
        return m / (2 * gap / MU_0 + r_m) + MU_0 * n * current / (2 * gap)

    def raw(y, i):
        return rig.bearings * rig.pole_area / (2 * MU_0) * (field(g0 - y, i0 + i) ** 2 - field(g0 + y, i0 - i) ** 2)

    d_i, d_y = 1e-4, 1e-8
    gain = (raw(0.0, d_i) - raw(0.0, -d_i)) / (2 * d_i)
    stiffness = -(raw(d_y, 0.0) - raw(-d_y, 0.0)) / (2 * d_y)
    a = (rig.actuator_gain / gain if rig.actuator_gain else 1.0) * (1 + gain_change)
    b = (rig.negative_stiffness / stiffness if rig.negative_stiffness else 1.0) * (1 + stiffness_change)
    return lambda y, i: raw(y, a * i) + (b - 1) * raw(y, 0.0)


def simulate(e: Experiment, samples: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """displacement readings, commands and currents at the sampling instants, without noise or converters."""
    rig, gains, effects = e.rig, e.gains, e.effects
    dt = 1 / rig.control_rate
    law = force_law(rig, effect_value(effects, "actuator_gain"), effect_value(effects, "negative_stiffness"))
    mass = rig.mass * (1 + effect_value(effects, "mass"))
    k_s = rig.support_stiffness * (1 + effect_value(effects, "support_stiffness"))
    c_s = rig.support_damping + effect_value(effects, "damping")
    probe = rig.probe_gain * (1 + effect_value(effects, "sensor_gain"))
    amplifier = [t for t in (rig.amplifier_time_constant, effect_value(effects, "amplifier_lag")) if t]
    sensor = [t for t in (rig.sensor_time_constant, effect_value(effects, "sensor_lag")) if t]
    delay = effect_value(effects, "delay")
    n_a, n_s = len(amplifier), len(sensor)

    def wave(at):
        parts = [x.waveform(rig.control_rate) for x in e.excitations if x.at == at]
        return np.resize(sum(parts, np.zeros(e.samples_per_period)), samples)

    force, injection, reference = wave("force"), wave("current"), wave("reference") + e.offset

    def rhs(_t, x, u, f):
        y, v = x[0], x[1]
        d = np.empty_like(x)
        source = u
        for j in range(n_a):
            d[2 + j] = (source - x[2 + j]) / amplifier[j]
            source = x[2 + j]
        d[0], d[1] = v, (law(y, source) - k_s * y - c_s * v + f) / mass
        seen = y
        for j in range(n_s):
            d[2 + n_a + j] = (seen - x[2 + n_a + j]) / sensor[j]
            seen = x[2 + n_a + j]
        return d

    x = np.zeros(2 + n_a + n_s)
    d = xi = 0.0
    shown, commands, currents = np.empty(samples), np.zeros(samples), np.empty(samples)
    whole = int(np.floor(delay / dt * (1 + 1e-12)))
    fraction = delay - whole * dt
    scale = np.full(x.size, 1e-12)
    scale[1] = 1e-9
    scale[2 : 2 + n_a] = 1e-9
    for t in range(samples):
        seen = x[-1] if n_s else x[0]
        volts = np.clip(probe * seen, -rig.voltage_range, rig.voltage_range)
        shown[t] = volts / rig.probe_gain
        error = reference[t] - shown[t]
        u = gains.kp * error + gains.kd * (error - d) / gains.td + gains.ki * xi + injection[t]
        limit = rig.voltage_range * rig.amplifier_gain
        commands[t] = np.clip(u, -limit, limit)
        d = error + (d - error) * np.exp(-dt / gains.td)
        xi = error + (xi - error) * np.exp(-dt / gains.ti)
        new = commands[t - whole] if t >= whole else 0.0
        old = commands[t - whole - 1] if t >= whole + 1 else 0.0
        currents[t] = x[1 + n_a] if n_a else (old if fraction > 1e-15 else new)
        for u_now, length in ((old, fraction), (new, dt - fraction)):
            if length > 1e-15:
                x = solve_ivp(
                    rhs, (0, length), x, method="DOP853", rtol=1e-11, atol=scale * 1e-3, args=(u_now, force[t])
                ).y[:, -1]
        if abs(x[0]) >= rig.clearance:
            return shown[: t + 1], commands[: t + 1], currents[: t + 1]
    return shown, commands, currents
