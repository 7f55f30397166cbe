"""The value of a diagnosis to the engineer: how much better the gains are that the corrected simulator recommends."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from estimation.lines.frequency_response import frequency_response
from estimation.lines.periods import line_statistics, period_spectra
from estimation.max_likelihood import maximum_likelihood
from estimation.stability_margins import margin_arrays
from maglev_env.channels import SPECTRAL
from maglev_env.evaluation.known_chain import force_statistics
from maglev_env.evaluation.score import score, terms
from maglev_env.evaluation.target import score_target
from maglev_env.experiment import Experiment, protocol_experiment
from maglev_env.loop.effect import NO_EFFECTS, Effects, check_effects, effect
from maglev_env.loop.gains import Gains
from maglev_env.rig.excitation import lines_at
from maglev_env.rig.rig import Rig
from sim2real.advice.gain_choice import gain_choice, gain_sets
from sim2real.blind.cases import Answer
from sim2real.blind.excitation import Drive, Grid
from sim2real.blind.judging.judging import Judgement, size_range
from sim2real.blind.judging.scoring import LARGE, REGRET_TARGET, Row, bootstrap, row
from sim2real.blind.rigs import PID
from sim2real.blind.twin import LoopFailed, Truth, twin_periods
from sim2real.compared.point import Point

CASES = 24


@dataclass(frozen=True)
class CaseRegret:
    """Scores on the twin, 0 to 1, of the best gain set and of those that the two simulators choose."""

    id: str
    best: float
    nominal: float
    corrected: float


def sampled(judged: Sequence[Judgement]) -> list[Judgement]:
    """The first CASES singles of at least 10 times the threshold, right or wrong; the seed shuffled their order."""
    large = (j for j in judged if j.case.kind == "single" and size_range(j.case) == LARGE)
    return sorted(large, key=lambda j: j.case.id)[:CASES]


def case_regret(answer: Answer, rig: Rig, truth: Truth, case_id: str) -> CaseRegret:
    """Let both simulators choose among the gain sets, and score every set on the twin.

    Args:
        answer: The answer.
        rig: The campaign's nominal rig, with gains and a protocol that excites force and current.
        truth: The truth of the twin.
        case_id: Identity of the case.
    """
    choice = gain_choice(rig, corrected_point(answer, rig), truth.speed_rpm)
    planned = [replace(protocol_experiment(rig, one), speed_rpm=truth.speed_rpm) for one in gain_sets(rig.gains)]
    twin = np.array([twin_score(e, truth) for e in planned])
    nominal, corrected = (twin[np.argmax(scores)] for scores in (choice.nominal, choice.corrected))
    return CaseRegret(case_id, float(twin.max()), float(nominal), float(corrected))


def corrected_point(answer: Answer, rig: Rig) -> Point:
    """The simulator that an answer puts in place of the nominal one; an answer that names nothing corrects nothing."""
    return Point(correction(answer, rig), answer.changes if answer.cause else {})


def correction(answer: Answer, rig: Rig) -> Effects:
    """The effects by which an answer corrects the nominal rig: the most probable member of its cause.

    No effects when nothing was named, or when the simulator refuses what was named.
    """
    named = [h for h in answer.which if h.effects in answer.cause]
    if not named:
        return NO_EFFECTS
    best = max(named, key=lambda h: h.probability)
    values: dict[str, dict[str, float]] = {name: {} for name in best.effects}
    for key, value in best.parameters.items():
        name, _, parameter = key.partition(".")
        if name in values:
            values[name][parameter] = value
    try:
        effects = {k: v for name in sorted(values) for k, v in effect(name, **values[name]).items()}
        check_effects(effects, rig)
    except ValueError:
        return NO_EFFECTS
    return effects


@dataclass(frozen=True)
class TwinScore:
    """Result of gains on the twin.

    Attributes:
        score: 0 to 1.
        peak_sensitivity: Peak of |S| at the injection lines; nan when the loop failed.
        displacement: Largest reading, m; nan when the loop failed.
        failure: How the loop failed ("the rotor touched down", "a converter clipped"); None if it did not.
    """

    score: float
    peak_sensitivity: float
    displacement: float
    failure: str | None


def twin_score(e: Experiment, truth: Truth) -> float:
    """Score of an experiment's gains on the twin, estimated as `evaluate` does; 0 after touchdown or clipping."""
    return twin_run(e, truth).score


def twin_run(e: Experiment, truth: Truth) -> TwinScore:
    """Run an experiment's gains on the twin, with noise from its seed; estimated as `evaluate` does."""
    force, current = (lines_at(e.excitations, at) for at in ("force", "current"))
    drive = Drive(Grid(tuple(force), tuple(current)), e.waveform("force"), e.waveform("current"))
    try:
        run = twin_periods(truth, pid(e.gains), drive, e.seed, e.transient_periods + e.periods)
    except LoopFailed as failed:
        return TwinScore(0.0, np.nan, np.nan, str(failed))
    kept = {name: values[e.transient_periods :] for name, values in run.items()}
    lines = lines_at(e.excitations)
    spectra = (period_spectra(np.array([kept[name][p] for name in SPECTRAL]), lines) for p in range(e.periods))
    statistics = line_statistics(spectra, e.fundamental, lines, SPECTRAL)
    band = np.array([e.rig.target.band], dtype=float)
    support = maximum_likelihood(force_statistics(statistics, e), band, e.rig.mass, intervals=False)
    injection = statistics.at_lines(current)
    sensitivity, _ = frequency_response(injection, "command", "injection")
    peak = margin_arrays(injection.frequency, sensitivity)["peak_sensitivity"]
    displacement = np.abs(kept["displacement"]).max()
    scored = terms(
        score_target(e.rig),
        support.stiffness[0],
        support.damping[0],
        peak,
        displacement,
        np.sqrt(np.mean(kept["current"] ** 2)),
    )
    return TwinScore(float(score(scored)), float(peak), float(displacement), None)


def pid(gains: Gains) -> PID:
    """The gains in the form that the twin takes."""
    return PID(gains.kp, gains.ki, gains.kd, gains.td, gains.ti)


def regret_row(cases: Sequence[CaseRegret]) -> Row:
    """Share by which the corrected simulators' regret, summed over cases, is below that of the nominal ones."""
    losses = np.array([(c.best - c.nominal, c.best - c.corrected) for c in cases]).reshape(-1, 2)
    return row(
        "regret, corrected against nominal",
        change(losses) if len(losses) else np.nan,
        bootstrap(losses, change),
        len(losses),
        "share",
        REGRET_TARGET,
    )


def change(losses: np.ndarray) -> float:
    """Relative change from the sum of the first column (nominal) to the second (corrected), of losses (n, 2)."""
    nominal, corrected = losses.sum(axis=0)
    if nominal == 0:
        return 0.0 if corrected == 0 else np.inf
    return float(corrected / nominal - 1)


def regrets(
    judged: Sequence[Judgement],
    rig_and_truth: Callable[[Judgement], tuple[Rig, Truth]],
    progress: Callable[[int], None] | None = None,
) -> list[CaseRegret]:
    """The regret of every sampled case; progress is called with the number of cases done."""
    found = []
    for j in sampled(judged):
        found.append(case_regret(j.answer, *rig_and_truth(j), j.case.id))
        if progress:
            progress(1)
    return found
