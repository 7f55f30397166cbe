"""Candidate gains on an identified rig: scores and margins over its posterior and on the measured plant; optimum."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from estimation.normal import NORMAL_95
from estimation.stability_margins import Margins, margins
from maglev_env.loop.gains import Gains
from maglev_env.rig.rig import Rig
from maglev_env.task.episodes import Episode
from maglev_env.task.task import Task
from tuning.campaign.recorded_sets import DRAWS, GainSet, Response, pooled
from tuning.campaign.rig_fit import IdentifiedRig, measured_sensitivity
from tuning.search.evolution import DifferentialEvolution
from tuning.search.optimum import searched_optimum
from tuning.study.recommendation import Verdict, verdict_of
from tuning.study.study import experiments

REPEATS, RIGS = 8, 32  # repetitions on the identified rig, and rigs from its posterior, by which gains are judged
SEARCH, GENERATIONS = 8, 14  # population per gain, and number of generations


@dataclass(frozen=True, eq=False)
class Prediction:
    """What the identified rig predicts for gains.

    Attributes:
        gains: The gains.
        verdict: Verdict over noise and the parameters' posterior.
        held: Whether the rotor levitates in all of these simulations.
        margins: Margins of the measured plant with these gains; None where no injection showed it.
        response: The sensitivity that these margins belong to.
    """

    gains: Gains
    verdict: Verdict
    held: bool
    margins: Margins | None
    response: Response | None

    @property
    def peak(self) -> tuple[float, float]:
        """Interval of the peak sensitivity, with the wider end of model and measured plant.

        For the measured plant the upper end is the largest value that any single line may have: where the plant is
        hardly known, the interval of the largest line is too narrow.
        """
        low, high = self.verdict.intervals.get("peak_sensitivity", (np.nan, np.inf))
        if self.margins is None:
            return low, high
        ends = [end or self.margins.peak_sensitivity for end in self.margins.intervals["peak_sensitivity"]]
        alone = np.max(np.abs(self.response.value) + NORMAL_95 * np.sqrt(self.response.variance / 2))
        return float(np.fmin(low, ends[0])), float(max(high, ends[1], alone))


@dataclass(frozen=True, eq=False)
class Model:
    """The model by which gains are judged.

    Attributes:
        task: The task; its box covers the recorded gains.
        corners: Corners (2, k) of the rig's own bounds in that box.
        own: Episodes of the identified rig.
        spread: Episodes of rigs from its posterior.
        plant: The measured plant, if known.
    """

    task: Task
    corners: np.ndarray
    own: Sequence[Episode]
    spread: Sequence[Episode]
    plant: Response | None

    def gains(self, point: np.ndarray) -> Gains:
        return self.task.box.applied(self.task.rig.gains, self.task.box.gains(point))

    def point(self, gains: Gains) -> np.ndarray:
        return self.task.box.point(gains)


def model_of(
    task: Task, corners: np.ndarray, identified: IdentifiedRig, good: Sequence[GainSet], rng: np.random.Generator
) -> Model:
    """The model by which gains are judged; every random choice comes from rng."""
    start = np.zeros(len(task.box.names))

    def episode(rig: Rig) -> Episode:
        return Episode(rig, task.target, start, int(rng.integers(2**63)))

    own = [episode(identified.rig()) for _ in range(REPEATS)]
    spread = [episode(rig) for rig in identified.drawn(RIGS, rng)]
    return Model(task, corners, own, spread, pooled([s.plant for s in good if s.plant]))


def predict(model: Model, gains: Gains, seed: int) -> Prediction:
    """Predict gains on the identified rig, on rigs of its posterior, and on the measured plant."""
    point, lanes = model.point(gains), [*model.own, *model.spread]
    again = experiments(model.task, lanes, np.tile(point, (len(lanes), 1)), [0] * len(lanes))
    verdict = verdict_of(point, again, len(model.own), model.own[0])
    held = not again.touchdown.any() and bool((again.score > 0).all())
    if model.plant is None:
        return Prediction(gains, verdict, held, None, None)
    p = model.plant
    s, variance = measured_sensitivity(p.value, p.variance, p.frequency, gains, model.task.rig.control_rate)
    found = margins(p.frequency, s, variance, DRAWS, seed)
    return Prediction(gains, verdict, held, found, Response(p.frequency, s, variance))


def optimum(model: Model, start: Gains, rng: np.random.Generator) -> np.ndarray:
    """Best-scoring point on the identified rig within the rig's bounds; the search also begins at `start`."""
    low, high = model.corners
    best = model.point(start)
    inside = np.clip(2 * (best - low) / (high - low) - 1, -1.0, 1.0)
    search = DifferentialEvolution(len(low), int(rng.integers(2**31)), SEARCH, inside)

    def place(asked: np.ndarray) -> np.ndarray:
        return low + (high - low) * (asked + 1) / 2

    # Experiment number 1, because the noise of number 0 judges the result.
    return searched_optimum(model.task, model.own[0], search, GENERATIONS, np.clip(best, low, high), 1, place)
