"""The best controller of a kind under a goal: its weights are sought by the experiment that scores gains, too."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from maglev_env.design.linear_limits import linear_limits
from maglev_env.experiment import Experiment, axis_experiment
from maglev_env.linear.expected import reading_noise
from maglev_env.linear.open_loop import open_loop
from maglev_env.linear.poles import pole_radii
from maglev_env.loop.gains import Controllers
from maglev_env.rig.goal import QUANTITIES
from maglev_env.task.episodes import Episode
from maglev_env.task.gain_box import GainBox
from maglev_env.task.task import Task
from tuning.reference.kinds import Kind, Scales, designed, kind_of, scales_of
from tuning.study.recommendation import Verdict, judged_again
from tuning.study.study import experiments
from tuning.tuner import Trials

ROUNDS, ROUND = 6, 40  # rounds of the search, and controllers of each
CENTRES, NARROWER = 3, 0.45  # best controllers around which the next round looks, and by which it looks closer
# Controllers with the best scores that are told apart, by so many repetitions of each; and those of them that are
# judged as recommended gains are, on rigs within tolerance, until one is not refused.
FINALISTS, AGAIN, JUDGED = 6, 16, 3
SEEDS = 3  # of the noise, over whose scores a search takes the mean: that of one would be a lucky one at a limit
SEARCH = 57721  # mixed into the seed so that its noise is that of nothing else
NO_BOX = GainBox((), np.empty(0), np.empty(0), np.empty(0, bool), ())


@dataclass(frozen=True, eq=False)
class Reference:
    """A reference.

    Attributes:
        kind: Name in KINDS.
        controllers: The controller, or one for each axis.
        weights: In decades from the scales of the rig's own loop, by name.
        verdict: How it is judged, as gains that are recommended are; its point is empty.
        tried: Number of controllers that were tried.
    """

    kind: str
    controllers: Controllers
    weights: dict[str, float]
    verdict: Verdict
    tried: int


def reference(
    task: Task,
    episode: Episode,
    kind: str,
    seed: int,
    threads: int | None = None,
    progress: Callable[[int], None] = lambda n: None,
) -> Reference:
    """The best controller of a kind that a search over its weights finds, judged as gains are.

    Every axis gets the same weights and a controller of its own model, without the coupling to the other axis. The
    task's effects are part of the model, so the reference knows more than a tuner that is not told. Where controllers
    are refused on rigs within tolerance, the next of the best ones is taken, JUDGED of them at most.

    Args:
        task: The task.
        episode: The rig.
        kind: Name in KINDS.
        seed: Seed of the noise and of the search.
        threads: Number of threads; None for all cores.
        progress: Called with the number of experiments made.

    Raises:
        ValueError: No such kind, or no controller of it holds the rig.
        ModuleNotFoundError: A package that it needs is not installed.
    """
    own = kind_of(kind)
    bare, rig = without_gains(task), episode.rig
    whole, views = loops(task, episode)
    scales = [scales_of(view) for view in views]
    rng = np.random.default_rng((SEARCH, seed))
    noise = [int(one) for one in rng.integers(2**63, size=SEEDS)]
    wide, centres = np.array(own.wide), np.zeros((1, len(own.wide)))
    weights, controllers, scores = np.empty((0, len(own.wide))), [], np.empty(0)
    for turn in range(ROUNDS):
        half = wide * NARROWER**turn
        drawn = centres[np.arange(ROUND) % len(centres)] + half * rng.uniform(-1, 1, (ROUND, wide.size))
        if turn == 0:
            drawn[0] = 0.0
        made = _that_hold(own, whole, views, scales, drawn)
        progress(ROUND)
        if not made:
            continue
        found = [each for _, each in made]
        weights = np.vstack([weights, *(one for one, _ in made)])
        scores = np.concatenate([scores, _mean_scores(bare, episode, found, noise, threads)])
        controllers += found
        apart: list[int] = []
        for i in np.argsort(-scores):
            if len(apart) < CENTRES and all((np.abs(weights[i] - weights[j]) > NARROWER * half).any() for j in apart):
                apart.append(int(i))
        centres = weights[apart]
    if not scores.size or not scores.max() > 0:
        raise ValueError(f"reference {kind}: no controller of {ROUNDS * ROUND} holds rig {rig.name}")
    first = np.argsort(-scores, kind="stable")[:FINALISTS]
    fresh = [int(one) for one in rng.integers(2**63, size=AGAIN)]
    means = _mean_scores(bare, episode, [controllers[i] for i in first], fresh, threads)
    verdicts: dict[int, Verdict] = {}
    for i in first[np.argsort(-means, kind="stable")][:JUDGED]:
        judged = replace(episode, rig=replace(rig, gains=controllers[i]))
        verdicts[int(i)] = judged_again(bare, judged, np.empty(0), seed)
        if verdicts[int(i)].reason is None:
            break
    best = max(verdicts, key=lambda i: (verdicts[i].reason is None, verdicts[i].score))
    told = dict(zip(own.names, map(float, weights[best]), strict=True))
    return Reference(kind, controllers[best], told, verdicts[best], ROUNDS * ROUND)


def loops(task: Task, episode: Episode) -> tuple[Experiment, list[Experiment]]:
    """The rig under its own gains with what the task adds, without excitations; and each axis of it by itself."""
    whole = replace(without_gains(task).experiment(episode, np.empty(0), 0), excitations=())
    return whole, [axis_experiment(whole, axis) for axis in range(episode.rig.axes)]


def limits_of(task: Task, episode: Episode) -> dict[str, float]:
    """What no linear controller of the reading can better (`design.linear_limits`), each quantity alone, by name.

    Of two axes the worse, each without the coupling to the other. The noise current is left out where a self-sensor
    reads, whose noise the linear model does not have, and everything where the model has none of it.
    """
    found: dict[str, float] = {}
    for view in loops(task, episode)[1]:
        try:
            own = linear_limits(open_loop(view), reading_noise(view.rig))
        except ValueError:
            return {}
        for name, value in own.items():
            worse = max if QUANTITIES[name].most else min
            found[name] = worse(found.get(name, value), value)
    if task.sensor != "probe":
        found.pop("noise_current", None)
    return found


def without_gains(task: Task) -> Task:
    """The task with nothing to tune: every experiment runs the controller of its episode's rig."""
    return replace(task, box=NO_BOX, layout=replace(task.layout, gains=()))


def held_by(
    bare: Task, episodes: Sequence[Episode], controllers: Sequence[Controllers], threads: int | None = None
) -> Trials:
    """One experiment of each episode, held by these controllers; bare: by `without_gains`."""
    each = [replace(e, rig=replace(e.rig, gains=c)) for e, c in zip(episodes, controllers, strict=True)]
    return experiments(bare, each, np.empty((len(each), 0)), [0] * len(each), threads)


def _mean_scores(
    bare: Task, episode: Episode, controllers: Sequence[Controllers], noise: Sequence[int], threads: int | None
) -> np.ndarray:
    """Mean scores (n,) of controllers under the noise of several seeds."""
    episodes = [replace(episode, seed=seed) for _ in controllers for seed in noise]
    found = held_by(bare, episodes, [one for one in controllers for _ in noise], threads)
    return found.score.reshape(len(controllers), len(noise)).mean(axis=1)


def _that_hold(
    kind: Kind, whole: Experiment, views: Sequence[Experiment], scales: Sequence[Scales], drawn: np.ndarray
) -> list[tuple[np.ndarray, Controllers]]:
    """Weights and controllers of those that exist and whose linear loop is stable."""
    made: list[tuple[np.ndarray, Controllers]] = []
    for decades in drawn:
        try:
            own = tuple(designed(kind, view, s, decades) for view, s in zip(views, scales, strict=True))
        except ValueError:
            continue
        made.append((decades, own if len(own) > 1 else own[0]))
    if not made:
        return []
    stable = pole_radii([replace(whole, gains=controllers) for _, controllers in made]) < 1
    return [one for one, holds in zip(made, stable, strict=True) if holds]
