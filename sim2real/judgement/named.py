"""What is named of what the fitted recordings say, after the holdout was asked."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from sim2real.compared.drift import Drift
from sim2real.compared.problem import Problem
from sim2real.gap.fit_figures import figures
from sim2real.judgement.borne_out import borne_out, handed_on, shows_nothing, without
from sim2real.judgement.evidence import Evidence
from sim2real.judgement.judge import Entry
from sim2real.judgement.on_holdout import (
    calibration_fails,
    leaves_clear_gap,
    leaves_too_much,
    shown_by_both,
    spoken_against,
)
from sim2real.judgement.one_cause import explained_by_one
from sim2real.judgement.tones.sightings import Sighting
from sim2real.judgement.verdict import alternatives, verdict, with_effects, worded
from sim2real.search.candidates import Attribution
from sim2real.search.hypotheses import CALIBRATION, NONE, UNKNOWN

NO_EFFECT = ((NONE,), (CALIBRATION,))
ROUNDS = 3  # in which the holdout is asked; what it bears out after many others would be chance
LEAST = 0.01  # probability by the fitted recordings that is named where the holdout refutes what was more probable


@dataclass(frozen=True)
class Weighed:
    """What the fitted recordings say.

    Attributes:
        found: Every hypothesis with its probability.
        verdict: By these, as in `Diagnosis`.
        cause: Likewise.
        tempering: As in `Diagnosis`.
        seen: Tones.
        drift: What the periods say of one of the gain; None where there are too few.
        tones: How much tones and drift save, in units of -2 ln of the likelihood.
        notes: Why evidence was tempered, where it was.
        evidence: What the probabilities were computed from.
    """

    found: Sequence[Entry]
    verdict: str
    cause: tuple[str, ...]
    tempering: float
    seen: list[Sighting]
    drift: Drift | None
    tones: float
    notes: list[str]
    evidence: Evidence


@dataclass(frozen=True)
class Named:
    """What is named after the holdout was asked.

    Attributes:
        verdict: As in `Diagnosis`.
        cause: Likewise.
        found: Every hypothesis that is left, with its probability.
        effects: Those of them that name effects.
        kept: Those of them that are named, the most probable first.
        notes: Why others are not.
    """

    verdict: str
    cause: tuple[str, ...]
    found: Sequence[Entry]
    effects: Sequence[Entry]
    kept: list[Entry]
    notes: list[str]


def by_holdout(fitted: Problem, judged: Problem, judged_on: str, attribution: Attribution, weighed: Weighed) -> Named:
    """Drop what the holdout refutes, and what predicts nothing of the motion; the verdict follows from what is left.

    What is most probable then is asked likewise, as long as the fitted recordings do not leave it improbable. Two
    effects together must explain more than one free correction does.
    """
    found, verdicted, cause = weighed.found, weighed.verdict, weighed.cause
    probable = {e.effects for e in found if e.probability > LEAST}
    named, kept, notes, refuted = with_effects(found), [], [], []
    for _ in range(ROUNDS):
        kept = alternatives(with_effects(found)) if verdicted in ("explained", "ambiguous") else []
        kept = [e for e in kept if not refuted or e.effects in probable]
        on_holdout = kept if judged_on == "holdout" else []
        refuting, said = _refuted_by(judged, attribution, on_holdout)
        idle, said_of_idle = _still(fitted, attribution, [e for e in kept if e not in refuting])
        against = [*refuting, *idle]
        notes += [*said_of_idle, *said]
        kept = [e for e in kept if e not in against]
        if not against:
            break
        refuted += against
        if not kept and shows_nothing(judged, attribution, _saved(weighed, refuted)):
            # The unknown cause, too, was weighed by what those save that the holdout refutes.
            found = without(found, [e for e in found if e.effects not in NO_EFFECT])
            return Named("no_gap", (), found, [], [], notes)
        found = without(found, against)
        verdicted, cause = verdict(found)
    if judged_on == "holdout" and kept and (block := explained_by_one(judged, attribution, kept)):
        notes.append(
            f"one correction of the {block} explains the recordings and the holdout as well as "
            f"{' or '.join(' with '.join(e.effects) for e in kept)}: one cause without a name is simpler than two"
        )
        return Named("unexplained", (UNKNOWN,), without(found, kept), named, [], notes)
    if refuted:
        if verdicted == "no_gap":  # what is left speaks for calibration
            return Named(verdicted, cause, found, [], [], notes)
        if not kept or verdicted == "unexplained":
            return Named("unexplained", (UNKNOWN,), found, named, [], notes)
        verdicted, cause, named = *worded(kept), kept
    elif verdicted == "no_gap" and judged_on == "holdout":
        shown = shown_by_both(judged, attribution, named, weighed.tempering)
        if shown and not leaves_clear_gap(judged, attribution, shown):
            found = handed_on(found, shown)
            named = with_effects(found)
            kept = alternatives(named)
            verdicted, cause = worded(kept)
            notes.append(
                "calibration alone explains the recordings that were fitted, but then leaves of the holdout what "
                f"{' or '.join(' with '.join(e.effects) for e in kept)} explains together with them"
            )
        elif shown or calibration_fails(judged, attribution):
            found = without(found, [e for e in found if e.effects in NO_EFFECT])
            named, (verdicted, cause) = with_effects(found), ("unexplained", (UNKNOWN,))
            notes.append(
                "calibration alone explains the recordings that were fitted, but neither it nor any effect explains "
                "the holdout together with them"
            )
    return Named(verdicted, cause, found, named, kept, notes)


def _refuted_by(holdout: Problem, attribution: Attribution, alike: Sequence[Entry]) -> tuple[list[Entry], list[str]]:
    """Those that the holdout refutes, and why."""
    if not alike:
        return [], []
    kept = borne_out(holdout, attribution, alike)
    against = [*spoken_against(holdout, attribution, kept), *leaves_too_much(holdout, attribution, kept)]
    off = [e for e in alike if e not in kept or e in against]
    notes = [
        f"{' with '.join(e.effects)} would explain the recordings that were fitted, but the holdout is simulated no "
        "better with it than without, or than by calibration alone, or with a gap that no form of it leaves: it is not "
        "named"
        for e in off
    ]
    return off, notes


def _still(fitted: Problem, attribution: Attribution, alike: Sequence[Entry]) -> tuple[list[Entry], list[str]]:
    """Those that predict nothing of the motion, and what is said of them."""
    still = [e for e in alike if _predicts_nothing(fitted, attribution, e)]
    notes = [
        f"with {' and '.join(e.effects)} the simulation comes nearest, but it predicts nothing of the measured motion: "
        "no effect is named; check the rig's magnet, gains, signs and units"
        for e in still
    ]
    return still, notes


def _saved(weighed: Weighed, refuted: Sequence[Entry]) -> float:
    """What the best of these hypotheses saves beyond calibration; that it lacks something makes it no less."""
    cost = weighed.evidence.cost
    best = min((cost[e.candidate] for e in refuted if e.candidate), default=np.inf)
    return float(cost[0] - best) if np.isfinite(cost[0]) else 0.0


def _predicts_nothing(fitted: Problem, attribution: Attribution, named: Entry) -> bool:
    """Whether a simulation with the named effects leaves as much as one that stands still; tones do not count."""
    if named.candidate is None or not (fit := attribution.candidates[named.candidate].fit).hypothesis.effects:
        return False
    found = figures(fitted, fit.residual)
    return found is not None and found.predicted <= 0.0
