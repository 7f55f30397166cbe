"""A guess is never silent: what was taken, why, and how sure it is."""

from dataclasses import dataclass
from typing import Any

STATED, SURE, LIKELY, OPEN = 1.0, 0.9, 0.6, 0.4  # from LIKELY up a guess is used as it is; below, the user is asked


@dataclass(frozen=True)
class Guess:
    """One guess.

    Args:
        what: what is guessed, such as "sample_rate" or "channel displacement".
        value: what it is taken to be; None where nothing was found.
        reason: the evidence, in words.
        confidence: from 0 (nothing speaks for it) to 1 (stated by the file).
        ask: what the user should state or confirm; empty where the guess is good enough.
        left: share of the power of what it was fitted to that it leaves; 1 where nothing was fitted.
    """

    what: str
    value: Any
    reason: str
    confidence: float
    ask: str = ""
    left: float = 1.0
