"""Effects beyond the nominal rig, as data: name, block, parameters with units, bounds and source."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from math import floor, inf, isnan
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from maglev_env.rig.rig import Rig


@dataclass(frozen=True)
class EffectParameter:
    """Unit, bounds and default of one effect parameter; absent: the value with which the effect does nothing.

    The first parameter of an effect has no default (None) and must be given.
    """

    unit: str
    low: float
    high: float
    default: float | None = None
    absent: float = 0.0


@dataclass(frozen=True)
class EffectKind:
    """One physical effect: its block, its parameters (the first is set by a bare value), its source, the channels that
    tell it from its likes, and what a rig needs for it to mean anything."""

    block: str
    parameters: Mapping[str, EffectParameter]
    source: str
    identified_by: str
    needs: tuple[str, ...] = ()


BLOCKS = ("sensor", "controller", "amplifier", "actuator", "mechanics", "external")
# In words, what a rig must have for an effect that needs it.
NEEDS = {
    "magnets": "magnets",
    "pair": "a pair of magnets",
    "two_axes": "two axes",
    "coil": "magnets and a coil_inductance",
    "support": "a support_stiffness",
}


def _parameter(
    unit: str, low: float, high: float, default: float | None = None, absent: float = 0.0
) -> EffectParameter:
    return EffectParameter(unit, low, high, default, absent)


_RELATIVE = {"change": _parameter("", -0.9, 9.0)}
_POLE = {"time_constant": _parameter("s", 0.0, 0.01)}
_DECAY = _parameter("", 0.0, 0.9, 0.0)  # each further harmonic over the one before it; three in all

EFFECTS: Mapping[str, EffectKind] = {
    "delay": EffectKind(
        "controller",
        {"time": _parameter("s", 0.0, 1e-3)},
        "computation and hold delay e^(-s T), 1 to 1.5 samples on real controllers",
        "command and current",
        ("magnets",),
    ),
    "amplifier_lag": EffectKind(
        "amplifier",
        _POLE,
        "a second amplifier pole 1 / (1 + s T) after the nominal one",
        "command and current",
        ("magnets",),
    ),
    "amplifier_voltage_limit": EffectKind(
        "amplifier",
        {"voltage": _parameter("V", 1e-3, 1e5, absent=inf)},
        "|L di/dt + R i| <= V: the coil's current cannot follow faster",
        "command and current at two amplitudes",
        ("coil",),
    ),
    "actuator_gain": EffectKind(
        "actuator",
        _RELATIVE,
        "relative change of df/di: D 5.2.3 measures 5.7, eq 3.13 1.28",
        "current, force and displacement",
        ("magnets",),
    ),
    "negative_stiffness": EffectKind(
        "actuator", _RELATIVE, "relative change of -df/dy, D eq 3.12", "current, force and displacement", ("magnets",)
    ),
    "eddy_current": EffectKind(
        "actuator",
        {"corner_hz": _parameter("Hz", 1.0, 1e6, absent=inf), "order": _parameter("", 0.3, 0.98, 0.5)},
        "current reaches the force through 1 / (1 + (s / w)^order): solid iron, order 1/2 (Zhu et al. 2005)",
        "current, force and displacement",
        ("magnets",),
    ),
    "hysteresis": EffectKind(
        "actuator",
        {"strength": _parameter("", 0.0, 0.9), "width": _parameter("A", 1e-4, 100.0, 0.1)},
        "a share of the current lags by a width, as Dahl's rate-independent model has it (Dahl 1968)",
        "current and displacement at two amplitudes",
        ("magnets",),
    ),
    "saturation": EffectKind(
        "actuator",
        {"field": _parameter("T", 0.1, 100.0, absent=inf)},
        "the iron bends: B^2 of each gap becomes B^2 / sqrt(1 + (B / B_s)^4)",
        "current and displacement at two amplitudes",
        ("pair",),
    ),
    "eccentricity": EffectKind(
        "actuator",
        {"offset": _parameter("m", -0.01, 0.01)},
        "the magnetic centre lies beside the sensed one, D 5.2.3",
        "displacement at two static offsets",
        ("magnets",),
    ),
    "sensor_gain": EffectKind(
        "sensor",
        _RELATIVE,
        "relative change of the true probe gain against its data sheet",
        "current, force and displacement",
    ),
    "sensor_lag": EffectKind("sensor", _POLE, "a second probe pole 1 / (1 + s T), D eq 3.20", "force and displacement"),
    "sensor_resonance": EffectKind(
        "sensor",
        {
            "frequency": _parameter("Hz", 1.0, 2000.0),
            "damping_ratio": _parameter("", 1e-3, 0.7, 0.02),
            "coupling": _parameter("", -0.5, 0.5, 0.05),
        },
        "the probe's mount moves with the bearing's reaction, as a second-order mode (D 7.2)",
        "force and displacement across the resonance",
    ),
    "runout": EffectKind(
        "sensor",
        {"amplitude": _parameter("m", 0.0, 1e-3), "harmonics": _DECAY, "phase": _parameter("rad", -7.0, 7.0, 0.0)},
        "the sensed surface is not round: a reading at 1x, 2x and 3x of the speed",
        "displacement at two speeds",
    ),
    "pickup": EffectKind(
        "sensor",
        {
            "amplitude": _parameter("m", 0.0, 1e-3),
            "frequency": _parameter("Hz", 0.1, 1e4, 50.0),
            "harmonics": _DECAY,
            "phase": _parameter("rad", -7.0, 7.0, 0.0),
        },
        "mains in the probe's cable: a reading at 50 Hz and its harmonics",
        "displacement at standstill",
    ),
    "mass": EffectKind("mechanics", _RELATIVE, "relative change of the moving mass", "force and displacement"),
    "support_stiffness": EffectKind(
        "mechanics",
        _RELATIVE,
        "relative change of the support's stiffness, D Table 5.1",
        "force and displacement",
        ("support",),
    ),
    "damping": EffectKind(
        "mechanics",
        {"coefficient": _parameter("N s/m", -100.0, 1000.0)},
        "viscous damping added to the support",
        "force and displacement",
    ),
    "friction": EffectKind(
        "mechanics",
        {
            "force": _parameter("N", 0.0, 1e4),
            "velocity": _parameter("m/s", 1e-5, 10.0, 1e-3),
            "presliding": _parameter("m", 1e-9, 1e-3, 0.0),
        },
        "Coulomb's, smooth about rest: F v / sqrt(v^2 + v_s^2); with presliding z_s it sticks: F z / z_s, "
        "dz/dt = v - sqrt(v^2 + v_s^2) z / z_s (Dahl 1968; Canudas de Wit et al. 1995)",
        "force and displacement at two amplitudes",
    ),
    "support_resonance": EffectKind(
        "mechanics",
        {
            "frequency": _parameter("Hz", 1.0, 2000.0),
            "damping_ratio": _parameter("", 1e-3, 0.7, 0.02),
            "mass_ratio": _parameter("", 0.0, 2.0, 0.05),
        },
        "a second body on a spring on the mover; its frequency is that of the second body on a mover held fast",
        "force and displacement across the resonance",
    ),
    "cross_coupling": EffectKind(
        "mechanics",
        {"ratio": _parameter("", -0.9, 0.9)},
        "each axis' magnet force also pushes the other axis, by this ratio",
        "displacement of both axes, excited in turn",
        ("magnets", "two_axes"),
    ),
    "unbalance": EffectKind(
        "external",
        {"moment": _parameter("kg m", 0.0, 1.0), "phase": _parameter("rad", -7.0, 7.0, 0.0)},
        "a force m e Omega^2 at the speed of rotation",
        "displacement at two speeds",
    ),
}

Effects = Mapping[str, Mapping[str, float]]
NO_EFFECTS: Effects = {}


def effect(name: str, value: float | None = None, **values: float) -> dict[str, dict[str, float]]:
    """One checked effect as {name: {parameter: value}}; a bare value sets the first parameter.

    Raises ValueError naming the effect or parameter that is unknown, missing or out of bounds.
    """
    kind = EFFECTS.get(name)
    if kind is None:
        raise ValueError(f"effect {name!r} is unknown; known effects: {', '.join(sorted(EFFECTS))}")
    if value is not None:
        values = {next(iter(kind.parameters)): value, **values}
    for key, v in values.items():
        parameter = kind.parameters.get(key)
        if parameter is None:
            raise ValueError(f"effect {name}: no parameter {key!r}; it has {', '.join(kind.parameters)}")
        if isnan(v) or (v != parameter.absent and not parameter.low <= v <= parameter.high):
            raise ValueError(
                f"effect {name}.{key} = {v} is outside {parameter.low} .. {parameter.high} {parameter.unit}"
            )
    missing = [key for key, parameter in kind.parameters.items() if key not in values and parameter.default is None]
    if missing:
        raise ValueError(f"effect {name}: give {', '.join(missing)}")
    return {name: {key: values.get(key, parameter.default) for key, parameter in kind.parameters.items()}}


def parse_effect(text: str) -> dict[str, dict[str, float]]:
    """Read `delay=75e-6` or `sensor_lag.time_constant=2e-5,other=...` as the command line writes it."""
    head, _, rest = text.partition("=")
    name, _, first = head.partition(".")
    pairs = [(first or None, rest)] if "," not in rest else []
    if not pairs:
        value, *more = rest.split(",")
        pairs = [(first or None, value)] + [tuple(item.partition("=")[::2]) for item in more]
    bare, named = None, {}
    for key, raw in pairs:
        try:
            number = float(raw)
        except ValueError:
            raise ValueError(f"effect {text!r}: {raw!r} is not a number; write name=value") from None
        if key is None:
            bare = number
        else:
            named[key.strip()] = number
    return effect(name.strip(), bare, **named)


def check_effects(effects: Effects, rig: "Rig") -> None:
    """Raise ValueError unless every effect is known, complete, inside its bounds and has a meaning on the rig."""
    for name, values in effects.items():
        effect(name, **values)
        for need in EFFECTS[name].needs:
            if not has(rig, need):
                raise ValueError(f"effect {name} has no meaning on rig {rig.name}: it needs {NEEDS[need]}")


def meaningful(name: str, rig: "Rig") -> bool:
    """Whether a rig has what an effect needs."""
    return all(has(rig, need) for need in EFFECTS[name].needs)


def has(rig: "Rig", need: str) -> bool:
    """Whether a rig has one of NEEDS."""
    match need:
        case "pair":
            return rig.magnet in ("hybrid_pair", "electromagnet_pair")
        case "two_axes":
            return rig.axes == 2
        case "coil":
            return rig.controlled and rig.coil_inductance is not None
        case "support":
            return rig.support_stiffness > 0
    return rig.controlled


def effect_value(effects: Effects, name: str, parameter: str | None = None) -> float:
    """A parameter of an effect (default: its first), or where the effect is absent the value that means so."""
    parameters = EFFECTS[name].parameters
    key = parameter or next(iter(parameters))
    rest = parameters[key].absent if parameters[key].default is None else parameters[key].default
    return effects.get(name, {}).get(key, rest)


def split_delay(effects: Effects, dt: float) -> tuple[int, float]:
    """The delay effect as whole samples of dt (s) and the rest, s in 0 .. dt."""
    delay = effect_value(effects, "delay")
    whole = floor(delay / dt * (1 + 1e-12))
    return whole, min(max(delay - whole * dt, 0.0), dt)


def parse_effects(texts: Iterable[str]) -> dict[str, dict[str, float]]:
    """Several `--effect` values as one mapping; ValueError when one is named twice."""
    merged: dict[str, dict[str, float]] = {}
    for text in texts:
        parsed = parse_effect(text)
        if twice := parsed.keys() & merged.keys():
            raise ValueError(f"effect {twice.pop()} is given twice")
        merged.update(parsed)
    return merged
