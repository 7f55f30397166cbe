"""The value of a diagnosis in gains: every rig of an opened set as nominal and corrected simulator and as twin."""

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path

import numpy as np

from maglev_env.evaluation.evaluate import evaluate
from maglev_env.evaluation.score import ScoreTarget
from maglev_env.evaluation.target import score_target
from maglev_env.experiment import Experiment, protocol_experiment
from maglev_env.loop.effect import check_effects
from maglev_env.recordings.campaign import load_campaign
from maglev_env.rig.rig import Rig
from maglev_env.task.gain_box import GainBox, gain_box
from sim2real.blind.answer import OPENED
from sim2real.blind.cases import ANSWERS, CAMPAIGNS, Answer, Case, open_labels, read_answer, seal_of
from sim2real.blind.judging.judging import judge, size_range
from sim2real.blind.judging.regret import change, correction, twin_run
from sim2real.blind.judging.scoring import LARGE, answer_words, bootstrap, truth_words
from sim2real.blind.twin import Truth
from sim2real.compared.point import Point, experiment_at

NOMINAL, CORRECTED, TWIN = SIMULATORS = ("nominal", "corrected", "twin")
PRESET = "preset"  # the rig's gains before any tuning
FACTORS = {"kp": 3.0, "ki": 10.0, "kd": 3.0}  # range on either side of the preset, where a rig gives no bounds
AGAIN = 8  # runs with fresh noise that score recommended gains on the twin
LEAST = 0.70  # share by which corrected simulators should have less regret than nominal ones


@dataclass(frozen=True)
class TwinCase:
    """A case of an opened set with a single large effect.

    Attributes:
        id: Identity of the campaign.
        channels: Name of the channel set.
        size: Size in multiples of the detection threshold.
        truth: The truth in words.
        answer: The answer in words.
        right: Whether the answer names the true effect, or a class of alike effects that holds it.
        rig: The nominal rig as the campaign states it.
        twin: The true system.
        corrected: The point that the answer puts in place of the nominal one.
    """

    id: str
    channels: str
    size: float
    truth: str
    answer: str
    right: bool
    rig: Rig
    twin: Truth
    corrected: Point

    @cached_property
    def box(self) -> GainBox:
        """The gains that are tuned."""
        preset = vars(self.rig.gains)
        around = {name: (preset[name] / f, preset[name] * f) for name, f in FACTORS.items()}
        return gain_box(self.rig, bounds={n: pair for n, pair in around.items() if n not in self.rig.bounds})

    @cached_property
    def start(self) -> np.ndarray:
        """The preset gains in the box (k,)."""
        return self.box.point(self.rig.gains)

    @cached_property
    def target(self) -> ScoreTarget:
        """The target of the nominal rig, whichever system is simulated."""
        return score_target(self.rig)

    def experiments(self, points: np.ndarray, seeds: Sequence[int]) -> list[Experiment]:
        """The rig's protocol at points (n, k) of the box, at the campaign's speed, on the nominal rig."""
        found = []
        for values, seed in zip(self.box.gains(points), seeds, strict=True):
            e = protocol_experiment(self.rig, self.box.applied(self.rig.gains, values))
            found.append(replace(e, speed_rpm=self.twin.speed_rpm, seed=seed))
        return found

    def scores(self, simulator: str, points: np.ndarray, seeds: Sequence[int]) -> tuple[np.ndarray, np.ndarray]:
        """Scores (n,) of points (n, k) of the box on one of SIMULATORS, and whether the loop failed (n,)."""
        planned = self.experiments(points, seeds)
        if simulator == TWIN:
            runs = [twin_run(e, self.twin) for e in planned]
            return np.array([r.score for r in runs]), np.array([r.failure is not None for r in runs])
        point = self.corrected if simulator == CORRECTED else Point({}, {})
        found = evaluate([experiment_at(e, point) for e in planned], 1, targets=[self.target] * len(planned))
        return found.score, ~found.feasible


@dataclass(frozen=True)
class Recommended:
    """Gains that tuning on one simulator recommends.

    Attributes:
        gains: Gains by name, SI.
        promised: Their score where they were tuned.
        score: Their score on the twin, mean of AGAIN runs.
        peak_sensitivity: Mean of the runs that levitated; nan if none did.
        displacement: Mean of the runs that levitated, m; nan if none did.
        failures: Number of runs with touchdown or clipping.
        tried: Number of experiments that tuning took.
        failed: Number of these in which the loop failed.
    """

    gains: Mapping[str, float]
    promised: float
    score: float
    peak_sensitivity: float
    displacement: float
    failures: int
    tried: int
    failed: int


@dataclass(frozen=True)
class CaseWorth:
    """What tuning on each of SIMULATORS recommends for one case, and PRESET."""

    id: str
    rig: str
    channels: str
    size: float
    truth: str
    answer: str
    right: bool
    by: Mapping[str, Recommended]

    @property
    def best(self) -> float:
        """The best score on the twin among the recommendations."""
        return max(r.score for r in self.by.values())

    def regret(self, name: str) -> float:
        """How far one recommendation stays below that."""
        return self.best - self.by[name].score


@dataclass(frozen=True)
class Total:
    """Totals over all cases for one of SIMULATORS or PRESET.

    Attributes:
        regret: Sum of the regrets.
        interval: Its 95 % interval over cases.
        peak_sensitivity: Median; inf where the loop failed.
        failures: Number of cases in which the loop failed in any run.
        tried: Number of experiments that tuning took.
        failed: Number of these that failed.
    """

    regret: float
    interval: tuple[float, float]
    peak_sensitivity: float
    failures: int
    tried: int
    failed: int


def twin_cases(folder: Path, most: int | None = None) -> list[TwinCase]:
    """Singles of at least 10 times the threshold, right or wrong; the first `most` of them.

    Raises:
        ValueError: The set is not opened yet, its labels were changed, or there is no such case.
    """
    seal = seal_of(folder)
    if not (folder / OPENED).is_file():
        raise ValueError(
            f"{folder} is still sealed, and its truth must not be used: answer and open it first "
            f"(maglev blind answer {folder}, then maglev blind open {folder})"
        )
    large = [case for case in open_labels(folder) if case.kind == "single" and size_range(case) == LARGE]
    if not large:
        raise ValueError(f"{folder} holds no single effect of 10 times its threshold or more: make a larger set")
    return [_case(folder, case, seal) for case in sorted(large, key=lambda case: case.id)[:most]]


def _case(folder: Path, case: Case, seal: str) -> TwinCase:
    answer = folder / ANSWERS / f"{case.id}.json"
    j = judge(case, read_answer(answer, seal))
    label, rig = case.label, load_campaign(folder / CAMPAIGNS / case.id).rig
    twin = Truth(label["rig"], label["deviations"], label["effects"], label["forms"], label["speed_rpm"])
    words = j.answer.error or answer_words(j)
    point = written_point(json.loads(answer.read_text()).get("diagnosis", {}), j.answer, rig)
    return TwinCase(case.id, case.channels, case.size, truth_words(j), words, j.right_class, rig, twin, point)


def written_point(diagnosis: Mapping, answer: Answer, rig: Rig) -> Point:
    """The corrected simulator that a diagnosis (JSON data) wrote, or the one of its cause where it wrote none.

    It is the nominal one if the simulator refuses it.
    """
    written = diagnosis.get("corrected")
    effects = correction(answer, rig) if written is None else written["effects"]
    point = Point(effects, answer.changes)
    try:
        e = experiment_at(protocol_experiment(rig, rig.gains), point)
        check_effects(e.effects, e.rig)
    except ValueError:
        return Point({}, {})
    return point


def recommended(
    case: TwinCase, point: np.ndarray, promised: float, tried: int, failed: int, seeds: Sequence[int]
) -> Recommended:
    """Score a point (k,) of the box on the twin, once with the noise of each seed."""
    runs = [twin_run(e, case.twin) for e in case.experiments(np.tile(point, (len(seeds), 1)), seeds)]
    stood = [r for r in runs if r.failure is None]
    gains = dict(zip(case.box.names, case.box.gains(point).tolist(), strict=True))
    peak, displacement = (
        float(np.mean([getattr(r, name) for r in stood])) if stood else np.nan
        for name in ("peak_sensitivity", "displacement")
    )
    score = float(np.mean([r.score for r in runs]))
    return Recommended(gains, promised, score, peak, displacement, len(runs) - len(stood), tried, failed)


def totals(cases: Sequence[CaseWorth]) -> dict[str, Total]:
    """Totals of PRESET and SIMULATORS over at least one case."""
    found = {}
    for name in (PRESET, *SIMULATORS):
        regret = np.array([c.regret(name) for c in cases])
        of = [c.by[name] for c in cases]
        peak = np.median([np.inf if r.failures else r.peak_sensitivity for r in of])
        found[name] = Total(
            float(regret.sum()),
            bootstrap(regret, lambda r: float(r.sum())),
            float(peak),
            sum(r.failures > 0 for r in of),
            sum(r.tried for r in of),
            sum(r.failed for r in of),
        )
    return found


def reduction(cases: Sequence[CaseWorth], name: str = CORRECTED) -> tuple[float, float, float]:
    """Share by which the regret of `name`, summed over cases, is below that of the nominal simulators.

    Returns:
        value: The share.
        low: Lower end of its 95 % bootstrap interval over cases.
        high: Upper end.
    """
    losses = np.array([(c.regret(NOMINAL), c.regret(name)) for c in cases])
    low, high = bootstrap(losses, change)
    return -change(losses), -high, -low
