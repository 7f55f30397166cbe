"""Effects beyond the nominal rig: the registry of all cards; reading, checking and looking up effects as data."""

from collections.abc import Iterable, Mapping, Set
from math import floor, isnan
from numbers import Real
from typing import Protocol

from maglev_env.loop import actuator, amplifier, controller, external, mechanics, sensor
from maglev_env.loop.card import SLOWEST, EffectCard, Need, Scales
from maglev_env.loop.free import places as free
from maglev_env.loop.further import blocks as further

BLOCKS = ("sensor", "controller", "amplifier", "actuator", "mechanics", "external")
# Descriptions, for messages, of what a rig must have so that an effect has a meaning.
NEEDS: Mapping[Need, str] = {
    "magnets": "magnets",
    "pair": "a pair of magnets",
    "iron": "a single magnet that pulls on iron",
    "yoke": "magnets that pull on iron",
    "two_axes": "two axes",
    "coil": "magnets and a coil_inductance",
    "support": "a support_stiffness",
}


def _registry(*blocks: Mapping[str, EffectCard]) -> dict[str, EffectCard]:
    """All cards in one table.

    Raises:
        ImportError: Two cards have the same name, or a card lacks what a diagnosis needs.
    """
    found: dict[str, EffectCard] = {}
    for block in blocks:
        if twice := found.keys() & block.keys():
            raise ImportError(f"effect {twice.pop()} has two cards")
        found |= block
    for name, card in found.items():
        if card.not_fitted:
            continue
        for key, p in card.plain.items():
            if not p.starts:
                raise ImportError(f"effect {name}.{key}: its card gives no starts for a fit, and no not_fitted reason")
            if p.scale is None and p.low <= 0:
                raise ImportError(f"effect {name}.{key}: a parameter fitted by its logarithm needs a positive low")
    return found


EFFECTS: Mapping[str, EffectCard] = _registry(
    controller.EFFECTS,
    amplifier.EFFECTS,
    actuator.EFFECTS,
    sensor.EFFECTS,
    mechanics.EFFECTS,
    external.EFFECTS,
    *(block.EFFECTS for block in further.BLOCKS),
    free.EFFECTS,
)

Effects = Mapping[str, Mapping[str, float]]
NO_EFFECTS: Effects = {}
FINER = 100.0  # a rig's bounds are widened by this where its control period is that of a simulation, not of its own


def effect(name: str, value: float | None = None, **values: float) -> dict[str, dict[str, float]]:
    """One checked effect as data.

    Args:
        name: of the effect, a key of `EFFECTS`.
        value: of its first parameter.
        values: of its parameters by name, SI.

    Returns:
        {name: {parameter: value}} with the defaults of the parameters that are not given, except those of its form.

    Raises:
        ValueError: The effect or a parameter is unknown, missing or out of bounds; the message names it.
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
        _check_bounds(name, key, v, SLOWEST)
    given = {key: values.get(key, p.default) for key, p in kind.parameters.items() if p.shape is None or key in values}
    missing = [key for key, v in given.items() if v is None]
    if missing:
        raise ValueError(f"effect {name}: give {', '.join(missing)}")
    return {name: {key: v for key, v in given.items() if v is not None}}


def _check_bounds(name: str, key: str, v: float, scales: Scales, rig: str = "") -> None:
    p = EFFECTS[name].parameters[key]
    low, high = p.range_on(scales)
    if isnan(v) or (v != p.absent and not low <= v <= high):
        where = f"{low:.6g} .. {high:.6g} {p.unit}".strip() + (rig if p.per else "")
        raise ValueError(f"effect {name}.{key} = {v} is outside {where}")


def parse_effect(text: str) -> dict[str, dict[str, float]]:
    """An effect from the command line's notation: `delay=75e-6` or `friction.force=0.05,velocity=1e-3`.

    Raises:
        ValueError: As `effect`, a value is not a number, or a parameter is given twice.
    """
    head, _, rest = text.partition("=")
    name, _, first = head.partition(".")
    pairs = [(first or None, rest)] if "," not in rest else []
    if not pairs:
        value, *more = rest.split(",")
        pairs = [(first or None, value)] + [tuple(item.partition("=")[::2]) for item in more]
    name = name.strip()
    leading = next(iter(EFFECTS[name].parameters)) if name in EFFECTS else None
    named: dict[str, float] = {}
    for key, raw in pairs:
        try:
            number = float(raw)
        except ValueError:
            raise ValueError(f"effect {text!r}: {raw!r} is not a number; write name=value") from None
        parameter = leading if key is None else key.strip()
        if parameter in named:
            raise ValueError(f"effect {text!r}: {parameter} is given twice")
        if parameter is not None:
            named[parameter] = number
    return effect(name, **named)


def as_effects(effects: Mapping[str, Mapping[str, float] | float]) -> Effects:
    """Effects as `effect` gives them, where a bare number stands for the first parameter, as on the command line.

    Raises:
        ValueError: As `effect`, or what is given has another form.
    """
    if not isinstance(effects, Mapping):
        raise ValueError(f"effects = {effects!r}; give {{name: value}} or {{name: {{parameter: value}}}}")
    found: dict[str, Mapping[str, float]] = {}
    for name, values in effects.items():
        named = values if isinstance(values, Mapping) else {None: values}
        for key, value in named.items():
            if isinstance(value, bool) or not isinstance(value, Real):
                raise ValueError(f"effect {name}: {f'{key} = ' if key else ''}{value!r} is not a number")
        found |= effect(name, **values) if isinstance(values, Mapping) else effect(name, values)
    return found


class Levitated(Protocol):
    """What of a rig decides which effects it may have."""

    @property
    def name(self) -> str: ...

    @property
    def capabilities(self) -> Set[Need]:
        """See `NEEDS`."""
        ...

    @property
    def scales(self) -> Scales: ...


def check_effects(effects: Effects, rig: Levitated, finer: float = 1.0) -> None:
    """Check that every effect is known, complete, within its bounds and meaningful on a rig.

    Args:
        effects: the effects.
        rig: the rig.
        finer: how many times shorter than the rig's own the control period may be in what is simulated.

    Raises:
        ValueError: An effect is not; the message names it.
    """
    if not effects:
        return
    scales = rig.scales.wider(finer)
    for name, values in effects.items():
        if not isinstance(values, Mapping):
            raise ValueError(f'effect {name} = {values!r:.50}: give its parameters by name, as effect("{name}", value)')
        for key, v in effect(name, **values)[name].items():
            _check_parameter(name, key, v, rig)
            _check_beside(name, key, v, effects)
            _check_bounds(name, key, v, scales, f" on rig {rig.name}")
        for need in EFFECTS[name].needs:
            if need not in rig.capabilities:
                raise ValueError(f"effect {name} has no meaning on rig {rig.name}: it needs {NEEDS[need]}")


def _check_parameter(name: str, key: str, v: float, rig: Levitated) -> None:
    """Refuse a parameter that has no meaning on a rig."""
    parameters = EFFECTS[name].parameters
    lacking = [need for need in parameters[key].needs if need not in rig.capabilities]
    if lacking and v != parameters[key].absent:
        others = [k for k, other in parameters.items() if rig.capabilities.issuperset(other.needs)]
        raise ValueError(
            f"effect {name}.{key} has no meaning on rig {rig.name}: it needs {NEEDS[lacking[0]]}; give one of "
            f"{', '.join(others)} instead"
        )


def _check_beside(name: str, key: str, v: float, effects: Effects) -> None:
    """Refuse a parameter beside an effect with which it is not simulated."""
    parameter = EFFECTS[name].parameters[key]
    beside = [other for other in parameter.apart_from if other in effects]
    if beside and v != parameter.absent:
        raise ValueError(f"effect {name}.{key} is not simulated beside {beside[0]}; leave one of them out")


def meaningful(name: str, capabilities: Set[Need]) -> bool:
    """Whether a rig with these capabilities has what an effect needs."""
    return capabilities >= set(EFFECTS[name].needs)


def shaped(effects: Effects) -> bool:
    """Whether an effect has a form that only the shaped kernel simulates."""
    return any(
        values.get(key, p.default) != p.default
        for name, values in effects.items()
        for key, p in EFFECTS[name].shapes.items()
        if key not in EFFECTS[name].plain_kernel
    )


def effect_value(effects: Effects, name: str, parameter: str | None = None) -> float:
    """A parameter of an effect (default: its first); if the effect is absent, the value that changes nothing."""
    parameters = EFFECTS[name].parameters
    key = parameter or next(iter(parameters))
    default = parameters[key].default
    return effects.get(name, {}).get(key, parameters[key].absent if default is None else default)


def split_delay(effects: Effects, dt: float) -> tuple[int, float]:
    """The effect delay as a number of whole samples of dt (s) and the remaining time, 0 .. dt (s)."""
    delay = effect_value(effects, "delay")
    whole = floor(delay / dt * (1 + 1e-12))
    return whole, min(max(delay - whole * dt, 0.0), dt)


def parse_effects(texts: Iterable[str]) -> dict[str, dict[str, float]]:
    """Several `--effect` values as one mapping.

    Raises:
        ValueError: As `parse_effect`, or an effect is given twice.
    """
    merged: dict[str, dict[str, float]] = {}
    for text in texts:
        parsed = parse_effect(text)
        if twice := parsed.keys() & merged.keys():
            raise ValueError(f"effect {twice.pop()} is given twice")
        merged.update(parsed)
    return merged
