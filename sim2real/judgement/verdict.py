"""The verdict of a diagnosis, by the probabilities of its hypotheses."""

from collections.abc import Sequence

from sim2real.judgement.judge import Entry
from sim2real.search.hypotheses import CALIBRATION, NONE, UNKNOWN

CLASS_SHARE = 0.15  # hypotheses with at least this share of the best one's probability are not distinguished from it
# What is named sends somebody to look for it. In 842 simulated campaigns, naming only what is more than three times as
# probable as that nothing acts left 5 of 153 false alarms where there had been 10; 27 of 689 effects pass for none, 23
# did.
SURER = 3.0


def with_effects(found: Sequence[Entry]) -> list[Entry]:
    """The hypotheses that name effects."""
    return [e for e in found if e.effects[0] not in (NONE, CALIBRATION, UNKNOWN)]


def verdict(found: Sequence[Entry]) -> tuple[str, tuple[str, ...]]:
    """The verdict and the cause; in a class of alternatives a pair is written "a+b".

    Effects that are many and improbable each are no reason to name one of them: what is named must be more probable,
    with what is not distinguished from it, than that nothing acts, and clearly so.

    Returns:
        verdict: "no_gap", "explained", "ambiguous" or "unexplained".
        cause: Names of the effects.
    """
    mass = {kind: sum(e.probability for e in found if e.effects == (kind,)) for kind in (NONE, CALIBRATION, UNKNOWN)}
    named = with_effects(found)
    effects = sum(e.probability for e in named)
    alike = alternatives(named)
    if SURER * (mass[NONE] + mass[CALIBRATION]) >= max(sum(e.probability for e in alike), mass[UNKNOWN]):
        return "no_gap", ()
    if mass[UNKNOWN] >= effects or not named:
        return "unexplained", (UNKNOWN,)
    return worded(alike)


def alternatives(named: Sequence[Entry]) -> list[Entry]:
    """Of hypotheses with effects, the most probable first, those that are not distinguished from the first."""
    alike: list[Entry] = []
    for e in named:
        more = any(set(e.effects) > set(other.effects) for other in alike)  # the same effects and a superfluous one
        if e.probability >= CLASS_SHARE * named[0].probability and not more:
            alike.append(e)
    return alike


def worded(alike: Sequence[Entry]) -> tuple[str, tuple[str, ...]]:
    """The verdict and the cause, as of `verdict`, of hypotheses that are not distinguished."""
    if len(alike) == 1:
        return "explained", alike[0].effects
    return "ambiguous", tuple("+".join(e.effects) for e in alike)
