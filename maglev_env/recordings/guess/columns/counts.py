"""Whole numbers of a converter or an encoder: what tells them, and of which order one of them is."""

import numpy as np

from maglev_env.recordings.guess import behaviour as shown
from maglev_env.recordings.guess.words import COUNTS, plain_words

_WORDS = (
    f"{COUNTS} adc hall inc increments inkremente pulses impulse impulsions points puntos pulsos pwm duty dac "
    "encoder codeur encodeur drehgeber codificador"
)
_MOST_WHOLE = 0.95
_FEWEST, _FOLLOWED = 6, 0.9  # levels at which a reading is compared with what is wanted of it; their least correlation


def holds_counts(label: str, values: np.ndarray) -> bool:
    """Whether a column is called by its converter and its values (samples,) are whole numbers."""
    if not set(_WORDS.split()) & set(plain_words(label)) or not np.ptp(values):
        return False
    return bool(np.mean(values == np.rint(values)) > _MOST_WHOLE)  # bridged gaps are not whole


def order_of_a_count(counts: np.ndarray, wanted: np.ndarray) -> float | None:
    """The power of ten by which a reading in counts follows a reference that is held, with its sign.

    No more than the order is told: a loop need not reach what is wanted of it.

    Args:
        counts: (samples,).
        wanted: the same quantity in a known unit, (samples,).

    Returns:
        Of that unit per count; None where the levels are few, or the reading does not follow them.
    """
    # Before each change a loop has come nearest to what was wanted.
    at = np.flatnonzero(np.diff(wanted)) if shown.steps_in(wanted) else np.zeros(0, int)
    if at.size < _FEWEST or abs(together := shown.correlation(counts[at], wanted[at])) < _FOLLOWED:
        return None
    slope = float(np.std(wanted[at]) / np.std(counts[at]))
    return float(np.copysign(10.0 ** np.rint(np.log10(slope)), together))
