"""What a gain that drifts does to a recording with periods, of which the mean over these is compared.

A drift is slow beside a period. So the mean is that of a steady gain, the drifting one's mean over the periods, and the
drift itself shows in the trend over them (`sim2real.compared.drift`).
"""

import numpy as np

from maglev_env.loop.effect import Effects, effect_value
from sim2real.recorded.records import Record

DRIFTING = "gain_drift"
PER_PERIOD = 16  # times in a period at which a drift is looked at


def steady(record: Record, effects: Effects) -> Effects:
    """The effects with the mean of a drifting gain over the periods in its place."""
    if DRIFTING not in effects:
        return effects
    gain = effects.get("actuator_gain", {})
    change = (1 + gain.get("change", 0.0)) * (1 + _mean(record, effects)) - 1
    rest = {name: values for name, values in effects.items() if name != DRIFTING}
    return {**rest, "actuator_gain": {**gain, "change": max(change, -0.9)}}


def trend(record: Record, effects: Effects) -> float:
    """Relative change of the gain per second over the periods that are kept, 1/s: of a straight line through it."""
    at = _times(record)
    return float(np.polyfit(at, _gains(at, effects), 1)[0])


def middle(record: Record) -> float:
    """Middle of the periods that are kept, s after the recording's begin."""
    return record.start + 0.5 * record.count / record.experiment.fundamental


def _mean(record: Record, effects: Effects) -> float:
    """Mean relative change of the gain over the periods that are kept."""
    return float(_gains(_times(record), effects).mean())


def _times(record: Record) -> np.ndarray:
    """Times after the recording's begin, evenly over the periods that are kept, s, (n,)."""
    n = record.count * PER_PERIOD
    return record.start + (np.arange(n) + 0.5) / (PER_PERIOD * record.experiment.fundamental)


def _gains(at: np.ndarray, effects: Effects) -> np.ndarray:
    """Relative change of the gain at times (n,) in s."""
    rate, settling = (effect_value(effects, DRIFTING, key) for key in ("rate", "settling"))
    return rate * (-np.expm1(-settling * at) / settling if settling else at)
