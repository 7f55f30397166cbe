"""What is said of how long a block lags where a lag of it is named."""

from collections.abc import Collection
from math import inf, pi, sqrt

from sim2real.result import Diagnosis
from sim2real.search.hypotheses import REPLACED, added_lag, dead_part, usual_tolerances
from sim2real.words import quantity


def whole_lags(diagnosis: Diagnosis, causes: Collection[str]) -> list[str]:
    """How long a block lags in all where a lag of it is named and this says more than the time constant alone: where a
    part is simulated as dead time, or the stated time constant has no tolerance or moved beyond it, and each share says
    nothing. A loop of second order with a lead hardly lags: it is said what it is.

    Args:
        diagnosis: The diagnosis.
        causes: The effects that it names.
    """
    found, effects = [], diagnosis.corrected.effects
    for effect, name in REPLACED.items():
        change, sure = diagnosis.corrected.changes.get(name, 0.0), diagnosis.rig.tolerance.get(name, inf)
        stated, block = getattr(diagnosis.rig, name), effect.removesuffix("_lag")
        if stated and effects.get(effect, {}).get("lead"):
            found.append(f"the {block} is {_loop_in_words(stated * (1 + change), **effects[effect])}")
            continue
        shared = name in usual_tolerances(diagnosis.rig) or abs(change) >= sure
        if effect not in effects or not (shared or dead_part(effects, effect, causes, diagnosis.rig.effects)):
            continue
        whole = stated * (1 + change) + added_lag(effects, effect, causes, diagnosis.rig.effects)
        found.append(f"the {block} lags by {quantity(whole, None, 's')} ({quantity(stated, None, 's')} stated)")
    return found


def _loop_in_words(first: float, time_constant: float, lead: float, feedback: float = 0.0) -> str:
    """What poles of the time constants `first` and `time_constant` (s) are together, see the card of amplifier_lag."""
    turn = 1 / sqrt(first * time_constant)
    damping = (first + (1 - feedback) * time_constant) * turn / 2
    natural, zero = (quantity(rate / (2 * pi), None, "Hz") for rate in (turn, 1 / (lead * time_constant)))
    return f"a loop of second order of {natural} with a damping ratio of {damping:.2g}, and a zero at {zero}"
