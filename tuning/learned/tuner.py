"""A trained policy as a tuner."""

from contextlib import suppress
from functools import cache
from pathlib import Path

import numpy as np

from maglev_env.evaluation.score import stacked
from maglev_env.task.episodes import Episode
from maglev_env.task.task import Task
from tuning.learned.familiar import SHARE
from tuning.learned.policy import HistoryPolicy, Shape, load_policy
from tuning.search.corrected.tuner import ModelCorrected
from tuning.tuner import Trials

SHIPPED = Path(__file__).parent / "policies"
JITTER = 0.03  # noise around the policy's point that separates points asked for together


class LearnedTuner:
    """Tries the episode's safe start, then what the policy computes from all observations so far.

    With as many observations as it was trained with, the policy has said what it can. Where an observation at gains
    that it chose lies farther from the mean of the training than nearly all observations did there
    (`familiar.SHARE`), it is out of its depth. In both cases the model-corrected tuner goes on with all experiments so
    far, and `note` says so.
    """

    note: str | None = None

    def __init__(self, task: Task, episode: Episode, policy: HistoryPolicy, seed: int) -> None:
        """Set up for a rig; of the episode only its target and start are used.

        Raises:
            ValueError: The policy was trained for other gains or observations than the task's. A policy that observes
                its target may serve a task whose observation leaves it out.
        """
        own = policy.shape
        self._beside = np.clip(task.layout.of_target(stacked([episode.target]))[:, : _beside(own, task)], -1, 1)
        self._policy, self._start, self._seen = policy, np.asarray(episode.start, float), np.empty((0, len(own.names)))
        self._left, self._told = own.names.index("experiments_left"), None
        self._rng = np.random.default_rng(seed)
        self._task, self._episode, self._seed = task, episode, seed
        self._corrected: ModelCorrected | None = None

    def ask(self, n: int) -> np.ndarray:
        if self._corrected is not None:
            return self._corrected.ask(n)
        first = self._start if self._told is None else self._policy.act(self._seen[None])[0]
        points = first + JITTER * self._rng.standard_normal((n, first.size))
        points[0] = first
        return np.clip(points, -1.0, 1.0)

    def tell(self, trials: Trials) -> None:
        before = self._told
        self._told = trials if before is None else before + trials
        if self._corrected is not None:
            self._corrected.tell(trials)
            return
        seen = np.concatenate([trials.observation, np.tile(self._beside, (len(trials), 1))], axis=1)
        # The policy was trained on episodes as long as its history, whatever the budget is here.
        count, history = len(self._seen) + 1 + np.arange(len(trials)), self._policy.shape.history
        seen[:, self._left] = np.clip(1 - 2 * count / history, -1, 1)
        self._seen = np.concatenate([self._seen, seen])
        # The first gains are the episode's, however many were asked for together.
        why = None if before is None else self._out_of_depth(seen, count)
        if why is None and len(self._told) >= history:
            why = f"the policy was trained for {history} experiments"
        if why is not None:
            self.note = f"{why}; the model-corrected tuner goes on"
            self._corrected = ModelCorrected(self._task, self._episode, self._seed)
            for told in (before, trials):
                if told is not None:
                    self._corrected.tell(told)

    def _out_of_depth(self, seen: np.ndarray, count: np.ndarray) -> str | None:
        """A clause where one of these observations (n, size) is strange to the policy; count: numbers of them (n,)."""
        known = self._policy.familiar
        if known is None:
            return None
        far = known.distance(seen)
        row = int(far.argmax())
        if far[row] <= known.limit:
            return None
        return (
            f"the policy is out of its depth: experiment {count[row]} lies {far[row]:.1f} standard deviations from the "
            f"mean of its training ({SHARE:.0%} of that within {known.limit:.1f})"
        )


@cache
def _stored(path: Path) -> HistoryPolicy:
    return load_policy(path)[0]


def shipped_policy(task: Task) -> HistoryPolicy:
    """The package's policy for the task's rig, gains and observations.

    Raises:
        ValueError: There is none.
    """
    paths = sorted(SHIPPED.glob("*.npz"))
    for path in paths:
        with suppress(ValueError):
            _beside(_stored(path).shape, task)
            return _stored(path)
    raise ValueError(
        f"method 'learned': the policies of this package ({', '.join(p.stem for p in paths)}) serve other rigs, gains "
        f"or observations than those of {task.name}; train one (maglev train) and name it (--policy)"
    )


def _beside(own: Shape, task: Task) -> int:
    """Number of elements that the policy expects in addition to the task's observation.

    Raises:
        ValueError: The policy does not fit the task.
    """
    _same("gains", own.gains, task.box.names)
    if not np.allclose(np.transpose(own.ends), [task.box.low, task.box.high]):
        shown = ", ".join(f"{name} {low:g} .. {high:g}" for name, (low, high) in zip(own.gains, own.ends, strict=True))
        raise ValueError(f"the policy was trained for gains within {shown}; train one for these bounds (maglev train)")
    if own.names == (*task.layout.names, *task.layout.TARGET):
        return len(task.layout.TARGET)
    _same("observations", own.names, tuple(task.layout.names))
    return 0


def _same(what: str, own: tuple[str, ...], asked: tuple[str, ...]) -> None:
    if tuple(own) != tuple(asked):
        raise ValueError(
            f"the policy was trained for other {what}: {', '.join(own[:4])} ..., not {', '.join(asked[:4])} ...; "
            "train one for this rig (maglev train)"
        )
