"""Loops that are recorded without a period: rigs, how far they are moved, and what is not known of them."""

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from maglev_env.loop.effect import Effects
from maglev_env.loop.magnets.kinds import force_law
from maglev_env.rig.drawn import tangent
from maglev_env.rig.rig import Rig
from maglev_env.rig.rig_file import RIG_FOLDER, rig_from_toml

# A steel ball below a coil, of which every step of the command moves the current by a third at most.
BALL = """\
schema = "maglev-rig/1"
name = "ball"
magnet = "electromagnet"

[parameters]
mass = 0.0583
gap = 11e-3                     # 8 mm of air, and 3 mm that the law's fit adds
clearance = 8e-3
force_constant = 8.54e-5
amplifier_gain = 0.3
amplifier_time_constant = 1e-3
probe_gain = 1000.0
adc_bits = 12
dac_bits = 12
control_rate = 1000.0

[gains]
kp = 480.0
ki = 700.0
kd = 8.0
td = 1.5e-3
ti = 0.5

[noise]
displacement = 5e-6
current = 3e-3

[tolerance]
mass = 0.002
actuator_gain = 0.05
negative_stiffness = 0.05
probe_gain = 0.01
amplifier_time_constant = 0.2
"""


@dataclass(frozen=True)
class Bench:
    """A rig as its engineer describes it.

    Args:
        toml: text of the rig file.
        travel: how far set points move the rotor, m.
    """

    toml: str
    travel: float

    @property
    def rig(self) -> Rig:
        return rig_from_toml(self.toml, "bench")


BENCHES: Mapping[str, Bench] = {
    **{
        name: Bench((RIG_FOLDER / f"{name}.toml").read_text(), travel)
        for name, travel in (("hmb_free", 1e-5), ("hmb_radial", 1e-5), ("eframe", 3e-5))
    },
    "ball": Bench(BALL, 1e-4),
}


@dataclass(frozen=True)
class Real:
    """A rig as it is.

    Args:
        rig: its parameters.
        effects: what it has beyond them.
        current: that it needs at rest beyond what the engineer takes for the bias, A.
        truth: of what is estimated, by name, SI.
    """

    rig: Rig
    effects: Effects
    current: float
    truth: Mapping[str, float]


def real(nominal: Rig, rng: np.random.Generator) -> Real:
    """A rig that differs from the nominal one as its tolerances say, and whose command comes late by up to a sample.

    A suspended mass keeps its nominal working point: its force law has another constant and another distance, so that
    its curvature differs too, and another current carries it.
    """
    off = {name: sigma * rng.standard_normal() for name, sigma in nominal.tolerance.items()}
    delay = rng.uniform() / nominal.control_rate
    scaled = ("mass", "support_stiffness", "amplifier_time_constant")
    parameters = {name: getattr(nominal, name) * (1 + off[name]) for name in scaled if name in off}
    gain, stiffness = (value * (1 + off[name]) for name, value in tangent(nominal).items())
    if nominal.magnet == "electromagnet":
        weight = parameters["mass"] * nominal.gravity
        gap = -2 * weight / stiffness
        parameters |= {"gap": gap, "force_constant": (gap * gain / 2) ** 2 / weight}
    else:
        parameters |= {"actuator_gain": gain, "negative_stiffness": stiffness}
    rig = replace(nominal, **parameters)
    truth = {
        "actuator_gain": gain,
        "negative_stiffness": stiffness,
        "support_stiffness": rig.support_stiffness,
        "damping": rig.support_damping,
        "delay": delay,
    }
    effects = {"sensor_gain": {"change": off["probe_gain"]}, "delay": {"time": delay}}
    return Real(rig, effects, force_law(rig).bias_current - force_law(nominal).bias_current, truth)
