"""The parameters that give an effect a certain size in a campaign, in multiples of its detection threshold."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from sim2real.blind.forms import PARAMETER_OF
from sim2real.blind.menu import KINDS, Kind
from sim2real.blind.threshold import Detector
from sim2real.blind.twin import TONAL, LoopFailed

TOLERANCE = 0.05  # relative tolerance of the wanted size
EVALUATIONS = 9
FARTHEST = 8.0  # largest factor of one step of the search


@dataclass(frozen=True)
class Sized:
    """An effect of a certain size.

    Attributes:
        name: Name of the effect.
        values: Its parameters.
        multiple: Its size in multiples of the threshold.
        threshold: Value of the size parameter at the threshold; nan where the effect cannot get there.
    """

    name: str
    values: dict[str, float]
    multiple: float
    threshold: float


def sized(name: str, wanted: float, detector: Detector, rng: np.random.Generator) -> Sized:
    """An effect with its other parameters drawn, as close to the wanted size as physics and the loop allow."""
    kind, others = KINDS[name], KINDS[name].others(rng)
    sign = 1.0 if not kind.low or rng.random() < 0.5 else -1.0
    high = kind.high if sign > 0 else -kind.low

    if name in TONAL or name in PARAMETER_OF or name == "gain_drift":
        unit = _linear_size(name, kind.values(kind.start, sign, others), detector) / kind.start
        size = min(wanted / unit, high)
        return Sized(name, kind.values(size, sign, others), size * unit, _value(kind, 1 / unit, sign))

    def measure(size: float) -> float:
        return detector.size({name: kind.values(size, sign, others)})

    at_one, reached = search(measure, 1.0, kind.start, high)
    threshold = _value(kind, at_one, sign) if reached > 1 - 2 * TOLERANCE else np.nan
    size, multiple = search(measure, wanted, at_one * wanted, high)
    return Sized(name, kind.values(size, sign, others), multiple, threshold)


def _value(kind: Kind, size: float, sign: float) -> float:
    return kind.values(size, sign, {})[kind.parameter]


def _linear_size(name: str, values: dict[str, float], detector: Detector) -> float:
    """The size of an effect whose size is proportional to its parameter."""
    if name in PARAMETER_OF:
        return detector.parameter_size(PARAMETER_OF[name], values["change"])
    spin = detector.truth.speed_rpm / 60
    match name:
        case "runout":
            return detector.tone_size(values["amplitude"], spin, at_force=False)
        case "pickup":
            return detector.tone_size(values["amplitude"], values["frequency"], at_force=False)
        case "unbalance":
            force = values["moment"] * (2 * np.pi * spin) ** 2
            return detector.tone_size(force, spin, at_force=True)
        case "foreign_vibration":
            whole = values["force"] * np.sqrt(values["tones"])
            return detector.tone_size(whole, values["frequency0"], at_force=True)
    return detector.drift_size(values["change"])


def search(measure: Callable[[float], float], wanted: float, start: float, high: float) -> tuple[float, float]:
    """Argument at which an increasing measure is `wanted`, at most `high`, and the measure there.

    Arguments at which the measure fails (LoopFailed) count as too large. Steps are taken in logarithms, because the
    measure is nearly a power of its argument.

    Raises:
        LoopFailed: Nothing else is found.
    """
    low, below, found = 0.0, 0.0, (0.0, 0.0)
    x, failed = min(start, high), False
    for _ in range(EVALUATIONS):
        try:
            y = measure(x)
        except LoopFailed:
            failed, high, above = True, x, None
        else:
            if abs(np.log(max(y, 1e-12) / wanted)) < TOLERANCE:
                return x, y
            if y < wanted:
                low, below = x, y
                found = (x, y)
                if x == high:
                    return found
            else:
                high, above, failed = x, y, True
        if low == 0.0:
            x = high / 4 if above is None else high * max(wanted / above, 1 / FARTHEST)
        elif not failed:
            x = min(low * min(wanted / below if below > 0 else FARTHEST, FARTHEST), high)
        elif above is None or below <= 0:
            x = np.sqrt(low * high)
        else:
            share = np.log(wanted / below) / np.log(above / below)
            x = low * (high / low) ** min(max(share, 0.1), 0.9)
    if found[1] == 0.0:
        raise LoopFailed(f"no size between 0 and {high:g} stands and shows")
    return found
