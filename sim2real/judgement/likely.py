"""What a judge says with a stated error rate: the hypotheses among which the truth is, and how rare a leftover is."""

from bisect import bisect_left
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from scipy.special import expit, logit

from sim2real.judgement.belief import LEVEL, NO_SET, Judge, channels_of
from sim2real.judgement.evidence import Evidence
from sim2real.judgement.judge import Entry, lacking
from sim2real.search.hypotheses import CALIBRATION, NONE, UNKNOWN

NOTHING = ((NONE,), (CALIBRATION,))  # hypotheses under which nothing acts
RARE = 0.1  # p-value from which on what is left is no evidence of an unknown cause
MOST_NAMED = 5  # hypotheses of a set that a sentence names


def fewest(probabilities: Sequence[float], reached: float) -> int:
    """How many hypotheses, the most probable first, have probabilities that exceed a sum together; all if none do."""
    before = np.cumsum([0.0, *probabilities])[:-1]
    return int(np.sum(before <= reached))


def likely_of(found: Sequence[Entry], evidence: Evidence, judge: Judge) -> list[Entry]:
    """The hypotheses that hold the truth in LEVEL of all campaigns on these channels.

    None where the judge knows of no set that does, or was not taught on such channels.
    """
    reached = judge.reached.get(channels_of(evidence), NO_SET)
    return [] if reached >= NO_SET else list(found[: fewest([e.probability for e in found], reached)])


def as_sure(found: Sequence[Entry], before: Sequence[Entry], judge: Judge) -> list[Entry]:
    """Hypotheses, the most probable first, of which an unknown cause is no more probable than it was right.

    What is taken from it goes to the others, as they were weighed before the holdout was asked.

    Args:
        found: hypotheses.
        before: the same before the holdout was asked.
        judge: who knows how sure an unknown cause may be.
    """
    others = sum(e.probability for e in before if e.effects != (UNKNOWN,))
    sure = any(e.effects == (UNKNOWN,) and e.probability > judge.surest for e in found)
    if not sure or not others:
        return list(found)
    was = {e.effects: e.probability for e in before}
    left = 1 - judge.surest
    now = [
        replace(e, probability=judge.surest if e.effects == (UNKNOWN,) else left * (was[e.effects] / others))
        for e in found
    ]
    return sorted(now, key=lambda e: -e.probability)


def as_right(found: Sequence[Entry], judge: Judge) -> list[Entry]:
    """Hypotheses, the most probable first, of which that one is as probable as it was right, if it says that something
    acts.

    What is taken from it goes to the others in proportion, and what it is given comes from them; but none of them
    becomes more probable than it is. That nothing acts stays as probable as it is: what it is mistaken for is too
    small to show, and no other hypothesis says so.
    """
    nothing = sum(e.probability for e in found if e.effects in NOTHING)
    first, *others = found
    p = first.probability
    if first.effects in NOTHING or nothing >= p or not p < 1:
        return list(found)
    second = max((e.probability for e in others), default=0.0)
    now = max(right_of(p, *judge.right), second / (second + 1 - p))
    rest = (1 - now) / (1 - p)
    return [replace(first, probability=now), *(replace(e, probability=rest * e.probability) for e in others)]


def right_of(p: float, a: float, b: float) -> float:
    """How often what has the probability p is right, see `Judge.right`."""
    return float(expit(a + b * logit(p)))


def rareness(evidence: Evidence, judge: Judge) -> tuple[float, int]:
    """How rarely a known cause leaves as much as the best candidate does.

    Returns:
        p: Monte-Carlo p-value, (1 + campaigns of a known cause that left as much) / (1 + all of them).
        n: How many campaigns of a known cause there were.
    """
    known = judge.left.get(channels_of(evidence), ())
    as_much = len(known) - bisect_left(known, lacking(evidence, judge))
    return (1 + as_much) / (1 + len(known)), len(known)


def likely_in_words(kept: Sequence[Entry], rare: tuple[float, int] | None) -> list[str]:
    """Sentences on the set, where it holds more than one hypothesis or there is none, and on how rare a leftover is."""
    said = []
    if not kept:
        said.append(
            f"the judge knows of no set of hypotheses that holds the truth in {100 * LEVEL:.0f} % of campaigns with "
            "these channels: too many that taught it had a truth that was not among them, or had no probability"
        )
    if len(kept) > 1:
        names = ", ".join(" with ".join(e.effects) for e in kept[:MOST_NAMED])
        more = f" and {len(kept) - MOST_NAMED} more" if len(kept) > MOST_NAMED else ""
        said.append(
            f"by the fitted recordings, the truth is, in {100 * LEVEL:.0f} % of campaigns like those that taught the "
            f"judge, among: {names}{more}"
        )
    if rare is not None and rare[1]:
        said.append(
            f"p-value of a known cause: {rare[0]:.2g} (none can be below {1 / (1 + rare[1]):.2g}), the share of "
            f"{rare[1]} campaigns with one that left as much beyond noise and other forms when the judge was taught"
            + (
                ""
                if rare[0] < RARE
                else "; so not what is left speaks against one, but what the rig states or the holdout"
            )
        )
    return said
