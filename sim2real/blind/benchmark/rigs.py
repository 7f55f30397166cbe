"""The benchmark's rigs, drawn anew for each campaign: a free rotor, one on springs, one of two axes, a ball."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from math import pi, sqrt

import numpy as np

GRAVITY = 9.80665
FAMILIES = ("rotor", "stand", "xy", "ball")
TURNS = ("rotor", "stand", "ball", "rotor", "stand", "ball", "xy")  # how often each occurs: two axes take longer
SHAKEN = ("rotor", "stand", "xy")  # those that a shaker can push
_MU_0 = 4e-7 * pi


@dataclass(frozen=True)
class BenchRig:
    """A rig as its data sheets say, and the scales to which drives and effects are drawn.

    Attributes:
        family: One of FAMILIES.
        magnet: The magnet's name in the rig file.
        axes: Number of axes.
        parameters: [parameters] of the rig file.
        noise: [noise] of the rig file.
        tolerance: [tolerance] of the rig file: relative standard deviations of the true parameters.
        bandwidth: Of the loop, rad/s.
        gain: N/A at rest.
        stiffness: Of the magnets, -dF/dy at rest, N/m (negative).
        pid: Gains kp (A/m), ki (A/(m s)), kd (A s/m), and the derivative's filter td (s).
    """

    family: str
    magnet: str
    axes: int
    parameters: Mapping[str, float]
    noise: Mapping[str, float]
    tolerance: Mapping[str, float]
    bandwidth: float
    gain: float
    stiffness: float
    pid: Mapping[str, float] = field(default_factory=dict)

    @property
    def counts(self) -> dict[str, float]:
        """Size of one converter step of the displacement (m) and of the command (A)."""
        p = self.parameters
        return {
            "displacement": 2 * p["voltage_range"] / 2 ** p["adc_bits"] / p["probe_gain"],
            "command": 2 * p["voltage_range"] / 2 ** p["dac_bits"] * p["amplifier_gain"],
        }

    def toml(self) -> str:
        """The rig file."""
        lines = [
            'schema = "maglev-rig/1"',
            f'name = "{self.family}"',
            f'magnet = "{self.magnet}"',
            f"axes = {self.axes}",
        ]
        lines += ["", "[parameters]", *(f"{k} = {v!r}" for k, v in self.parameters.items())]
        lines += ["", "[gains]", 'form = "pid"', *(f"{k} = {v!r}" for k, v in self.pid.items())]
        lines += ["", "[noise]", *(f"{k} = {v!r}" for k, v in self.noise.items())]
        lines += ["", "[tolerance]", *(f"{k} = {v!r}" for k, v in self.tolerance.items())]
        return "\n".join(lines) + "\n"


def log_uniform(rng: np.random.Generator, low: float, high: float) -> float:
    """A draw between two values, uniform in the logarithm."""
    return float(np.exp(rng.uniform(np.log(low), np.log(high))))


def draw_rig(family: str, rng: np.random.Generator) -> BenchRig:
    """A rig of a family with drawn parameters and a controller that levitates it."""
    return _ball(rng) if family == "ball" else _rotor(family, rng)


def _rotor(family: str, rng: np.random.Generator) -> BenchRig:
    mass, gap = log_uniform(rng, 0.05, 0.5), log_uniform(rng, 0.3e-3, 0.8e-3)
    bias, turns = float(rng.uniform(0.8, 2.0)), int(rng.integers(60, 200))
    pole = log_uniform(rng, 80.0, 180.0)  # rad/s: falls with this pole without a controller and without springs
    constant = mass * pole**2 * gap**3 / (4 * bias**2)
    gain, stiffness = 4 * constant * bias / gap**2, -4 * constant * bias**2 / gap**3
    own = {"support_stiffness": 0.0, "support_damping": 0.0}
    if family == "stand":
        swing = 2 * pi * log_uniform(rng, 25.0, 45.0)
        own = {"support_stiffness": mass * swing**2 - stiffness, "support_damping": 0.06 * mass * swing}
        pole = max(pole, 0.6 * swing)
    bandwidth = float(rng.uniform(2.4, 3.2)) * pole
    rate = float(rng.choice([4000.0, 5000.0]))
    parameters = {
        "mass": mass,
        **own,
        "gap": gap,
        "turns": turns,
        "pole_area": 4 * constant / (_MU_0 * turns**2),
        "bias_current": bias,
        "coil_inductance": float(rng.uniform(1.0, 4.0)) * 1e-3,
        "coil_resistance": float(rng.uniform(0.8, 3.0)),
        "supply_voltage": 48.0,
        "amplifier_gain": 0.25,
        "amplifier_time_constant": float(rng.uniform(0.05, 0.12)) / bandwidth,
        "sensor_time_constant": float(rng.uniform(0.01, 0.04)) / bandwidth,
        "probe_gain": 8.0 / gap,
        "adc_bits": 16,
        "dac_bits": int(rng.choice([14, 16])),
        "voltage_range": 10.0,
        "control_rate": rate,
        "gravity": 0.0,
    }
    tolerance = {"mass": 0.005, "actuator_gain": 0.02, "negative_stiffness": 0.03, "probe_gain": 0.005}
    if family == "stand":
        tolerance["support_stiffness"] = 0.01
    spring = own["support_stiffness"] + stiffness
    axes = 2 if family == "xy" else 1
    return _ready(family, "electromagnet_pair", axes, parameters, tolerance, bandwidth, gain, stiffness, spring, rng)


def _ball(rng: np.random.Generator) -> BenchRig:
    mass, gap, bias = log_uniform(rng, 0.02, 0.2), float(rng.uniform(5e-3, 12e-3)), float(rng.uniform(0.5, 1.5))
    length = float(rng.uniform(2.0e-3, 5.0e-3))
    if rng.random() < 0.5:  # a pull that falls off exponentially, or by a power beyond an offset
        law, steep = {"force_length": length}, 1 / length
        constant = mass * GRAVITY / bias**2 * float(np.exp(gap / length))
    else:
        exponent, offset = float(rng.uniform(2.0, 4.0)), float(rng.uniform(0.5e-3, 4e-3))
        law, steep = {"force_exponent": exponent, "gap_offset": offset}, exponent / (gap + offset)
        constant = mass * GRAVITY / bias**2 * (gap + offset) ** exponent
    gain, stiffness = 2 * mass * GRAVITY / bias, -mass * GRAVITY * steep
    bandwidth = float(rng.uniform(1.8, 2.6)) * sqrt(GRAVITY * steep)
    parameters = {
        "mass": mass,
        "gap": gap,
        "force_constant": constant,
        **law,
        "bias_current": bias,
        "coil_inductance": float(rng.uniform(20.0, 60.0)) * 1e-3,
        "coil_resistance": float(rng.uniform(3.0, 8.0)),
        "supply_voltage": 48.0,
        "amplifier_gain": 0.2,
        "amplifier_time_constant": float(rng.uniform(0.05, 0.15)) / bandwidth,
        "sensor_time_constant": float(rng.uniform(0.01, 0.04)) / bandwidth,
        "probe_gain": 8.0 / gap,
        "adc_bits": 16,
        "dac_bits": 14,
        "voltage_range": 10.0,
        "control_rate": float(rng.choice([1000.0, 2000.0])),
        "gravity": GRAVITY,
    }
    tolerance = {"mass": 0.005, "actuator_gain": 0.03, "negative_stiffness": 0.04, "probe_gain": 0.01}
    return _ready("ball", "electromagnet", 1, parameters, tolerance, bandwidth, gain, stiffness, stiffness, rng)


def _ready(family, magnet, axes, parameters, tolerance, bandwidth, gain, stiffness, spring, rng) -> BenchRig:
    """The rig with its noise and gains that place the closed loop's poles at the bandwidth."""
    mass, gap = parameters["mass"], parameters["gap"]
    noise = {"displacement": log_uniform(rng, 4e-5, 2.5e-4) * gap, "current": 1e-3}
    if family != "ball":
        noise["force"] = 3e-5 * mass * bandwidth**2 * gap
    damping = float(rng.uniform(0.7, 0.95))
    pid = {
        "kp": (mass * bandwidth**2 - spring) / gain,
        "ki": 0.12 * mass * bandwidth**3 / gain,
        "kd": 2 * damping * mass * bandwidth / gain,
        "td": 1 / (8 * bandwidth),
    }
    return BenchRig(family, magnet, axes, parameters, noise, tolerance, bandwidth, gain, stiffness, pid)
