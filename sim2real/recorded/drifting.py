"""What a gain that drifts does to a recording with periods, of which the mean over these is compared.

A drift is slow beside a period. So the mean is that of a steady gain, the drifting one's mean over the periods, and the
drift itself shows in the trend over them (`sim2real.compared.drift`).
"""

from math import exp

from maglev_env.loop.effect import Effects, effect_value
from sim2real.recorded.records import Record

DRIFTING = "gain_drift"


def steady(record: Record, effects: Effects) -> Effects:
    """The effects with the mean of a drifting gain over the periods in its place."""
    if DRIFTING not in effects:
        return effects
    gain = effects.get("actuator_gain", {})
    change = (1 + gain.get("change", 0.0)) * (1 + _mean(record, effects)) - 1
    rest = {name: values for name, values in effects.items() if name != DRIFTING}
    return {**rest, "actuator_gain": {**gain, "change": max(change, -0.9)}}


def _mean(record: Record, effects: Effects) -> float:
    """Mean relative change of the gain over the periods that are kept."""
    rate, settling = (effect_value(effects, DRIFTING, key) for key in ("rate", "settling"))
    begun, lasting = record.start, record.count / record.experiment.fundamental
    if settling * (begun + lasting) < 1e-6:
        return rate * (begun + 0.5 * lasting)
    left = exp(-settling * begun) - exp(-settling * (begun + lasting))
    return rate / settling * (1 - left / (settling * lasting))
