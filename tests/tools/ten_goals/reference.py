"""The best gains of a rig under a goal by exhaustive search over its linear loop, corrected by a few experiments."""

from dataclasses import dataclass, replace

import numpy as np
import scipy
from exhaustive import axes_of, worst

from maglev_env.rig.goal import QUANTITIES
from tuning.study.recommendation import Verdict, judged_again
from tuning.study.study import experiments

FIRST, ROUND, CENTRES = 2048, 160, 5  # sets that fill the box, and of each round around each of the best ones
WIDTHS, AGAIN_WIDTHS = (0.3, 0.1, 0.03), (0.08, 0.02)  # half the edges of the rounds' cubes
SIMULATED = 384  # sets whose experiments are simulated where the linear loop finds none that meets everything
MEASURED, SEEDS = 6, 8  # sets that are measured to correct the model, and experiments of each
RESERVES = (0.0, 0.004, 0.012, 0.03)  # shares of a limit that are kept, the next one where a limit is missed then
KEPT, SPARED = 0.04, (0.02, 0.06, 0.09)  # the reserve that the score keeps, and others that it may
ROBUST = (1.0, 1.04, 1.08, 1.13, 1.2, 1.35)  # the same of what may be recommended, where gains are refused
REFUSED = {"peak_sensitivity": 4.0, "phase_margin": 20.0, "gain_margin": 1.5}


@dataclass(frozen=True)
class Found:
    """What a search finds.

    Attributes:
        best: The best set that meets every requirement, None where none does.
        reserved: The same with KEPT of each limit to spare.
        scored: The set of the highest score.
        least_miss: The least logarithm by which a set of the corrected model misses a limit, 0 where all are met.
        tried: Number of gain sets whose linear loop was computed.
    """

    best: Verdict | None
    reserved: Verdict | None
    scored: Verdict
    least_miss: float
    tried: int


def misses(name, limit, values):
    """Logarithm (m,) by which values miss a limit; nan is a miss, but of a margin without a crossing."""
    sign = 1 if QUANTITIES[name].most else -1
    with np.errstate(invalid="ignore", divide="ignore"):
        return np.nan_to_num(sign * np.log(np.maximum(values, 1e-300) / limit), nan=9.0, posinf=9.0, neginf=-9.0)


class Search:
    """A search on one rig; what it measures corrects what it computes."""

    def __init__(self, task, episode, seed):
        self.task, self.episode, self.goal = task, episode, task.layout.goal
        self.axes = axes_of(task, episode, self.goal)
        self.rng = np.random.default_rng([613, seed])
        self.k, self.at, self.ratios = len(task.box.names), np.empty((0, len(task.box.names))), []
        self.tried = 0
        sobol = scipy.stats.qmc.Sobol(self.k, seed=self.rng)
        self.points = 2 * sobol.random(FIRST) - 1
        self.values = self.computed(self.points)

    def computed(self, points):
        self.tried += len(points)
        return worst(self.axes, self.task.box.gains(points))

    def corrected(self):
        """The values of all points by what was measured near them."""
        if not len(self.at):
            return self.values
        distance = np.linalg.norm(self.points[:, None] - self.at, axis=2)
        weight = 1 / (distance + 1e-3) ** 2
        weight /= weight.sum(axis=1, keepdims=True)
        return {n: v * np.exp(weight @ np.array([r.get(n, 0.0) for r in self.ratios])) for n, v in self.values.items()}

    def merit(self, reserve, robust, by_score):
        """What is best is largest: within the limits what is made best, beyond them the nearest; or the score."""
        v, goal = self.corrected(), self.goal
        each = [misses(r.name, r.limit, v[r.name]) for r in goal.requirements]
        each += [misses(n, limit, v[n]) + np.log(robust) for n, limit in REFUSED.items()]
        each, best = np.array(each), misses(goal.best.name, goal.best.limit, v[goal.best.name])
        if by_score:
            soft = 0.01 * np.logaddexp(0, each / 0.01)
            return -np.log1p(soft / 0.05).sum(axis=0) + np.log1p(1 / (1 + np.exp(best)))
        over = np.maximum(each + reserve, 0)
        return np.where((over == 0).all(axis=0), 100 - best, -over.max(axis=0) - 0.1 * over.sum(axis=0))

    def apart(self, merit, n, width):
        chosen = []
        for i in np.argsort(-merit)[:200]:
            if all(np.abs(self.points[i] - self.points[j]).max() > width for j in chosen):
                chosen.append(i)
            if len(chosen) == n:
                break
        return chosen

    def rounds(self, widths, *how):
        for width in widths:
            centres = self.points[self.apart(self.merit(*how), CENTRES, 0.5 * width)]
            spread = self.rng.uniform(-width, width, (len(centres), ROUND, self.k))
            fresh = np.clip((centres[:, None] + spread).reshape(-1, self.k), -1, 1)
            values = self.computed(fresh)
            self.points = np.vstack([self.points, fresh])
            self.values = {n: np.concatenate([v, values[n]]) for n, v in self.values.items()}

    def measure(self, n, *how):
        """Experiments at the best n sets that lie apart, which correct the model."""
        for i in self.apart(self.merit(*how), n, 0.03):
            episodes = [replace(self.episode, seed=int(s)) for s in self.rng.integers(2**62, size=SEEDS)]
            told = experiments(self.task, episodes, np.tile(self.points[i], (SEEDS, 1)), [0] * SEEDS, 1).info
            ratio = {}
            for name, v in self.values.items():
                read = [row.get(f"required_{name}", np.nan) for row in told]
                with np.errstate(invalid="ignore", divide="ignore"):
                    one = np.log(np.median(read) / v[i])
                ratio[name] = float(np.clip(one, -1, 1)) if np.isfinite(one) else 0.0
            self.at = np.vstack([self.at, self.points[i]])
            self.ratios.append(ratio)


def is_met(goal, verdict):
    return all(
        misses(r.name, r.limit, np.array(verdict.required.get(f"required_{r.name}", np.nan))) <= 0
        or (r.name in ("phase_margin", "gain_margin") and np.isnan(verdict.required.get(f"required_{r.name}", np.nan)))
        for r in goal.requirements
    )


def reference(task, episode, seed):
    """The best set within the limits, and the one of the best score, judged as gains that are recommended are."""
    search = Search(task, episode, seed)
    first = (0.0, 1.0, False)
    search.rounds(WIDTHS, *first)
    search.measure(MEASURED, *first)
    search.rounds(AGAIN_WIDTHS, *first)
    search.measure(MEASURED // 2, *first)
    search.rounds(AGAIN_WIDTHS, *first)
    robust, judged = 0, {}

    def verdict(*how):
        i = int(search.merit(*how).argmax())
        if i not in judged:
            judged[i] = judged_again(task, episode, search.points[i], seed)
        return judged[i]

    for reserve in RESERVES:
        one = verdict(reserve, ROBUST[robust], False)
        while one.reason is not None and robust < len(ROBUST) - 1:
            robust += 1
            search.rounds(AGAIN_WIDTHS[1:], reserve, ROBUST[robust], False)
            one = verdict(reserve, ROBUST[robust], False)
        if one.reason is None and is_met(task.layout.goal, one):
            break
    # The score is a mean over readings, so its best set keeps more of a limit the more they scatter.
    for how in ((0.0, ROBUST[robust], True), (KEPT, ROBUST[robust], False)):
        search.rounds(AGAIN_WIDTHS[1:], *how)
        kept = verdict(*how)
    for reserve in SPARED:
        verdict(reserve, ROBUST[robust], False)
    name, sound = task.layout.goal.best.name, [v for v in judged.values() if v.reason is None]
    meets = [v for v in sound if is_met(task.layout.goal, v)]
    scored = max(sound or judged.values(), key=lambda v: v.score)
    best = min(meets, key=lambda v: misses(name, 1.0, np.array(v.required[f"required_{name}"])), default=None)
    merit = search.merit(0.0, 1.0, False)
    least = max(0.0, float(-merit.max()))
    spared = kept if any(kept is one for one in meets) else None
    if best is None:  # what only experiments show, such as a large motion, may be why
        point, least = simulated(task, episode, search.rng)
        one = judged_again(task, episode, point, seed)
        best = one if one.reason is None and is_met(task.layout.goal, one) else None
        scored = max(scored, one, key=lambda v: (v.reason is None, v.score))
    return Found(best, spared, scored, least, search.tried)


def simulated(task, episode, rng):
    """The set that misses least in its experiment among SIMULATED that fill the box and two rounds; and its miss."""
    k = len(task.box.names)
    points = 2 * scipy.stats.qmc.Sobol(k, seed=rng).random(SIMULATED) - 1
    every, missed = np.empty((0, k)), np.empty(0)
    for width in (0.15, 0.04, None):
        told = experiments(task, [episode] * len(points), points, [0] * len(points), 1).info
        each = []
        for r in task.layout.goal.requirements:
            value = np.array([row.get(f"required_{r.name}", np.nan) for row in told], float)
            unknown = np.isnan(value) & (r.name in ("phase_margin", "gain_margin"))
            each.append(np.where(unknown, -9.0, misses(r.name, r.limit, value)))
        every, missed = np.vstack([every, points]), np.concatenate([missed, np.max(each, axis=0)])
        if width:
            centres = every[np.argsort(missed)[:4]]
            spread = rng.uniform(-width, width, (len(centres), SIMULATED // 16, k))
            points = np.clip((centres[:, None] + spread).reshape(-1, k), -1, 1)
    return every[missed.argmin()], max(0.0, float(missed.min()))
