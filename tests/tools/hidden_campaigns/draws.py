"""Hidden rigs at random: what deviates lies within the stated tolerances, except for one of EFFECTS."""

import numpy as np
from rigs import SUB, Hidden, pull

G = 9.80665  # m/s2
EFFECTS = ("none", "gain", "delay", "lag", "eddy", "friction", "saturation", "voltage", "second body", "probe")


def pair(rng, small):
    """A pair of magnets: `hmb_free` as it is described, or a new one of 1 to 6 kg with default gains."""
    if small:
        mass, gain, stiffness, clearance, dt, lag, probe = 0.08012, 5.7, -12.5e3, 0.35e-3, 5e-5, 1e-4, 1.6e-5
        # The permanent magnets' reluctance acts as a wider gap.
        noise, gap, spread, toml = (0.5e-6, 2e-3, 5e-3), 0.6e-3, (0.005, 0.05, 0.1, 0.02), None
    else:
        mass, gap, dt = float(rng.uniform(1, 6)), float(rng.uniform(0.3e-3, 0.6e-3)), float(rng.choice([2e-4, 1e-4]))
        bias, clearance, lag, probe = float(rng.uniform(1.5, 4)), 0.5 * gap, float(rng.uniform(1e-4, 3e-4)), 2e-5
        rate = float(rng.uniform(250, 450))  # 1/s, of the fall
        stiffness, noise, spread = -mass * rate**2, (0.3e-6, 5e-3, 0.02 * mass), (0.002, 0.05, 0.05, 0.01)
        gain = -stiffness * gap / bias
        toml = f"""schema = "maglev-rig/1"
name = "pair"
magnet = "electromagnet_pair"
[parameters]
mass = {mass}
gap = {gap}
clearance = {clearance}
turns = 100
pole_area = {gain * gap**2 / (bias * 4e-7 * np.pi * 1e4)}
bias_current = {bias}
actuator_gain = {gain}
negative_stiffness = {stiffness}
amplifier_time_constant = {lag}
sensor_time_constant = {probe}
probe_gain = 20000.0
adc_bits = 0
dac_bits = 0
control_rate = {1 / dt}
gravity = 0.0
[noise]
displacement = {noise[0]}
current = {noise[1]}
force = {noise[2]}
[tolerance]
mass = {spread[0]}
actuator_gain = {spread[1]}
negative_stiffness = {spread[2]}
probe_gain = {spread[3]}
amplifier_time_constant = 0.1
"""
    m, k, s, c = (1 + w * float(np.clip(rng.standard_normal(), -2, 2)) for w in spread)
    bias = -s * stiffness * gap / (k * gain)
    constants = (k * gain * gap**2 / (4 * bias), gap, bias)
    lag *= 1 + 0.1 * float(rng.standard_normal())
    hidden = Hidden(dt, m * mass, 0, constants, 0.0, 0.0, 0.0, clearance, lag, probe, noise, scale=c)
    return hidden, toml, bias


def ball(rng):
    """A ball below a coil of an exponential law; its engineer describes the tangent of the nominal one."""
    mass, gap = float(rng.uniform(0.015, 0.12)), float(rng.uniform(6e-3, 14e-3))
    length, rest, dt = float(rng.uniform(6e-3, 14e-3)), float(rng.uniform(0.5, 1.5)), float(rng.choice([1e-3, 5e-4]))
    gain, stiffness, wide = 2 * mass * G / rest, -mass * G / length, 2 * length
    lag, probe, noise = 1.5 * dt, 3e-4, (float(rng.uniform(2e-6, 6e-6)), 2e-3, 0.01 * mass)
    spread = (0.002, 0.04, 0.04, 0.01)
    toml = f"""schema = "maglev-rig/1"
name = "ball"
magnet = "electromagnet"
[parameters]
mass = {mass}
gap = {wide}
clearance = {0.6 * gap}
turns = 1000
pole_area = {4 * mass * G * wide**2 / (rest**2 * 4e-7 * np.pi * 1e6)!r}
bias_current = {rest}
actuator_gain = {gain}
negative_stiffness = {stiffness}
amplifier_time_constant = {lag}
sensor_time_constant = {probe}
probe_gain = 1000.0
adc_bits = 0
dac_bits = 0
control_rate = {1 / dt}
[noise]
displacement = {noise[0]}
current = {noise[1]}
force = {noise[2]}
[tolerance]
mass = {spread[0]}
actuator_gain = {spread[1]}
negative_stiffness = {spread[2]}
probe_gain = {spread[3]}
amplifier_time_constant = 0.1
"""
    m, k, s, c = (1 + w * float(np.clip(rng.standard_normal(), -2, 2)) for w in spread)
    own, weight = length / s, m * mass * G
    true_rest = 2 * weight / (k * gain)  # the gain of i^2 is 2 F / i
    constants = (weight / true_rest**2 * np.exp(gap / own), gap, own)
    lag *= 1 + 0.1 * float(rng.standard_normal())
    hidden = Hidden(
        dt, m * mass, 1, constants, weight, true_rest, rest, 0.6 * gap, lag, probe, noise, scale=c
    )  # fmt: skip
    return hidden, toml, rest


def disturbed(hidden, effect, rng, bias):
    """The rig with an effect of a size that is plain beside the noise."""
    h, share = dict(vars(hidden)), float(rng.uniform(0.6, 1.4))
    fall = np.sqrt(abs(stiffness_of(hidden)) / hidden.mass)  # 1/s
    if effect == "gain":
        up = 1 + 0.13 * share * float(rng.choice([-1, 1]))
        h["constants"] = (h["constants"][0] * (up**2 if h["law"] else up), *h["constants"][1:])
        h["rest"] = h["rest"] / up if h["law"] else h["rest"]
    if effect == "delay":
        h["late"] = max(1, round(0.05 * share / fall / h["dt"] * SUB))
    if effect == "lag":
        h["probe"] = h["probe"] + 0.04 * share / fall
    if effect == "eddy":
        h["eddy"] = (0.25 * share, 0.2 / fall)
    if effect == "friction":
        h["friction"] = 0.004 * share * h["mass"] * G
    if effect == "saturation":
        h["saturation"] = 3.5 * share * (h["rest"] or bias)
        if h["law"]:
            h["rest"] = h["saturation"] * np.arctanh(min(0.99, h["rest"] / h["saturation"]))
    if effect == "voltage":
        h["rate"] = (h["rest"] or bias) * fall * 6 * share
    if effect == "second body":
        second, mode = 0.15 * share * h["mass"], 2 * np.pi * fall * float(rng.uniform(0.6, 1.2))
        h["body"] = (second, second * mode**2, 2 * 0.03 * second * mode)
    if effect == "probe":
        h["bend"] = 0.25 * share / h["clearance"]
    return Hidden(**h)


def stiffness_of(h):
    p = h.numbers()
    return (pull(p, 1e-7, h.rest) - pull(p, -1e-7, h.rest)) / 2e-7


def drawn(seed, index):
    """A hidden rig, its rig.toml (None: hmb_free), its effect and its goal."""
    rng = np.random.default_rng([541, seed, index])
    kind = ("hmb_free", "ball", "pair")[index % 3]
    effect = EFFECTS[(index // 3 + 3 * (index % 3) + seed) % len(EFFECTS)]
    hidden, toml, bias = ball(rng) if kind == "ball" else pair(rng, kind == "hmb_free")
    hidden = disturbed(hidden, effect, rng, bias)
    return hidden, toml, f"{kind}, {effect}"
