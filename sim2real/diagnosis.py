"""The diagnosis of a campaign: where the gap lies, which effect causes it, and how far it shrinks."""

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from maglev_env.loop.effect import EFFECTS
from maglev_env.recordings.campaign import Campaign
from sim2real.advice.gain_choice import gain_choice
from sim2real.advice.next_experiment import propose
from sim2real.attributed import attributed
from sim2real.compared.bench_noise import BenchNoise, bench_noise
from sim2real.compared.drift import DRIFT, Drift, drift_of
from sim2real.compared.open_tones import toned
from sim2real.compared.problem import Problem, assemble
from sim2real.compared.simulated import Point, unseen_by_all
from sim2real.compared.standing import standing
from sim2real.free.correction import free_correction
from sim2real.free.fit import excess
from sim2real.gap.fit_figures import figures
from sim2real.gap.leftover import leftover
from sim2real.gap.locate import CONTROLLER_SD, Where, locate
from sim2real.gap.shrink import shrink
from sim2real.judgement.belief import shipped
from sim2real.judgement.borne_out import borne_out, shows_nothing, without
from sim2real.judgement.commands_seen import SEEN, seen_lost
from sim2real.judgement.evidence import Evidence, evidence_of
from sim2real.judgement.judge import Entry, allowance, entries
from sim2real.judgement.likely import likely_in_words, likely_of, rareness
from sim2real.judgement.mechanisms import by_mechanism, renamed
from sim2real.judgement.on_holdout import leaves_clear_gap, shown_by_both, spoken_against
from sim2real.judgement.sightings import Sighting, sightings
from sim2real.judgement.unsynchronised import evidence, spin_costs, tone_parameters, vibration_costs
from sim2real.judgement.verdict import alternatives, verdict, with_effects, worded
from sim2real.recorded.at_rest.static_evidence import drift_in_words
from sim2real.recorded.drifting import DRIFTING
from sim2real.recorded.open_record import OpenRecord
from sim2real.recorded.records import Record, read_records
from sim2real.result import Diagnosis, fitted_parameters
from sim2real.search.candidates import Attribution, Candidate, best_partial, contradictions
from sim2real.search.hypotheses import CALIBRATION, NONE, TONES, UNKNOWN

FREE_FROM = 0.1  # share of the gap that a named effect may leave without a free correction beside it
NO_EFFECT = ((NONE,), (CALIBRATION,))
HELD_OUT_EVERY = 4  # without a holdout recording, every fourth line is withheld from the fits


def diagnose(
    campaign: str | Path | Campaign, seed: int = 0, progress: Callable[[str], None] = lambda text: None
) -> Diagnosis:
    """Diagnose a campaign.

    Args:
        campaign: A campaign folder, or a loaded campaign.
        seed: Seed of the foils and of the bootstrap.
        progress: Called with the name of each step.

    Raises:
        ValueError: As `read_records`, or no hypothesis levitates under the recorded gains.
        OSError: A file cannot be read.
    """
    begun = time.perf_counter()
    progress("reading")
    loaded, standing_records = standing(*read_records(campaign))
    records = toned(standing_records)
    bench = bench_noise(records)
    fitted, judged, judged_on, notes = _problems(records, bench)
    fitted, judged, attribution, of_noise = attributed(records, fitted, judged, bench, progress)
    notes += of_noise
    progress("judging")
    weighed = _weighed(records, fitted, attribution)
    notes = [*weighed.notes, *notes]
    where = _where(fitted, attribution, weighed.tones)
    if where.controller is not None and where.controller > CONTROLLER_SD:
        notes.append(
            f"the recorded controller is not the one described: its command is {where.controller:.0f} standard "
            "deviations from what the stated gains make of the reading; check gains, td, ti and the sign"
        )
    named = _named(fitted, judged, judged_on, attribution, weighed)
    notes += contradictions(attribution, [name for e in named.kept for name in e.effects])
    notes += named.notes
    likely = likely_of(weighed.found, weighed.evidence, shipped())
    rare = rareness(weighed.evidence, shipped()) if named.verdict == "unexplained" else None
    notes += likely_in_words(likely, rare)
    chosen = next(iter(named.kept), None)
    picked = None if chosen is None or chosen.candidate is None else attribution.candidates[chosen.candidate]
    if picked is not None and chosen is not None and (said := renamed(chosen, picked.effects)):
        notes.append(said)
    gap = shrink(judged, attribution, picked, judged_on, seed)
    proposal = None
    if named.verdict in ("ambiguous", "unexplained"):
        progress("next experiment")
        proposal = propose(attribution, named.found)
    left, partial = None, attribution.calibration
    if named.verdict == "unexplained":
        progress("what is left")
        partial = best_partial(attribution, named.effects[0].candidate if named.effects else None)
        left = leftover(attribution, judged, partial, fitted_parameters(partial), seed)
    alone, free = picked or attribution.calibration, None
    if left is not None or (picked is not None and _leaves_much(picked, attribution)):
        progress("free correction")
        free = free_correction(attribution, judged, picked or partial, picked is not None, seed)
        if free is not None and free.gained:
            alone, judged = free.candidate, free.judged
            gap = shrink(judged, attribution, free.candidate, judged_on, seed)
    corrected = _corrected(fitted, alone, () if chosen is None else chosen.effects, weighed.seen, weighed.drift)
    corrected = corrected if free is None else free.added_to(corrected)
    speed = next(r.experiment.speed_rpm for r in records if r.role == "fit")
    return Diagnosis(
        verdict=named.verdict,
        cause=named.cause,
        where=where,
        which=tuple(named.found),
        indistinguishable=(named.cause,) if named.verdict == "ambiguous" else (),
        next_experiment=proposal,
        gap=gap,
        corrected=corrected,
        campaign=loaded,
        attribution=attribution,
        judged=judged,
        choice=gain_choice(records[0].nominal, corrected, speed) if corrected.effects else None,
        seconds=time.perf_counter() - begun,
        notes=tuple(dict.fromkeys(notes)),
        leftover=left,
        tempering=weighed.tempering,
        free=free,
        unseen=tuple(name for name in EFFECTS if name in unseen_by_all(records)),
        likely=tuple(likely),
        rareness=rare,
        evidence=weighed.evidence,
    )


def _problems(records: Sequence[Record | OpenRecord], bench: BenchNoise) -> tuple[Problem, Problem, str, list[str]]:
    """What is fitted, what the gap is judged on, the words for that, and notes."""
    fitted = assemble([r for r in records if r.role == "fit"], bench=bench)
    holdouts = [r for r in records if r.role == "holdout"]
    notes = [note for r in records for note in r.notes]
    if holdouts:
        judged, judged_on = assemble(holdouts, bench=bench), "holdout"
    else:
        fitted, judged = fitted.split(HELD_OUT_EVERY)
        judged_on = "held-out lines"
        notes.append("no recording is a holdout: the gap is judged on every fourth line, which no fit has seen")
    if fitted.static is not None and (drifts := drift_in_words(fitted.static)):
        notes.append(drifts)
    return fitted, judged, judged_on, notes


@dataclass(frozen=True)
class _Weighed:
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


def _weighed(records: Sequence[Record | OpenRecord], fitted: Problem, attribution: Attribution) -> _Weighed:
    """Probabilities and verdict by the recordings that were fitted, tones and drift of the gain among the causes."""
    base = attribution.simplest
    near = base.fit.hypothesis.point(base.fit.u)
    drift = drift_of(fitted, near)
    drifts = drift is not None and drift.shown
    seen = sightings(fitted, near, drifts)
    tones, causes = evidence(seen), vibration_costs(fitted, seen, near)
    if drift is not None and drifts:
        tones[DRIFT], causes[DRIFT] = drift.chi2, {DRIFTING: drift.left}
    if lost := seen_lost(fitted):
        tones[SEEN] = lost
    evidenced = evidence_of(attribution, tones, spin_costs(fitted, seen), causes, drift)
    found = by_mechanism(entries(evidenced), records[0].nominal)
    verdicted, cause = verdict(found)
    excused = allowance(evidenced)
    tempering = evidenced.dispersion.ratio(excused)
    notes = (
        []
        if tempering <= 1
        else [
            f"{evidenced.dispersion.in_words(excused)}, more than noise does: all differences of evidence are divided "
            f"by the reduced chi-square that is left, {tempering:.2g}"
        ]
    )
    return _Weighed(found, verdicted, cause, tempering, seen, drift, sum(tones.values()), notes, evidenced)


@dataclass(frozen=True)
class _Named:
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


def _named(fitted: Problem, judged: Problem, judged_on: str, attribution: Attribution, weighed: _Weighed) -> _Named:
    """Drop what the holdout refutes, and what predicts nothing of the motion; the verdict follows from what is left."""
    found, verdicted, cause = weighed.found, weighed.verdict, weighed.cause
    named = with_effects(found)
    alike = alternatives(named) if verdicted in ("explained", "ambiguous") else []
    kept = alike
    if alike and judged_on == "holdout":
        kept = borne_out(judged, attribution, alike)
        against = spoken_against(judged, attribution, kept)
        kept = [e for e in kept if e not in against]
    refuted = [e for e in alike if e not in kept]
    still = [e for e in kept if _predicts_nothing(fitted, attribution, e)]
    notes = [
        f"with {' and '.join(e.effects)} the simulation comes nearest, but it predicts nothing of the measured motion: "
        "no effect is named; check the rig's magnet, gains, signs and units"
        for e in still
    ]
    kept = [e for e in kept if e not in still]
    notes += [
        f"{' with '.join(e.effects)} would explain the recordings that were fitted, but the holdout is simulated no "
        "better with it than without, or than by calibration alone: it is not named"
        for e in refuted
    ]
    refuted += still
    if refuted and not kept and shows_nothing(judged, attribution, _saved(weighed, refuted)):
        # The unknown cause, too, was weighed by what those save that the holdout refutes.
        verdicted, cause = "no_gap", ()
        found, named = without(found, [e for e in found if e.effects not in NO_EFFECT]), []
    elif refuted:
        found, named = without(found, refuted), kept or named
        verdicted, cause = worded(kept) if kept else ("unexplained", (UNKNOWN,))
        if not kept and verdict(found)[0] == "no_gap":  # what is left speaks for calibration
            verdicted, cause, named = "no_gap", (), []
    elif verdicted == "no_gap" and judged_on == "holdout" and (shown := shown_by_both(judged, attribution, named)):
        unknown = leaves_clear_gap(judged, attribution, shown)
        found = without(found, [e for e in found if (e.effects in NO_EFFECT if unknown else e not in shown)])
        named = with_effects(found)
        kept = [] if unknown else alternatives(named)
        verdicted, cause = ("unexplained", (UNKNOWN,)) if unknown else worded(kept)
        said = " or ".join(" with ".join(e.effects) for e in kept or shown)
        notes.append(
            "calibration alone explains the recordings that were fitted, but then leaves of the holdout "
            + (
                f"a clear gap, of which {said} explains no more than a part"
                if unknown
                else f"what {said} explains together with them"
            )
        )
    return _Named(verdicted, cause, found, named, kept, notes)


def _saved(weighed: _Weighed, refuted: Sequence[Entry]) -> float:
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


def _leaves_much(picked: Candidate, attribution: Attribution) -> bool:
    """Whether what is named leaves much of the gap that calibration leaves; inf where calibration touches down."""
    return excess(picked.fit) > FREE_FROM * excess(attribution.calibration.fit)


def _where(fitted: Problem, attribution: Attribution, tones: float) -> Where:
    """Locate what calibration leaves; if the rotor touches down there, what the opened linear nominal loop leaves."""
    calibration = attribution.calibration.fit
    if np.isfinite(calibration.cost):
        return locate(fitted, calibration.residual, tones)
    return locate(fitted, fitted.opened_residual(), tones)


def _corrected(
    fitted: Problem, candidate: Candidate, effects: tuple[str, ...], seen: list[Sighting], drift: Drift | None
) -> Point:
    """The candidate's point, with the tones and the drift added to its effects."""
    if not np.isfinite(candidate.fit.cost):
        return Point({}, {})
    point = candidate.fit.hypothesis.point(candidate.fit.u)
    tones = {name: tone_parameters(fitted, seen, name) for name in effects if name in TONES}
    if drift is not None and drift.shown and DRIFTING in effects and DRIFTING not in point.effects:
        tones[DRIFTING] = drift.parameters
    return Point({**point.effects, **tones}, point.changes)
