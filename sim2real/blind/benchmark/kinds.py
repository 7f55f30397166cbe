"""What the benchmark puts into a rig: every effect of the vocabulary and what no vocabulary holds, with their scales.

Sizes are stated relative to the rig, so that one table serves a ball of 10 mm and a rotor of 0.3 mm.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from math import pi

import numpy as np

from sim2real.blind.benchmark import at
from sim2real.blind.benchmark.rigs import BenchRig, log_uniform

Others = Callable[[BenchRig, np.random.Generator], dict[int, float]]


def _none(rig: BenchRig, rng: np.random.Generator) -> dict[int, float]:
    return {}


@dataclass(frozen=True)
class Kind:
    """An effect whose size sets one value of the loop: scale(rig) * size, or scale(rig) / size if `inverse`.

    Attributes:
        block: Its block.
        value: Index of the value in `at`.
        scale: From the rig to the value at size 1, a large effect.
        signed: Whether its sign is drawn.
        most: Largest size.
        others: Draws its other values.
        families: Rigs on which it has a meaning.
        inverse: A limit: the smaller the value, the larger the effect.
        spins: It needs a rotor that turns.
        random: It acts at random, so that its mean is taken over draws.
        rough: It acts otherwise where noise moves the loop, so that its mean is taken over draws of the noise. The
            others act with noise as without, to less than a tenth of their strength.
    """

    block: str
    value: int
    scale: Callable[[BenchRig], float]
    signed: bool = False
    most: float = 3.0
    others: Others = _none
    families: tuple[str, ...] = ("rotor", "stand", "xy", "ball")
    inverse: bool = False
    spins: bool = False
    random: bool = False
    rough: bool = False

    def values(self, rig: BenchRig, size: float, others: Mapping[int, float]) -> dict[int, float]:
        """Values of the simulated loop, by index, with an effect of this size (of either sign)."""
        return {self.value: self.scale(rig) / abs(size) if self.inverse else self.scale(rig) * size, **others}


def _relative(value: float) -> Callable[[BenchRig], float]:
    return lambda rig: value


def _gaps(share: float) -> Callable[[BenchRig], float]:
    return lambda rig: share * rig.parameters["gap"]


def _amperes(share: float) -> Callable[[BenchRig], float]:
    return lambda rig: share * rig.parameters["bias_current"]


def _newtons(share: float) -> Callable[[BenchRig], float]:
    """In forces that move the rotor by the gap, at its bandwidth."""
    return lambda rig: share * rig.parameters["mass"] * rig.bandwidth**2 * rig.parameters["gap"]


def _stiff(share: float) -> Callable[[BenchRig], float]:
    return lambda rig: share * rig.parameters["mass"] * rig.bandwidth**2


def _damps(share: float) -> Callable[[BenchRig], float]:
    return lambda rig: share * rig.parameters["mass"] * rig.bandwidth


def _seconds(turns: float) -> Callable[[BenchRig], float]:
    return lambda rig: turns / rig.bandwidth


def _flux(rig: BenchRig) -> float:
    """Flux at rest, in the unit of `plant.flux`."""
    p = rig.parameters
    if rig.family != "ball":
        return p["bias_current"] / p["gap"]
    if "force_length" in p:
        return p["bias_current"] * float(np.exp(-0.5 * p["gap"] / p["force_length"]))
    return p["bias_current"] * (p["gap"] + p["gap_offset"]) ** (-0.5 * p["force_exponent"])


def _mode(frequency: int, damping: int) -> Others:
    return lambda rig, rng: {
        frequency: rig.bandwidth * log_uniform(rng, 0.5, 2.2),
        damping: log_uniform(rng, 0.01, 0.05),
    }


def _angle(rng: np.random.Generator) -> float:
    return float(rng.uniform(0, 2 * pi))


def _linkage(rig: BenchRig, rng: np.random.Generator) -> dict[int, float]:
    slow = 0.02 * rig.parameters["gap"] * rig.bandwidth
    return {
        at.SLIP: rig.parameters["gap"] * log_uniform(rng, 1e-3, 5e-3),
        at.STATIC: rng.uniform(0, 0.5),
        at.SLOW: slow,
    }


# All effects of the cards but actuator_offset: a controller that integrates brings back the current that pulls, and of
# the mean current no campaign states the zero.
VOCABULARY: Mapping[str, Kind] = {
    "delay": Kind("controller", at.DELAY, _seconds(0.1)),
    "deadband": Kind("controller", at.DEADBAND, _amperes(0.02), rough=True),
    "dropped_samples": Kind("controller", at.DROPS, _relative(0.15), False, 3.0, random=True),
    "amplifier_lag": Kind("amplifier", at.LAG, _seconds(0.1)),
    "amplifier_voltage_limit": Kind("amplifier", at.VOLTAGE, _relative(1.0), most=20.0, inverse=True, rough=True),
    "actuator_gain": Kind("actuator", at.GAIN, _relative(0.2), True, 1.4),
    "asymmetric_gain": Kind("actuator", at.ASYMMETRY, _relative(0.1), True),
    "gain_drift": Kind(
        "actuator", at.DRIFT, _relative(0.1), True, 2.0, lambda rig, rng: {at.DRIFT_TIME: rng.uniform(1, 4)}
    ),
    "negative_stiffness": Kind("actuator", at.STIFFENING, _relative(0.2), True, 2.0),
    "force_law": Kind("actuator", at.FRINGING, _relative(0.3), True),
    "eccentricity": Kind("actuator", at.ECCENTRICITY, _gaps(0.05), True),
    "eddy_current": Kind("actuator", at.DIFFUSION, _seconds(0.15)),
    "hysteresis": Kind(
        "actuator",
        at.HYSTERESIS,
        _relative(0.1),
        False,
        5.0,
        lambda rig, rng: {at.WIDTH: rig.parameters["bias_current"] * log_uniform(rng, 0.01, 0.05)},
        rough=True,
    ),
    "saturation": Kind(
        "actuator",
        at.FLUX_LIMIT,
        lambda rig: 1.2 * _flux(rig),
        False,
        1.3,
        lambda rig, rng: {at.KNEE: rng.uniform(3, 9)},
        inverse=True,
    ),
    "cross_coupling": Kind("mechanics", at.CROSSED, _relative(0.05), True, families=("xy",)),
    "sensor_gain": Kind("sensor", at.SCALE, _relative(0.05), True, 1.4),
    "sensor_lag": Kind("sensor", at.SLUGGISH, _seconds(0.1)),
    "sensor_resonance": Kind("sensor", at.MOUNT_RATIO, _relative(0.05), True, 4.0, _mode(at.MOUNT, at.MOUNT_DAMPING)),
    "runout": Kind(
        "sensor",
        at.RUNOUT,
        _gaps(0.01),
        others=lambda rig, rng: {at.RUNOUT_SHAPE: rng.uniform(0.1, 0.5), at.RUNOUT_PHASE: _angle(rng)},
        families=("rotor", "stand", "xy"),
        spins=True,
    ),
    "pickup": Kind(
        "sensor",
        at.PICKUP,
        _gaps(0.002),
        others=lambda rig, rng: {
            at.MAINS: float(rng.choice([50.0, 60.0]) + rng.uniform(-0.1, 0.1)),
            at.MAINS_SHAPE: rng.uniform(0.1, 0.5),
            at.MAINS_PHASE: _angle(rng),
        },
    ),
    "probe_backlash": Kind("sensor", at.PLAY, _gaps(0.003)),
    "mass": Kind("mechanics", at.MASS, lambda rig: 0.05 * rig.parameters["mass"], True, 1.4),
    "support_stiffness": Kind(
        "mechanics", at.SUPPORT, lambda rig: 0.1 * rig.parameters["support_stiffness"], True, 1.4, families=("stand",)
    ),
    "damping": Kind("mechanics", at.DAMPING, _damps(0.2)),
    "friction": Kind("mechanics", at.FRICTION, _newtons(0.002), others=_linkage),
    "support_resonance": Kind("mechanics", at.BODY_RATIO, _relative(0.05), others=_mode(at.BODY, at.BODY_DAMPING)),
    "cubic_spring": Kind(
        "mechanics",
        at.STRING,
        _stiff(2.0),
        others=lambda rig, rng: {at.SAG_LENGTH: rig.parameters["gap"] * rng.uniform(0.3, 1.0)},
    ),
    "soft_stop": Kind(
        "mechanics",
        at.STOP_STIFFNESS,
        _stiff(5.0),
        False,
        10.0,
        lambda rig, rng: {
            at.STOP: rig.parameters["gap"] * rng.uniform(0.002, 0.008),
            at.STOP_ABOVE: float(rng.uniform() < 0.4),
        },
    ),
    "unbalance": Kind(
        "external",
        at.UNBALANCE,
        lambda rig: 0.002 * rig.parameters["mass"] * rig.parameters["gap"],
        families=("rotor", "stand", "xy"),
        spins=True,
    ),
    "foreign_vibration": Kind(
        "external",
        at.SHAKE,
        _newtons(0.005),
        others=lambda rig, rng: {
            at.SHAKE_FREQUENCY: rig.bandwidth / (2 * pi) * log_uniform(rng, 0.3, 1.5),
            at.SHAKE_PHASE: _angle(rng),
        },
    ),
}
# What no card describes. Names are for the reader only.
OUTSIDE: Mapping[str, Kind] = {
    "cable_creep": Kind(
        "mechanics",
        at.CREEP,
        _stiff(0.2),
        False,
        5.0,
        lambda rig, rng: {at.CREEP_TIME: log_uniform(rng, 2.0, 20.0) / rig.bandwidth},
    ),
    "squeeze_film": Kind("mechanics", at.SQUEEZE, _damps(50.0), False, 20.0),
    "delayed_feedback": Kind(
        "mechanics",
        at.ECHO,
        _stiff(0.05),
        True,
        4.0,
        lambda rig, rng: {at.ECHO_TIME: log_uniform(rng, 2.0, 6.0) / rig.bandwidth},
    ),
    "fluid_whirl": Kind("mechanics", at.WHIRL, _stiff(0.1), True, families=("xy",)),
    "cogging": Kind(
        "actuator",
        at.COGGING,
        _newtons(0.003),
        True,
        5.0,
        lambda rig, rng: {at.PITCH: rig.parameters["gap"] * rng.uniform(0.03, 0.1)},
    ),
    "supply_sag": Kind(
        "amplifier",
        at.SAG,
        lambda rig: 0.2 / rig.parameters["bias_current"],
        False,
        10.0,
        lambda rig, rng: {at.SAG_TIME: log_uniform(rng, 0.5, 5.0) / rig.bandwidth},
    ),
    "motion_voltage": Kind("amplifier", at.INDUCED, lambda rig: rig.pid["kp"], False, 5.0),
    "tilted_target": Kind("sensor", at.TILT, _relative(0.5), True),
    "uneven_converter": Kind(
        "sensor",
        at.UNEVEN,
        _gaps(0.003),
        False,
        3.0,
        lambda rig, rng: {at.UNEVEN_PITCH: rig.parameters["gap"] * rng.uniform(0.02, 0.08)},
    ),
    "probe_crosstalk": Kind("sensor", at.CROSSTALK, _relative(0.05), True, families=("xy",)),
}
KINDS: Mapping[str, Kind] = {**VOCABULARY, **OUTSIDE}


def known_on(rig: str, kinds: Mapping[str, Kind] = VOCABULARY) -> list[str]:
    """Names of the kinds that have a meaning on a family of rigs."""
    return [name for name, kind in kinds.items() if rig in kind.families]
