"""The model-corrected tuner: asks for the gains that score best on a fitted rig as corrected by all measurements."""

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from estimation.normal import NORMAL_95
from maglev_env.evaluation.goal_score import goal_score, goal_terms
from maglev_env.evaluation.requirements import LOOP
from maglev_env.evaluation.score import score, terms
from maglev_env.loop.gains import of_axis
from maglev_env.rig.goal import QUANTITIES
from maglev_env.task.episodes import Episode
from maglev_env.task.task import Task
from tuning.search.corrected.discrepancy import Discrepancy
from tuning.search.corrected.fit import fitted, opened
from tuning.search.corrected.loops import LineModel
from tuning.search.corrected.parameters import Parameters
from tuning.search.corrected.tolerated import Tolerated
from tuning.study.limits import READ, allowed
from tuning.study.recommendation import GAIN_MARGIN
from tuning.study.study import experiments
from tuning.tuner import Trials

DRAWS, PAIRS = 5, 2  # rigs that the experiments allow, the first the best one, and pairs of corrections of each
AGAIN = 1.5  # refit when the data have grown by a half
# Standard deviation of a reading's logarithm, and of what a linear model misses of it anywhere in the same way.
NOISE = {"stiffness": (0.002, 0.1), "damping": (0.005, 0.2), "peak_sensitivity": (0.006, 0.1),
         "peak_displacement": (0.015, 0.3), "current_rms": (0.002, 0.1)}  # fmt: skip
OTHER = (0.02, 0.2)  # of what a goal measures besides
# Times a requirement's limit, beyond which a gain margin is only known to be ample: the loop's gain is so small where
# it crosses the real axis that noise decides where, and what is read over what is modelled says nothing of small ones.
AMPLE = 3.0
CANDIDATES, EVENTS = 180, 48  # points of a round of the search, fewer where their events are simulated
ROUNDS, CENTRES, TRIED = 4, 3, 24  # rounds, points around which the next one looks, and points looked at for these
WIDTH, NARROWER = 0.35, 0.3  # of the box's half width: half the edge of a round's cubes, and its share in the next
CALM, UNSURE = 0.04, 0.05  # score that the first gains of its own may lose, and the share of draws in which it may
LEVEL = 0.05  # weight of the expected score beside the expected gain, which tells points apart where nothing is gained
JITTER = 0.03
MODEL = 31415  # mixed into the seed so that the model's noise differs from that of the experiments


class ModelCorrected:
    """Tries a safe start, then the best gains of a fitted rig whose quantities are corrected by measured / modelled.

    The correction is space mapping (Bandler et al. 2004) with a Gaussian process (Kennedy and O'Hagan 2001): the
    difference is carried from the experiments to their surroundings and fades from there, so that the model alone
    speaks of gains far away. Draws of both say how sure a score is: the next gains are those of the largest expected
    improvement, and those after the start, of which least is known, lose more than CALM in UNSURE of the draws only.
    Under a goal of requirements the limits of a recommendation count as such, too: gains that would be refused, here or
    on rigs within tolerance, are not worth an experiment.
    """

    note: str | None = None

    def __init__(self, task: Task, episode: Episode, seed: int) -> None:
        """Set up for a rig; of the episode only its target is used, and the task's effects are not.

        It starts at the rig's own gains, which are known to hold.
        """
        self._task = replace(task, effects={})
        self._target, self._goal = episode.target, task.layout.goal
        self._rng = np.random.default_rng((MODEL, seed))
        rig = task.rig
        self._parameters = Parameters(rig, task.randomization == "wide")
        self._models = [LineModel(self._task, axis, self._goal) for axis in range(rig.axes)]
        self._start = task.box.point(of_axis(rig.gains, 0))
        self._told: Trials | None = None
        self._batches = 0  # of experiments that were told together: of those of the first all are at the start
        self._thetas, self._due = self._parameters.centre[None], 1
        names = [r.name for r in self._goal.measured] if self._goal else list(NOISE)
        self._names = {n: n if self._goal is None else f"required_{n}" for n in names}
        self._limits = {f"limit_{n}": key for n, key in READ.items()} if self._goal else {}
        self._names |= self._limits
        self._tolerated = Tolerated(self._models)
        required = self._goal.requirements if self._goal else ()
        self._ample = {r.name: AMPLE * r.limit for r in required if r.name == "gain_margin" and r != self._goal.best}
        self._ample["limit_gain_margin"] = AMPLE * GAIN_MARGIN
        self._events = [r.name for r in self._goal.measured if r.quantity.event] if self._goal else []

    def ask(self, n: int) -> np.ndarray:
        if self._told is None:
            best = self._start
        elif not self._good().size:
            best = self._start + 0.2 * self._rng.standard_normal(self._start.size)
        else:
            self._learn()
            best = self._searched()
        points = best + JITTER * self._rng.standard_normal((n, best.size))
        points[0] = best
        return np.clip(points, -1.0, 1.0)

    def tell(self, trials: Trials) -> None:
        self._told = trials if self._told is None else self._told + trials
        self._batches += 1

    @property
    def parameters(self) -> dict[str, float]:
        """The rig's identified parameters, relative to the nominal ones; the delay in control samples."""
        values = dict(zip(self._parameters.names, map(float, self._thetas[0]), strict=True))
        return {n: v if n == "delay" else float(np.exp(v)) for n, v in values.items()}

    def _good(self) -> np.ndarray:
        return np.flatnonzero(self._told.score > 0)

    def _learn(self) -> None:
        """Fit the rig if enough is new, and carry what remains between measured and modelled."""
        good = self._good()
        points, infos = self._told.points[good], [self._told.info[i] for i in good]
        if len(self._told) >= self._due:
            start, first = self._thetas[0], self._batches == 1
            self._thetas = fitted(self._parameters, self._models, points, infos, start, DRAWS, self._rng, first)
            self._due = int(np.ceil(AGAIN * len(self._told) + 0.5))
            self._loops = opened(self._parameters, self._models, self._thetas)
            if self._limits:
                self._tolerated.open(self._parameters.rig_at(self._thetas[0]))
        axes = [int(i.get("axis", 0)) % len(self._models) for i in infos]
        self._ratios, self._corrections = {}, {}
        modelled = self._modelled(points)
        row = np.arange(len(points))
        for name, key in self._names.items():
            measured = np.array([i.get(key, np.nan) for i in infos], float)
            most = self._ample.get(name, np.inf)
            with np.errstate(divide="ignore", invalid="ignore"):
                ratios = np.log(np.minimum(measured, most)) - np.log(np.minimum(modelled[name][:, axes, row], most))
            noise, constant = NOISE.get(name, OTHER)
            self._ratios[name] = np.where(np.isfinite(ratios), ratios, np.nan)
            spread = np.hypot(noise, [_relative_error(i, key) for i in infos])
            self._corrections[name] = own = Discrepancy(points, spread, constant, 0.01)
            own.learn(self._ratios[name][0])

    def _modelled(self, points: np.ndarray) -> dict[str, np.ndarray]:
        """Quantities (draws, axes, m) of the fitted rigs at points."""
        every = [[m.values(loop, points) for m, loop in zip(self._models, loops, strict=True)] for loops in self._loops]
        found = {}
        for name in self._names:
            if name in self._events:
                continue
            key, scale = ("peak_displacement", self._target.clearance) if name == "displacement" else (name, 1.0)
            key = self._limits.get(name, key)
            found[name] = np.array([[values[key] / scale for values in axes] for axes in every])
            if self._goal and name in LOOP:  # such margins count as missed, whatever they are
                below = np.array([[values["below_lines"] for values in axes] for axes in every])
                found[name][below] = np.inf if QUANTITIES[name].most else -np.inf
        if self._events:
            rig = self._parameters.rig_at(self._thetas[0])
            episode = Episode(rig, self._target, self._start, 0)
            shown = experiments(self._task, [episode] * len(points), points, [0] * len(points)).info
            for name in self._events:
                values = np.array([i.get(f"required_{name}", np.nan) for i in shown], float)
                found[name] = np.broadcast_to(values, (len(every), len(self._models), len(points)))
        return found

    def _scores(self, points: np.ndarray) -> np.ndarray:
        """Scores (draws, m) at points (m, k), model and correction drawn together."""
        modelled, corrected = self._modelled(points), {}
        rng = np.random.default_rng(271828)  # the same draws whatever the points
        for name in self._names:
            mean, spread = self._corrections[name].at(points, np.nan_to_num(self._ratios[name]))
            normal = rng.standard_normal((PAIRS, len(mean), 1))
            normal = np.concatenate([normal, -normal])
            corrected[name] = modelled[name] * np.exp(mean + normal * spread)[:, :, None, :]
        if self._goal:
            found = goal_score(goal_terms(self._goal, corrected)) * allowed(self._worst(points, corrected))
        else:
            found = score(terms(self._target, *(corrected[name] for name in NOISE)))
        return np.nan_to_num(found).min(axis=2).reshape(-1, len(points))

    def _worst(self, points: np.ndarray, corrected: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
        """What a recommendation limits, (..., axes, m), by quantity: the corrected values, within tolerance."""
        scale = {"displacement": self._target.clearance}
        return {
            name: corrected[f"limit_{name}"] * factor / scale.get(name, 1.0)
            for name, factor in self._tolerated.factors(points).items()
        }

    def _searched(self) -> np.ndarray:
        """The point that is expected to gain most; after the first experiments, among those that surely lose little."""
        told, good = self._told, self._good()
        own = self._scores(told.points[good]).mean(axis=0)
        bar, anchor = own.max(), told.points[good[own.argmax()]]
        count = EVENTS if self._events else CANDIDATES
        centres, values, width = anchor[None], np.full(1, -np.inf), WIDTH
        for turn in range(ROUNDS):
            spread = self._rng.uniform(-1, 1, (len(centres), count // len(centres), anchor.size))
            points = [centres, (centres[:, None] + width * spread).reshape(-1, anchor.size)]
            if turn == 0:
                points.append(self._rng.uniform(-1, 1, (count, anchor.size)))
            points = np.clip(np.vstack(points), -1, 1)
            drawn = self._scores(points)
            mean = drawn.mean(axis=0)
            merit = np.maximum(drawn - bar, 0.0).mean(axis=0) + LEVEL * mean
            if self._batches == 1:
                merit -= np.maximum(0.0, bar - CALM - np.quantile(drawn, UNSURE, axis=0))
            centres, values = self._leading(points, merit, width)
            width *= NARROWER
        return centres[values.argmax()]

    def _leading(self, points: np.ndarray, merit: np.ndarray, width: float) -> tuple[np.ndarray, np.ndarray]:
        """The best sound points that lie apart, and their merits."""
        chosen: list[int] = []
        for i in np.argsort(-merit)[:TRIED]:
            apart = np.abs(points[chosen] - points[i]).max(axis=1) > NARROWER * width
            if apart.all() and self._sound(points[i]):
                chosen.append(int(i))
            if len(chosen) == CENTRES:
                break
        chosen = chosen or [0]  # the first is a point that held
        return points[chosen], merit[chosen]

    def _sound(self, point: np.ndarray) -> bool:
        rig = self._parameters.rig_at(self._thetas[0])
        return all(bool(model.sound(rig, point[None])[0]) for model in self._models)


def _relative_error(info: Mapping[str, Any], name: str) -> float:
    """Relative standard deviation of a quantity whose 95 % interval an experiment tells; 0 where it tells none.

    Of a gain margin that noise may have no crossing of, only the lower end is known.
    """
    low, high = (info.get(f"{name}_{end}", np.nan) for end in ("low", "high"))
    value = abs(info.get(name, np.nan))
    half = (high - low) / 2 if np.isfinite(high) else value - low
    error = half / (NORMAL_95 * value) if value else np.nan
    return float(error) if np.isfinite(error) else 0.0
