"""Effects beyond the nominal rig, as data: name, block, parameters with units, bounds and source."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from math import floor

from numpy import isfinite


@dataclass(frozen=True)
class EffectParameter:
    """Unit, bounds and the value that means "absent" of one effect parameter."""

    unit: str
    low: float
    high: float
    absent: float = 0.0


@dataclass(frozen=True)
class EffectKind:
    """One physical effect: the block it sits in, its parameters (the first is set by a bare value), its source."""

    block: str
    parameters: Mapping[str, EffectParameter]
    source: str


_RELATIVE = {"change": EffectParameter("", -0.9, 9.0)}
_POLE = {"time_constant": EffectParameter("s", 0.0, 0.01)}

EFFECTS: Mapping[str, EffectKind] = {
    "delay": EffectKind(
        "controller",
        {"time": EffectParameter("s", 0.0, 1e-3)},
        "computation and hold delay e^(-s T), 1 to 1.5 samples on real controllers",
    ),
    "amplifier_lag": EffectKind("amplifier", _POLE, "a second amplifier pole 1 / (1 + s T) after the nominal one"),
    "actuator_gain": EffectKind("actuator", _RELATIVE, "relative change of df/di: D 5.2.3 measures 5.7, eq 3.13 1.28"),
    "negative_stiffness": EffectKind("actuator", _RELATIVE, "relative change of -df/dy, D eq 3.12"),
    "sensor_gain": EffectKind("sensor", _RELATIVE, "relative change of the true probe gain against its data sheet"),
    "sensor_lag": EffectKind("sensor", _POLE, "a second probe pole 1 / (1 + s T), D eq 3.20"),
    "mass": EffectKind("mechanics", _RELATIVE, "relative change of the moving mass"),
    "support_stiffness": EffectKind("mechanics", _RELATIVE, "relative change of the support's stiffness, D Table 5.1"),
    "damping": EffectKind(
        "mechanics", {"coefficient": EffectParameter("N s/m", -100.0, 1000.0)}, "viscous damping added to the support"
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
        if not isfinite(v) or not parameter.low <= v <= parameter.high:
            raise ValueError(
                f"effect {name}.{key} = {v} is outside {parameter.low} .. {parameter.high} {parameter.unit}"
            )
    missing = [key for key in kind.parameters if key not in values]
    if missing:
        raise ValueError(f"effect {name}: give {', '.join(missing)}")
    return {name: dict(values)}


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


def check_effects(effects: Effects) -> None:
    """Raise ValueError unless every effect is known, complete and inside its bounds."""
    for name, values in effects.items():
        effect(name, **values)


def effect_value(effects: Effects, name: str) -> float:
    """The first parameter of an effect, or its absent value."""
    key, parameter = next(iter(EFFECTS[name].parameters.items()))
    return effects.get(name, {}).get(key, parameter.absent)


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
