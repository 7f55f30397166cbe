"""The diagnosis of a campaign: where the gap lies, which effect causes it, and how far it shrinks."""

import time
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from maglev_env.loop.effect import EFFECTS
from maglev_env.recordings.campaign import Campaign
from maglev_env.recordings.left_out import left_out_data
from maglev_env.rig.rig import Rig
from sim2real.advice.gain_choice import GainChoice, gain_choice
from sim2real.advice.next_experiment import Proposal, propose
from sim2real.compared.bench_noise import bench_noise
from sim2real.compared.open_tones import agreed, with_tones
from sim2real.compared.problem import Problem, assemble
from sim2real.compared.simulated import Point, unseen_by_all
from sim2real.compared.standing import standing
from sim2real.free.correction import Free, free_correction
from sim2real.free.fit import excess
from sim2real.gap.fit_figures import figures
from sim2real.gap.leftover import Leftover, leftover
from sim2real.gap.locate import CONTROLLER_SD, Where, locate
from sim2real.gap.shrink import Gap, errors, shrink
from sim2real.judgement.borne_out import borne_out, shows_nothing, without
from sim2real.judgement.drift import DRIFT, Drift, drift_of
from sim2real.judgement.judge import (
    Entry,
    allowance,
    alternatives,
    entries,
    evidence_of,
    verdict,
    with_effects,
    worded,
)
from sim2real.judgement.mechanisms import by_mechanism, renamed
from sim2real.judgement.nonstationary import widening
from sim2real.judgement.unsynchronised import (
    Sighting,
    evidence,
    sightings,
    spin_costs,
    tone_parameters,
    vibration_costs,
)
from sim2real.recorded.open_record import OpenRecord
from sim2real.recorded.records import read_records
from sim2real.recorded.static_evidence import drift_in_words
from sim2real.search.attribute import NO_GAP, Attribution, Candidate, attribute, best_partial, contradictions
from sim2real.search.hypotheses import CALIBRATION, NONE, TONES, UNKNOWN, Coordinate
from sim2real.words import Fitted

SCHEMA = "maglev-diagnosis/1"
LOUDER = 1.05  # times its noise that a record without a period may seem to have under a wrong simulation
QUIETER = 1.5  # times by which noise may have been taken too large
FREE_FROM = 0.1  # share of the gap that a named effect may leave without a free correction beside it
HELD_OUT_EVERY = 4  # without a holdout recording, every fourth line is withheld from the fits


@dataclass(frozen=True)
class Diagnosis:
    """What a campaign shows about the nominal simulator.

    Attributes:
        verdict: "no_gap", "explained", "ambiguous" or "unexplained".
        cause: Names of the effects. For an ambiguous verdict, the alternatives that the campaign cannot distinguish,
            with "a+b" for two effects together; ("unknown",) for an unexplained one.
        where: Where the gap lies.
        which: Every hypothesis with its probability.
        indistinguishable: Sets of causes that the campaign cannot distinguish.
        next_experiment: The most useful next recording, if one is needed.
        gap: How far the gap shrinks.
        corrected: The point that closes the gap (calibration alone where no effect is named).
        campaign: The campaign of the recordings that were used.
        attribution: The fitted candidates.
        judged: The recordings or lines on which the gap is judged.
        choice: How the gap changes the choice of gains; None where no effect is named or the rig's protocol cannot
            score gains.
        seconds: Wall time, s.
        notes: What was assumed, or could not be determined; first why evidence was tempered, where it was.
        leftover: What the best partial explanation leaves, where the verdict is "unexplained".
        tempering: Reduced chi-square that the best explanation leaves, by which differences of evidence were divided;
            1 where it leaves no more than noise.
        free: What a free correction of a block adds where no effect explains the gap, or what is named leaves much.
        unseen: Effects that do not show in any recording, because they act before the current that drives it.
    """

    verdict: str
    cause: tuple[str, ...]
    where: Where
    which: tuple[Entry, ...]
    indistinguishable: tuple[tuple[str, ...], ...]
    next_experiment: Proposal | None
    gap: Gap
    corrected: Point
    campaign: Campaign
    attribution: Attribution
    judged: Problem
    choice: GainChoice | None
    seconds: float
    notes: tuple[str, ...]
    leftover: Leftover | None = None
    tempering: float = 1.0
    free: Free | None = None
    unseen: tuple[str, ...] = ()

    @property
    def rig(self) -> Rig:
        """The nominal rig, which every diagnosed campaign names."""
        if self.campaign.rig is None:
            raise ValueError(f"{self.campaign.folder}: the campaign names no rig, so nothing can be corrected")
        return self.campaign.rig

    def to_json(self) -> dict[str, Any]:
        """The diagnosis as schema maglev-diagnosis/1, in SI units; None for what could not be determined."""
        which = [
            {
                "effects": list(e.effects),
                "probability": e.probability,
                "parameters": {} if e.candidate is None else _parameters(self.attribution.candidates[e.candidate]),
                "explained_worst_group": e.explained_worst_group,
            }
            for e in self.which
        ]
        g, w = self.gap, self.where
        return {
            "schema": SCHEMA,
            "verdict": self.verdict,
            "cause": list(self.cause),
            "where": {
                "blocks": dict(w.blocks),
                "bands": [{"f_lo": lo, "f_hi": hi, "share": share} for lo, hi, share in w.bands],
                "kind": dict(w.kind),
                "controller_distance": w.controller,
            },
            "which": which,
            "indistinguishable": [list(c) for c in self.indistinguishable],
            "next_experiment": None if self.next_experiment is None else self.next_experiment.to_json(),
            "gap": {
                "before": g.before,
                "calibrated": g.calibrated,
                "after": g.after,
                "floor": g.floor,
                "closed_fraction": g.closed_fraction,
                "nominal_levitates": g.before is not None,
                "fit": None if g.figures is None else asdict(g.figures),
                "closed_fraction_ci": None if g.closed_fraction_ci is None else list(g.closed_fraction_ci),
                "judged_on": g.judged_on,
                "stiffness_error": errors(g, "stiffness"),
                "damping_error": errors(g, "damping"),
                "peak_sensitivity_error": errors(g, "peak_sensitivity"),
                "regret": None if self.choice is None else _choice(self.choice),
                "foils": dict(g.foils),
            },
            "corrected": {"effects": {n: dict(v) for n, v in self.corrected.effects.items()},
                          "changes": dict(self.corrected.changes)},
            "free": None if self.free is None else self.free.to_json(),
            "unexplained": None if self.leftover is None else self.leftover.to_json(),
            "tempering": self.tempering,
            "unseen": list(self.unseen),
            "notes": list(self.notes),
            "left_out": left_out_data(self.campaign.left_out),
            "seconds": self.seconds,
        }  # fmt: skip


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
    records = agreed([with_tones(r) if isinstance(r, OpenRecord) else r for r in standing_records])
    bench = bench_noise(records)
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
    attribution = attribute(fitted, progress)
    if any(isinstance(r, OpenRecord) for r in records):
        # The noise of a record without a period is what a good simulation leaves of it.
        again, judged, louder = _with_noise_of_best(fitted, judged, attribution)
        if _other_noise(fitted, again) or _other_nuisances(fitted, again):
            fitted, attribution = again, attribute(again, progress, attribution)
            # What the first fits could not simulate may have been taken for noise that the later ones do not leave.
            again, later, less = _with_noise_of_best(fitted, judged, attribution)
            if _quieter(fitted, again):
                judged, louder = later, less
                fitted, attribution = again, attribute(again, progress, attribution)
            else:
                again = fitted
        if bounded := [p.record.name for p in again.parts if bench.reached(p.record, p.opened.outputs, p.noise)]:
            notes.append(
                f"{', '.join(bounded)}: what is left exceeds the noise that the recordings with a period show; it is "
                "taken for a gap, not for noise"
            )
        elif louder > LOUDER:
            notes.append(
                f"errors at single moments, as at steps or kicks: the noise is taken as {louder:.2g} times as large as "
                "it looks"
            )
    progress("judging")
    base = attribution.simplest
    near = base.fit.hypothesis.point(base.fit.u)
    drift = drift_of(fitted, near)
    seen = sightings(fitted, near, drift is not None)
    tones, causes = evidence(seen), vibration_costs(fitted, seen, near)
    if drift is not None:
        tones[DRIFT], causes[DRIFT] = drift.chi2, {"gain_drift": drift.left}
    evidenced = evidence_of(attribution, tones, spin_costs(fitted, seen), causes)
    found = by_mechanism(entries(evidenced), records[0].nominal)
    verdicted, cause = verdict(found)
    excused = allowance(evidenced)
    tempering = evidenced.dispersion.ratio(excused)
    if tempering > 1:
        notes.insert(
            0,
            f"{evidenced.dispersion.in_words(excused)}, more than noise does: all differences of evidence are divided "
            f"by the reduced chi-square that is left, {tempering:.2g}",
        )
    where = _where(fitted, attribution, sum(tones.values()))
    if where.controller is not None and where.controller > CONTROLLER_SD:
        notes.append(
            f"the recorded controller is not the one described: its command is {where.controller:.0f} standard "
            "deviations from what the stated gains make of the reading; check gains, td, ti and the sign"
        )
    notes += contradictions(attribution)
    named = with_effects(found)
    alike = alternatives(named) if verdicted in ("explained", "ambiguous") else []
    kept = borne_out(judged, attribution, alike) if alike and judged_on == "holdout" else alike
    refuted = [e for e in alike if e not in kept]
    still = [e for e in kept if _predicts_nothing(fitted, attribution, e)]
    notes += [
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
    if refuted and not kept and shows_nothing(judged, attribution):
        # The unknown cause, too, was weighed by what those save that the holdout refutes.
        verdicted, cause = "no_gap", ()
        found, named = without(found, [e for e in found if e.effects not in ((NONE,), (CALIBRATION,))]), []
    elif refuted:
        verdicted, cause = worded(kept) if kept else ("unexplained", (UNKNOWN,))
        found, named = without(found, refuted), kept or named
    chosen = next(iter(kept), None)
    picked = None if chosen is None or chosen.candidate is None else attribution.candidates[chosen.candidate]
    if picked is not None and chosen is not None and (said := renamed(chosen, picked.effects)):
        notes.append(said)
    gap = shrink(judged, attribution, picked, judged_on, seed)
    indistinguishable = (cause,) if verdicted == "ambiguous" else ()
    proposal = None
    if verdicted in ("ambiguous", "unexplained"):
        progress("next experiment")
        proposal = propose(attribution, found)
    left, partial = None, attribution.calibration
    if verdicted == "unexplained":
        progress("what is left")
        partial = best_partial(attribution, named[0].candidate if named else None)
        left = leftover(attribution, judged, partial, _parameters(partial), seed)
    alone, free = picked or attribution.calibration, None
    if left is not None or (picked is not None and _leaves_much(picked, attribution)):
        progress("free correction")
        free = free_correction(attribution, judged, picked or partial, picked is not None, seed)
        if free is not None and free.gained:
            alone, judged = free.candidate, free.judged
            gap = shrink(judged, attribution, free.candidate, judged_on, seed)
    corrected = _corrected(fitted, alone, () if chosen is None else chosen.effects, seen, drift)
    corrected = corrected if free is None else free.added_to(corrected)
    speed = next(r.experiment.speed_rpm for r in records if r.role == "fit")
    return Diagnosis(
        verdicted,
        cause,
        where,
        tuple(found),
        indistinguishable,
        proposal,
        gap,
        corrected,
        loaded,
        attribution,
        judged,
        gain_choice(records[0].nominal, corrected, speed) if corrected.effects else None,
        time.perf_counter() - begun,
        tuple(dict.fromkeys(notes)),
        left,
        tempering,
        free,
        tuple(name for name in EFFECTS if name in unseen_by_all(records)),
    )


def _with_noise_of_best(fitted: Problem, judged: Problem, attribution: Attribution) -> tuple[Problem, Problem, float]:
    """Both problems with the noise that the best fit leaves, and how many times as loud it is taken as it looks."""
    best = min(attribution.candidates, key=lambda c: c.predictive).fit
    near = best.hypothesis.point(best.u)
    louder = float(widening(fitted, best).max(initial=1.0))
    return fitted.again(near, louder), judged.again(near, louder), louder


def _predicts_nothing(fitted: Problem, attribution: Attribution, named: Entry) -> bool:
    """Whether a simulation with the named effects leaves as much as one that stands still; tones do not count."""
    if named.candidate is None or not (fit := attribution.candidates[named.candidate].fit).hypothesis.effects:
        return False
    found = figures(fitted, fit.residual)
    return found is not None and found.predicted <= 0.0


def _quieter(old: Problem, new: Problem) -> bool:
    """Whether the noise of a recording is less by more than QUIETER."""
    return any(np.median(a.noise / b.noise) > QUIETER for a, b in zip(old.parts, new.parts, strict=True))


def _other_noise(old: Problem, new: Problem) -> bool:
    """Whether the noise of a recording is another one by more than LOUDER."""
    ratios = [np.median(a.noise / b.noise) for a, b in zip(old.parts, new.parts, strict=True)]
    return bool(np.any(np.abs(np.log(ratios)) > np.log(LOUDER)))


def _other_nuisances(old: Problem, new: Problem) -> bool:
    """Whether a nuisance within its tolerance changes the data in another way than was taken, by what an effect might.

    Of a recording without a period that way is simulated, first on the nominal rig, which may be far off.
    """
    if old.nuisances.names != new.nuisances.names:
        return True
    # Along a direction that is taken out anyway, it does not matter by how much.
    apart = old.nuisances.without(new.nuisances.columns - old.nuisances.columns)
    return bool(np.any(np.linalg.norm(apart, axis=1) ** 2 > NO_GAP))


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
    tones = {name: tone_parameters(fitted, seen, name) for name in effects if name in TONES and name != "gain_drift"}
    if drift is not None and "gain_drift" in effects:
        tones["gain_drift"] = drift.parameters
    return Point({**point.effects, **tones}, point.changes)


def _parameters(candidate: Candidate) -> Mapping[str, Fitted]:
    """Fitted parameters with standard errors, named "effect.parameter", or "parameter (relative)" for tolerances.

    A parameter that ended at its bound has no standard error: it is not identified.
    """
    fit, found = candidate.fit, {}
    sd = np.sqrt(np.maximum(np.diag(fit.covariance()), 0.0))
    for i, c in enumerate(fit.hypothesis.coordinates):
        value = c.value(float(fit.u[i]))
        at_bound = c.at_bound(float(fit.u[i]))
        se = None if at_bound else _se(c, value, float(sd[i]))
        found[f"{c.effect}.{c.parameter}"] = {"value": value, "se": se, "at_bound": at_bound}
    for i, name in enumerate(fit.hypothesis.calibrated, len(fit.hypothesis.coordinates)):
        if shape := fit.hypothesis.shapes.get(name):
            if (value := shape.value(at := float(fit.u[i]))) != shape.parameter.default:
                at_bound = at in (shape.bounded(at - 1.0), shape.bounded(at + 1.0))
                se = None if at_bound else float(sd[i]) * shape.change(at)
                found[name] = {"value": value, "se": se, "at_bound": at_bound}
            continue
        sigma = fit.hypothesis.sigma(name)
        change = float(fit.u[i]) * sigma
        found[f"{name} (relative)"] = {"value": change, "se": float(sd[i]) * sigma, "at_bound": False}
    return found


def _se(c: Coordinate, value: float, sd: float) -> float:
    return value * sd if c.scale is None else c.scale * sd


def _choice(choice: GainChoice) -> dict[str, Any]:
    nominal, corrected = choice.chosen
    return {
        "before": choice.regret,
        "rank_correlation": choice.rank_correlation,
        "judged_by": "the corrected simulator",
        "gains": {"nominal": dict(zip(("kp", "kd"), nominal, strict=True)),
                  "corrected": dict(zip(("kp", "kd"), corrected, strict=True))},
    }  # fmt: skip


def block_of(name: str) -> str:
    """Block of an effect, or of several effects written "a+b"."""
    return "+".join(dict.fromkeys(EFFECTS[part].block for part in name.split("+")))
