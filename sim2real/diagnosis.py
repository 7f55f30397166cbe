"""The diagnosis of a campaign: where the gap lies, which effect causes it, and how far it shrinks."""

import time
from collections.abc import Callable, Sequence
from dataclasses import replace
from math import inf
from pathlib import Path

import numpy as np

from maglev_env.loop.effect import EFFECTS
from maglev_env.recordings.campaign import Campaign
from sim2real.advice.gain_choice import gain_choice
from sim2real.advice.next_experiment import propose
from sim2real.attributed import attributed
from sim2real.compared.bench_noise import BenchNoise, bench_noise
from sim2real.compared.commands_seen import SEEN, by_count, looked_at, none_lost, runs_in_words, seen_lost
from sim2real.compared.drift import DRIFT, Drift, drift_of, with_drift
from sim2real.compared.open_tones import toned, without_tones_of_others
from sim2real.compared.point import NOMINAL, Point, unseen_by_all
from sim2real.compared.problem import Problem, assemble
from sim2real.compared.standing import standing
from sim2real.compared.stated_noise import left_alone, louder_in_words, louder_than_stated, scattered
from sim2real.compared.tones_on_lines import with_tones_on_lines
from sim2real.free.correction import free_correction
from sim2real.gap.between_recordings import DELAY, between_recordings
from sim2real.gap.leftover import leftover
from sim2real.gap.locate import CONTROLLER_SD, Where, locate
from sim2real.gap.shrink import shrink
from sim2real.gap.wrong_gain import wrong_gain
from sim2real.gap.wrong_reading import wrong_reading
from sim2real.judgement.belief import shipped
from sim2real.judgement.borne_out import most_of_noise
from sim2real.judgement.evidence import evidence_of, unnamed_pair
from sim2real.judgement.judge import allowance, entries
from sim2real.judgement.likely import as_right, as_sure, likely_in_words, likely_of, rareness
from sim2real.judgement.limit_not_shown import not_asked_in_words, without_limit_in_words
from sim2real.judgement.lost_commands import LOST
from sim2real.judgement.meaning.untold_time import late_readings
from sim2real.judgement.mechanisms import by_mechanism, renamed
from sim2real.judgement.named import Weighed, by_holdout
from sim2real.judgement.tones.between_lines import between_lines
from sim2real.judgement.tones.noise_at_peak import NO_TANGENT
from sim2real.judgement.tones.rows_with_tones import TOO_LOUD
from sim2real.judgement.tones.sightings import LOUD, Sighting, may_creep, of_mains, sightings
from sim2real.judgement.tones.tone_sizes import tone_parameters, tone_sizes
from sim2real.judgement.tones.unsynchronised import evidence, near_rotation, spin_costs, vibration_costs
from sim2real.judgement.verdict import verdict
from sim2real.one_axis import along_one_axis
from sim2real.recorded.at_rest.static_evidence import drift_in_words
from sim2real.recorded.bursts import bursts
from sim2real.recorded.drifting import DRIFTING
from sim2real.recorded.driven_alike import driven_alike_in_words
from sim2real.recorded.open_record import OpenRecord
from sim2real.recorded.records import Record, read_records
from sim2real.result import OFFSET, Diagnosis, fitted_parameters
from sim2real.search.candidates import Attribution, Candidate, best_partial, contradictions
from sim2real.search.hypotheses import TONES
from sim2real.search.shaping import of_any_form
from sim2real.weaker_pull import weaker_pull

FREE_FROM = 0.1  # share of the gap that a named effect may leave without a free correction beside it
CREEP = 0.5  # share of the trends over periods beyond which what no gain explains may be a rotor that creeps to rest
RINGS_ON = 60.0  # chi-square of trends that the rest of a transient may have
HARDLY = 0.25  # of what scatters beyond the stated noise: what is explained beside it is not the cause
TOO_LOUD_COST = 50.0  # of such noise for every known cause: enough that none is believed
HELD_OUT_EVERY = 4  # without a holdout recording, every fourth line, or window of lines, is withheld from the fits


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
    records = without_tones_of_others(toned(standing_records))
    bench = bench_noise(records)
    fitted, judged, judged_on, notes = _problems(records, bench)
    if heard := with_tones_on_lines(fitted, judged):
        records = [heard.get(r.name, r) for r in records]
        fitted, judged, judged_on, notes = _problems(records, bench)
    fitted, judged, attribution, of_noise = attributed(records, fitted, judged, bench, progress)
    notes += of_noise
    noisy = [] if bench.shown else left_alone(attribution.problem, attribution.best.fit.residual)
    loud = louder_than_stated(noisy)
    notes += louder_in_words(loud)
    progress("judging")
    weighed = _weighed(records, fitted, attribution, scattered(noisy))
    notes = [*weighed.notes, *notes]
    where = _where(fitted, attribution, weighed.tones)
    if where.controller is not None and where.controller > CONTROLLER_SD:
        notes.append(
            f"the recorded controller is not the one described: its command is {where.controller:.0f} standard "
            "deviations from what the stated gains make of the reading; check gains, td, ti and the sign"
        )
    named = by_holdout(fitted, judged, judged_on, attribution, weighed)
    if named.verdict == "unexplained" and records[0].axes == 2:
        alone = along_one_axis(loaded, where.axes, lambda own: diagnose(own, seed, progress))
        if alone is not None:
            return replace(alone, seconds=time.perf_counter() - begun)
    notes += contradictions(attribution, [e.effects for e in named.kept])
    notes += without_limit_in_words(weighed.evidence, [e.candidate for e in named.kept if e.candidate is not None])
    notes += named.notes
    # What is lost, sticks or ends at a limit makes noise of its own, at moments.
    at_moments = any(name in NO_TANGENT or name == LOST for e in named.kept for name in e.effects)
    in_bursts = [] if at_moments else bursts(records)
    notes += [b.in_words() for b in in_bursts]
    if any("foreign_vibration" in e.effects for e in named.kept):
        notes += near_rotation(fitted, weighed.seen)
    likely = likely_of(weighed.found, weighed.evidence, shipped())
    rare = rareness(weighed.evidence, shipped()) if named.verdict == "unexplained" else None
    notes += likely_in_words(likely, rare)
    chosen = next(iter(named.kept), None)
    attribution = _of_any_form(attribution, [e.candidate for e in named.kept])
    picked = None if chosen is None or chosen.candidate is None else attribution.candidates[chosen.candidate]
    if picked is not None and chosen is not None and (said := renamed(chosen, picked.effects)):
        notes.append(said)
    if picked is not None:
        where = _where_of(fitted, picked, weighed.tones) or where
        if said := weaker_pull(picked.effects, fitted_parameters(picked)):
            notes.append(said)
    plan = None
    if named.verdict == "unexplained":
        notes += not_asked_in_words(records[0].nominal)
        late = next((c.fit for c in attribution.candidates if c.effects == (DELAY,)), None)
        if between := between_recordings(attribution.problem, attribution.calibration.fit, late):
            notes.append(between.in_words())
    if named.verdict in ("ambiguous", "unexplained"):
        progress("next experiment")
        plan = propose(attribution, named.found, weighed.seen, where if named.verdict == "unexplained" else None)
    left, partial = None, attribution.calibration
    if named.verdict == "unexplained":
        progress("what is left")
        probable = named.effects[0].candidate if named.effects else None
        partial = best_partial(attribution, probable, unnamed_pair(attribution))
        left = leftover(attribution, judged, partial, fitted_parameters(partial), seed)
    misread = mistyped = None
    if named.verdict != "no_gap" and np.isfinite(attribution.calibration.fit.cost):
        # The candidate with the least cost stands for an unknown cause: what explains as much has a name.
        in_rig, p = picked or attribution.best, attribution.problem
        noise = most_of_noise(p.data.size)
        if misread := wrong_reading(p, attribution.calibration.fit, in_rig.fit, noise):
            notes.append(misread.in_words())
        # A recorded command tells by itself whether the stated controller made it.
        if where.controller is None:
            mistyped = wrong_gain(p, attribution.calibration.fit, in_rig.fit)
    alone, free = picked or attribution.calibration, None
    if left is not None or (picked is not None and _leaves_much(picked, attribution)):
        progress("free correction")
        free = free_correction(attribution, judged, picked or partial, picked is not None, seed)
        if free is not None and free.gained:
            alone, judged = free.candidate, free.judged
    gap, by_partial = shrink(judged, attribution, alone, judged_on, seed), None
    if left is not None and _fits_better(partial, alone):
        gap_of_partial = shrink(judged, attribution, partial, judged_on, seed)
        if (gap_of_partial.after or inf) < (gap.after or inf):
            alone, gap, by_partial = partial, gap_of_partial, partial
    # The free correction names nothing, so that what it closes is no merit of what is named.
    beside = picked is not None and alone is not picked
    gap_of_named = shrink(judged, attribution, picked, judged_on, seed) if beside else None
    corrected = _corrected(fitted, alone, () if chosen is None else chosen.effects, weighed.seen, weighed.drift)
    corrected = corrected if free is None or by_partial is not None else free.added_to(corrected)
    late = late_readings(fitted, (picked or attribution.calibration).fit)
    if late is not None and late.effects & {name for cause in named.cause for name in cause.split("+")}:
        late = None  # it has a name
    if late is not None:
        notes.append(late.in_words())
    hidden = unseen_by_all(records) | (frozenset() if late is None else late.effects)
    if all(isinstance(r, OpenRecord) and r.lacks is not None for r in records):
        hidden |= {OFFSET} - {name for e in named.kept for name in e.effects}
    speed = next(r.experiment.speed_rpm for r in records if r.role == "fit")
    return Diagnosis(
        verdict=named.verdict,
        cause=named.cause,
        where=where,
        which=tuple(as_right(as_sure(named.found, weighed.found, shipped()), shipped())),
        indistinguishable=(named.cause,) if named.verdict == "ambiguous" else (),
        next_experiments=plan,
        gap=gap,
        corrected=corrected,
        campaign=loaded,
        attribution=attribution,
        judged=judged,
        choice=gain_choice(records[0].nominal, corrected, speed) if corrected.effects and not gap.grows else None,
        seconds=time.perf_counter() - begun,
        notes=tuple(dict.fromkeys(notes)),
        leftover=left,
        tempering=weighed.tempering,
        free=free,
        by_partial=by_partial,
        loud=loud,
        bursts=tuple(in_bursts),
        unseen=tuple(name for name in EFFECTS if name in hidden),
        likely=tuple(likely),
        rareness=rare,
        evidence=weighed.evidence,
        late=late,
        misread=misread,
        wrong_gain=mistyped,
        gap_of_named=gap_of_named,
        between=between_lines(fitted, weighed.seen) if named.verdict == "unexplained" else None,
        tones={
            name: sizes
            for name in TONES
            if any(name in e.effects for e in named.found) and (sizes := tone_sizes(fitted, weighed.seen, name))
        },
        off_balance=next((r.off_balance for r in records if isinstance(r, OpenRecord) and r.off_balance), None),
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
        notes.append(
            "no recording is a holdout: the gap is judged on every fourth line (or window of them), which no fit saw"
        )
    if fitted.static is not None and (drifts := drift_in_words(fitted.static)):
        notes.append(drifts)
    notes += driven_alike_in_words(records)
    return fitted, judged, judged_on, notes


def _weighed(
    records: Sequence[Record | OpenRecord], fitted: Problem, attribution: Attribution, scatter: float = 0.0
) -> Weighed:
    """Probabilities and verdict by the recordings that were fitted, tones and drift of the gain among the causes.

    What scatters by far more than the rig states (see `scattered`) is a gap of its own where hardly anything beside it
    is explained, unless lost samples are.
    """
    base = attribution.simplest
    near = base.fit.hypothesis.point(base.fit.u)
    drift = drift_of(fitted, near)
    drifts = drift is not None and drift.shown
    if drifts and drift.left > CREEP * drift.chi2 and (drift.chi2 < RINGS_ON or may_creep(records[0].nominal, near)):
        drift, drifts = None, False  # no gain makes that trend, and a rotor that is not yet at rest does
    seen = sightings(fitted, near, drifts)
    tones, causes = evidence(seen), vibration_costs(fitted, seen, near)
    if drift is not None and drifts:
        tones[DRIFT], causes[DRIFT] = drift.chi2, {DRIFTING: drift.left}
    commands = looked_at(fitted)
    if lost := seen_lost(commands):
        tones[SEEN] = lost
    elif LOUD in tones and none_lost(commands):
        causes[LOUD] = {**causes.get(LOUD, {}), LOST: tones[LOUD]}
    evidenced = evidence_of(attribution, tones, spin_costs(fitted, seen, of_mains(fitted, seen)), causes, drift)
    found = by_mechanism(entries(evidenced), records[0].nominal)
    verdicted, cause = verdict(found)
    explained = attribution.calibration.fit.cost - attribution.best.predictive
    if explained < HARDLY * scatter and not any(LOST in names.split("+") for names in cause):
        evidenced = replace(evidenced, tones={**tones, TOO_LOUD: TOO_LOUD_COST})
        found = by_mechanism(entries(evidenced), records[0].nominal)
        verdicted, cause = verdict(found)
    excused = allowance(evidenced)
    tempering = evidenced.dispersion.ratio(excused)
    notes = (
        []
        if tempering <= 1
        else [
            f"{evidenced.dispersion.in_words(excused)}, more than noise does: all differences of evidence are divided "
            f"by {tempering:.2g}, the reduced chi-square by which they do"
        ]
    )
    notes += runs_in_words(fitted, commands)
    return Weighed(found, verdicted, cause, tempering, seen, drift, sum(tones.values()), notes, evidenced)


def _of_any_form(attribution: Attribution, named: Sequence[int | None]) -> Attribution:
    """The attribution, with what is named fitted in all forms of its effects."""
    at, found = [i for i in named if i is not None], list(attribution.candidates)
    for i, fit in zip(at, of_any_form(attribution.problem, [found[i].fit for i in at]), strict=True):
        found[i] = Candidate(fit)
    return replace(attribution, candidates=tuple(found))


def _leaves_much(picked: Candidate, attribution: Attribution) -> bool:
    """Whether what is named leaves much of the gap that calibration leaves; inf where calibration touches down."""
    return picked.fit.excess > FREE_FROM * attribution.calibration.fit.excess


def _fits_better(partial: Candidate, other: Candidate) -> bool:
    """Whether a partial explanation by effects simulates what was fitted better, with its freedom counted."""
    own, theirs = partial.fit, other.fit
    return bool(partial.effects) and own.cost + own.occam < theirs.cost + theirs.occam


def _where(fitted: Problem, attribution: Attribution, tones: float) -> Where:
    """Locate what calibration leaves; if the rotor touches down there, what the opened linear nominal loop leaves."""
    calibration = attribution.calibration.fit
    if np.isfinite(calibration.cost):
        return locate(fitted, calibration.residual, tones)
    return locate(fitted, fitted.opened_residual(), tones)


def _where_of(fitted: Problem, picked: Candidate, tones: float) -> Where | None:
    """Locate what is named: what its calibration leaves without it, which calibration alone may take up in other
    blocks, as a lag of the magnets in the amplifier; None where the rotor touches down there."""
    if not picked.effects:
        return None
    left = fitted.data - fitted.simulate([Point({}, picked.fit.hypothesis.point(picked.fit.u).changes)])[0]
    return locate(fitted, left, tones) if np.isfinite(left).all() else None


def _corrected(
    fitted: Problem, candidate: Candidate, effects: tuple[str, ...], seen: list[Sighting], drift: Drift | None
) -> Point:
    """The candidate's point, with the tones and the drift added to its effects."""
    if not np.isfinite(candidate.fit.cost):
        return NOMINAL
    point = candidate.fit.hypothesis.point(candidate.fit.u)
    if LOST in point.effects and (counted := candidate.fit.hypothesis.seen.get(LOST)):
        point = replace(point, effects={**point.effects, LOST: {"probability": by_count(*counted)[0]}})
    if drift is not None and drift.shown and DRIFTING in effects and DRIFTING not in point.effects:
        point = with_drift(point, drift.rate, [part.record for part in fitted.parts])
    tones = {name: tone_parameters(fitted, seen, name) for name in effects if name in TONES}
    return Point({**point.effects, **tones}, point.changes, point.dithered)
