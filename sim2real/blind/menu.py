"""What the generator may inject: the block, size parameter and limits of every effect, and what else is drawn."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np

Draw = Callable[[np.random.Generator], dict[str, float]]


@dataclass(frozen=True)
class Kind:
    """An effect that can be given a size: value = size^power.

    Attributes:
        block: Its block.
        parameter: The parameter that its size sets.
        start: Size at which a search starts.
        high: Largest size.
        low: If not zero, the sign is drawn, and negative sizes extend to low.
        power: Exponent.
        others: Draws its other parameters.
        rig: The only rig on which it has a meaning; None for any rig.
    """

    block: str
    parameter: str
    start: float
    high: float
    low: float = 0.0
    power: float = 1.0
    others: Draw = lambda rng: {}
    rig: str | None = None

    def values(self, size: float, sign: float, others: Mapping[str, float]) -> dict[str, float]:
        """The effect's parameters at a size."""
        return {self.parameter: float(sign * size**self.power), **others}


def _log(rng: np.random.Generator, low: float, high: float) -> float:
    return float(np.exp(rng.uniform(np.log(low), np.log(high))))


def _mode(rng: np.random.Generator) -> dict[str, float]:
    return {"frequency": _log(rng, 35, 300), "damping_ratio": _log(rng, 0.01, 0.05)}


def _tone(rng: np.random.Generator) -> dict[str, float]:
    phases = {f"phase{n}": float(rng.uniform(0, 2 * np.pi)) for n in (1, 2, 3)}
    return {"harmonics": float(rng.uniform(0.1, 0.5)), **phases}


def _foreign(rng: np.random.Generator) -> dict[str, float]:
    """A tone between the lines, or narrow-band noise as a sum of many tones."""
    tones = int(rng.choice([1, 16]))
    center = 2 * rng.integers(8, 110) + rng.uniform(0.4, 1.6)
    values: dict[str, float] = {"tones": tones}
    for n in range(tones):
        values[f"frequency{n}"] = float(center + (rng.uniform(-6, 6) if tones > 1 else 0.0))
        values[f"phase{n}"] = float(rng.uniform(0, 2 * np.pi))
    return values


# Changes of a nominal parameter end before they contradict the tolerance that the rig file states (15 times it): nobody
# weighs a mass to half a per cent and is wrong by a half.
EFFECTS: Mapping[str, Kind] = {
    "delay": Kind("controller", "time", 1e-6, 2e-4),
    "amplifier_lag": Kind("amplifier", "time_constant", 1e-6, 3e-4),
    "amplifier_voltage_limit": Kind("amplifier", "voltage", 1.6, 10.0, power=-1),
    "actuator_gain": Kind("actuator", "change", 0.2, 0.7, low=-0.5),
    "negative_stiffness": Kind("actuator", "change", 0.3, 1.5, low=-0.9),
    "force_law": Kind("actuator", "exponent", 0.05, 0.5, low=-0.2),
    "eddy_current": Kind(
        "actuator",
        "corner_hz",
        1e-3,
        0.1,
        power=-2,
        others=lambda rng: {"order": 0.5, "diffusion": _log(rng, 3e-3, 10e-3)},
    ),
    "hysteresis": Kind("actuator", "strength", 4e-3, 0.5, others=lambda rng: {"width": _log(rng, 0.02, 0.1)}),
    "saturation": Kind("actuator", "field", 0.4, 1.0, power=-1),
    "actuator_offset": Kind("actuator", "current", 0.03, 0.5, low=-0.5),
    "eccentricity": Kind("actuator", "offset", 4.5e-6, 1.2e-4, low=-1.2e-4),
    "sensor_gain": Kind("sensor", "change", 0.1, 0.28, low=-0.28),
    "sensor_lag": Kind("sensor", "time_constant", 2e-6, 3e-4),
    "sensor_resonance": Kind("sensor", "coupling", 0.002, 0.4, others=_mode),
    "runout": Kind("sensor", "amplitude", 1e-8, 1e-5, others=_tone),
    "pickup": Kind(
        "sensor",
        "amplitude",
        1e-8,
        1e-5,
        others=lambda rng: {"frequency": float(rng.choice([50.0, 60.0]) + rng.uniform(-0.1, 0.1)), **_tone(rng)},
    ),
    "mass": Kind("mechanics", "change", 0.05, 0.07, low=-0.07),
    "support_stiffness": Kind("mechanics", "change", 0.05, 0.28, low=-0.28, rig="stand"),
    "damping": Kind("mechanics", "coefficient", 0.3, 300.0),
    "friction": Kind(
        "mechanics",
        "force",
        4.5e-4,
        0.3,
        others=lambda rng: {"velocity": _log(rng, 1e-3, 5e-3), "bristle": _log(rng, 0.5e-6, 1.5e-6)},
    ),
    "support_resonance": Kind("mechanics", "mass_ratio", 0.0015, 0.6, others=_mode),
    "unbalance": Kind("external", "moment", 1e-8, 3e-6, others=_tone),
    "deadband": Kind("controller", "half_width", 1e-4, 0.1),
    "dropped_samples": Kind("controller", "probability", 0.01, 0.4),
    "asymmetric_gain": Kind("actuator", "change", 2.5e-3, 0.5, low=-0.5),
    "gain_drift": Kind("actuator", "change", 0.02, 0.4, low=-0.4),
    "cubic_spring": Kind("mechanics", "coefficient", 1e11, 1e15),
    "soft_stop": Kind("mechanics", "stiffness", 300.0, 1e6, others=lambda rng: {"distance": _log(rng, 5e-6, 1.2e-5)}),
    "probe_backlash": Kind("sensor", "half_width", 1.5e-8, 6e-6),
    "foreign_vibration": Kind("external", "force", 1e-3, 0.3, others=_foreign),
}
# Effects that the vocabulary of the diagnosis does not contain.
UNKNOWN: Mapping[str, Kind] = {
    "quadratic_probe": Kind("sensor", "coefficient", 120.0, 1.5e4, low=-1.5e4),
    "cubic_probe": Kind("sensor", "coefficient", 1e7, 3e9),
}
KINDS = {**EFFECTS, **UNKNOWN}
SPINNING = ("runout", "unbalance")


def known_on(rig: str) -> list[str]:
    """Effects of the vocabulary that have a meaning on a rig."""
    return [name for name, kind in EFFECTS.items() if kind.rig in (None, rig)]
