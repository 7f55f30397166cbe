"""Every tuner by its name, made for one rig."""

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING

from maglev_env.task.episodes import Episode
from maglev_env.task.task import Task
from tuning.search.evolution import DifferentialEvolution
from tuning.search.model_based import ModelBased
from tuning.search.optuna_search import OptunaTuner
from tuning.search.rule import DissertationRule
from tuning.search.space_filling import Grid, Sobol
from tuning.tuner import Tuner

if TYPE_CHECKING:
    from tuning.learned.policy import HistoryPolicy

LEARNED = "learned"
# From the task, its episode, a seed and the budget; all but grid and sobol begin at the episode's safe start.
METHODS: Mapping[str, Callable[[Task, Episode, int, int], Tuner]] = {
    "grid": lambda task, episode, seed, budget: Grid(len(task.box.names), seed, budget),
    "sobol": lambda task, episode, seed, budget: Sobol(len(task.box.names), seed),
    "de": lambda task, episode, seed, budget: DifferentialEvolution(len(task.box.names), seed, start=episode.start),
    "cma-es": lambda task, episode, seed, budget: OptunaTuner(len(task.box.names), seed, "cma-es", episode.start),
    "tpe": lambda task, episode, seed, budget: OptunaTuner(len(task.box.names), seed, "tpe", episode.start),
    "gp": lambda task, episode, seed, budget: OptunaTuner(len(task.box.names), seed, "gp", episode.start),
    "rule": lambda task, episode, seed, budget: DissertationRule(task, episode),
    LEARNED: lambda task, episode, seed, budget: _learned(task, episode, seed, None),
    "model": lambda task, episode, seed, budget: ModelBased(task, episode, seed),
}

# What asking costs grows with what was told: a comparison runs these no longer than so many experiments.
LONGEST: Mapping[str, int] = {"gp": 30}


def make_tuner(
    method: str, task: Task, episode: Episode, seed: int, budget: int, policy: "HistoryPolicy | None" = None
) -> Tuner:
    """The tuner of that name; policy: of the learned one, None for that of this package. ValueError lists the names, or
    says why a policy does not serve."""
    if method not in METHODS:
        raise ValueError(f"method {method!r} is unknown; use one of {', '.join(METHODS)}")
    if policy is None:
        return METHODS[method](task, episode, seed, budget)
    if method != LEARNED:
        raise ValueError(f"method {method} takes no policy; leave it out, or use {LEARNED}")
    return _learned(task, episode, seed, policy)


def policy_of(path: Path | None) -> "HistoryPolicy | None":
    """The policy of a checkpoint, None without one. Errors: see `load_policy`."""
    if path is None:
        return None
    from tuning.learned.policy import load_policy

    return load_policy(path)[0]


def policy_digest(task: Task, policy: "HistoryPolicy | None") -> str:
    """What tells the learned tuner's policy from others: of its weights; None stands for that of this package."""
    from tuning.learned.tuner import shipped_policy

    return (policy or shipped_policy(task)).digest


def _learned(task: Task, episode: Episode, seed: int, policy: "HistoryPolicy | None") -> Tuner:
    from tuning.learned.tuner import LearnedTuner, shipped_policy

    return LearnedTuner(task, episode, policy or shipped_policy(task), seed)
