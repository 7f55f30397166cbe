"""What can be moved on the page: the gains of the controller and the effects of the library, each with its slider."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from math import isfinite, pi

from maglev_env.loop.card import Parameter
from maglev_env.loop.effect import EFFECTS, effect_value, meaningful
from maglev_env.loop.free import places as free
from maglev_env.loop.gain_card import stated_gains
from maglev_env.loop.gains import Controllers, of_axis
from maglev_env.rig.rig import Rig

_GAIN_WORDS: Mapping[str, str] = {
    "kp": "proportional gain",
    "ki": "integral gain",
    "kd": "derivative gain",
    "td": "derivative filter",
    "ti": "integral filter",
}
WIDER = 2.0  # a slider goes this far beyond the rig's bounds of a gain
AROUND = 10.0  # and to this many times a gain that has no bounds, and to a tenth of it
AROUND_REST = 1.1, 2.0, 20.0  # low end, value and high end of a knee, in currents that carry the weight
STEPS = 10.0  # a slider of an effect reaches this many times the size at which the effect is clearly visible


@dataclass(frozen=True)
class Input:
    """One slider with its number field; values in SI.

    Args:
        name: "kp", or the parameter's name.
        title: for people.
        unit: SI unit.
        low, high: ends of the slider; the field takes any value that the rig accepts.
        log: whether the slider is logarithmic.
        value: at the start; of an effect, when it is switched on.
    """

    name: str
    title: str
    unit: str
    low: float
    high: float
    log: bool
    value: float


@dataclass(frozen=True)
class EffectInputs:
    """One effect with its sliders.

    Args:
        name: of the effect.
        block: where in the loop it sits.
        on: whether it is switched on at the start, because the rig has it.
        linear: whether it acts in the curves; otherwise it acts in the simulated experiment alone.
        source: the formula.
        inputs: of its parameters, those of its form last.
    """

    name: str
    block: str
    on: bool
    linear: bool
    source: str
    inputs: tuple[Input, ...]


def gain_inputs(rig: Rig, controllers: Controllers, axis: int) -> tuple[Input, ...]:
    """Sliders of the gains of one axis; none where the controller is given by polynomials."""
    found = []
    for name, value, card in stated_gains(of_axis(controllers, axis)):
        low, high = _gain_range(rig, name, value, card.unit)
        title = _GAIN_WORDS.get(name, name.replace("_", " "))
        found.append(Input(name, title, card.unit, low, high, low > 0, value))
    return tuple(found)


def _gain_range(rig: Rig, name: str, value: float, unit: str) -> tuple[float, float]:
    if name in rig.bounds:
        low, high = rig.bounds[name]
        low, high = min(low, value), max(high, value)
        return (low / WIDER if low > 0 else low * WIDER), high * WIDER
    if value > 0:
        top = 0.49 * rig.control_rate if unit == "Hz" else value * AROUND
        return value / AROUND, min(value * AROUND, top)
    if value < 0:
        return value * AROUND, 0.0
    return 0.0, {"s": AROUND / rig.control_rate, "": 1.0, "A/A": 10.0}.get(unit, 1e4)


def effect_inputs(rig: Rig) -> tuple[EffectInputs, ...]:
    """Sliders of every effect that has a meaning on the rig.

    Free corrections are left out: a fit finds their coefficients, and nobody would set them by hand.
    """
    names = [name for name in EFFECTS if name not in free.NAMES and meaningful(name, rig.capabilities)]
    return tuple(
        EffectInputs(
            name, EFFECTS[name].block, name in rig.effects, EFFECTS[name].linear, EFFECTS[name].source,
            tuple(_effect_inputs(name, rig)),
        )
        for name in names
    )  # fmt: skip


def _effect_inputs(name: str, rig: Rig) -> Iterator[Input]:
    known = {key: p for key, p in EFFECTS[name].parameters.items() if rig.capabilities.issuperset(p.needs)}
    plain, forms = ({key: p for key, p in known.items() if (p.shape is None) == own} for own in (True, False))
    # Where an effect has no other size on the rig, it is the first of the places where it may sit.
    size = next(iter(plain), None) or next(key for key, p in forms.items() if p.starts)
    for key, parameter in {**plain, **forms}.items():
        p = parameter.on(rig.scales)
        low, high, log = _effect_range(p, rig)
        own = effect_value(rig.effects, name, key) if name in rig.effects else p.default
        infinite = own is not None and not isfinite(own)
        if own is None or (infinite and key == size and name not in rig.effects):  # it begins where a fit would
            own = p.starts[len(p.starts) // 2] if p.starts else (low * high) ** 0.5 if log else (low + high) / 2
            if p.beyond_rest and rig.scales.rest:
                low, own, high = (times * rig.scales.rest for times in AROUND_REST)
        if isfinite(own):  # a form parameter at infinity is the plain formula, and stays out
            low, high = float(min(low, own)), float(max(high, own))
            yield Input(key, key.removesuffix("_hz").replace("_", " "), p.unit, low, high, log and low > 0, float(own))


def _effect_range(p: Parameter, rig: Rig) -> tuple[float, float, bool]:
    """Ends of the slider of an effect's parameter, and whether it is logarithmic."""
    if p.scale is not None:
        return max(p.low, p.absent - STEPS * p.scale), min(p.high, p.absent + STEPS * p.scale), False
    sizes = [start for start in (*p.starts, p.default or 0.0) if start > 0 and isfinite(start)]
    if sizes and p.unit != "rad":
        low, high = max(p.low, min(sizes) / STEPS), min(p.high, max(sizes) * STEPS)
        return (low, high, True) if low > 0 else (p.low, high, False)
    # Sizes of tones and drifts, which no fit begins with.
    reach = {
        "m": rig.clearance / STEPS, "N": rig.mass * (rig.gravity or 1.0), "kg m": rig.mass * rig.clearance / STEPS,
        "A": rig.bias_current or 1.0, "Hz": rig.control_rate / 4, "rad": pi,
    }.get(p.unit, 1.0)  # fmt: skip
    return max(p.low, -reach), min(p.high, reach), False
