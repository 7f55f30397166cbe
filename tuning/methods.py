"""The registry of tuners: each by its name, made for one rig. It loads a tuner when one is made."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from maglev_env.task.episodes import Episode
    from maglev_env.task.task import Task
    from tuning.learned.policy import HistoryPolicy
    from tuning.tuner import Tuner


@dataclass(frozen=True)
class Method:
    """A tuner as its name stands for it.

    Args:
        about: what it is, in a few words for a list of all.
        make: the tuner for a task, one of its episodes, a seed and a budget of experiments.
        safe_start: whether it asks for the episode's safe start first.
        longest: most experiments on a rig that a comparison gives it, where asking costs more the more it was told;
            None: any number. Such a tuner takes part in a comparison only when it is named.
        needs: packages that only an extra installs.
    """

    about: str
    make: "Callable[[Task, Episode, int, int], Tuner]"
    safe_start: bool = True
    longest: int | None = None
    needs: tuple[str, ...] = ()

    def check_installed(self) -> None:
        """Check that the packages are there, before any experiment; a tuner may load them only after some.

        Raises:
            ModuleNotFoundError: One is not installed.
        """
        for name in self.needs:
            if find_spec(name) is None:
                raise ModuleNotFoundError(f"No module named {name!r}", name=name)


def _grid(task: "Task", episode: "Episode", seed: int, budget: int) -> "Tuner":
    from tuning.search.space_filling import Grid

    return Grid(len(task.box.names), seed, budget)


def _sobol(task: "Task", episode: "Episode", seed: int, budget: int) -> "Tuner":
    from tuning.search.space_filling import Sobol

    return Sobol(len(task.box.names), seed)


def _evolution(task: "Task", episode: "Episode", seed: int, budget: int) -> "Tuner":
    from tuning.search.evolution import DifferentialEvolution

    return DifferentialEvolution(len(task.box.names), seed, start=episode.start)


def _optuna(sampler: str) -> "Callable[[Task, Episode, int, int], Tuner]":
    def make(task: "Task", episode: "Episode", seed: int, budget: int) -> "Tuner":
        from tuning.search.optuna_search import OptunaTuner

        return OptunaTuner(len(task.box.names), seed, sampler, episode.start)

    return make


def _rule(task: "Task", episode: "Episode", seed: int, budget: int) -> "Tuner":
    from tuning.search.rule import DissertationRule

    return DissertationRule(task, episode)


def _learned(task: "Task", episode: "Episode", seed: int, budget: int) -> "Tuner":
    from tuning.learned.tuner import LearnedTuner, shipped_policy

    return LearnedTuner(task, episode, shipped_policy(task), seed)


def _model(task: "Task", episode: "Episode", seed: int, budget: int) -> "Tuner":
    from tuning.search.model_based import ModelBased

    return ModelBased(task, episode, seed)


LEARNED = "learned"
METHODS: Mapping[str, Method] = {
    "grid": Method("points on a grid", _grid, safe_start=False),
    "sobol": Method("points that fill the box evenly", _sobol, safe_start=False),
    "de": Method("differential evolution", _evolution),
    "cma-es": Method("Optuna's evolution with an adapted covariance", _optuna("cma-es"), needs=("optuna", "cmaes")),
    "tpe": Method("Optuna's tree of Parzen estimators", _optuna("tpe"), needs=("optuna",)),
    "gp": Method("Optuna's Gaussian process", _optuna("gp"), longest=30, needs=("torch", "optuna")),
    "rule": Method("the dissertation's rule", _rule),
    LEARNED: Method("a policy learned on simulated rigs", _learned),
    "model": Method("fits the rig's parameters, then searches on them", _model),
}


def make_tuner(
    method: str, task: "Task", episode: "Episode", seed: int, budget: int, policy: "HistoryPolicy | None" = None
) -> "Tuner":
    """The tuner of a name.

    Args:
        method: Name of the tuner.
        task: The task.
        episode: The rig.
        seed: Seed of the tuner.
        budget: Number of experiments.
        policy: Policy of the learned tuner; None for that of this package.

    Raises:
        ValueError: The name is unknown (the message lists the names), or a policy does not fit.
        ModuleNotFoundError: A package that the tuner needs is not installed.
    """
    if method not in METHODS:
        raise ValueError(f"method {method!r} is unknown; use one of {', '.join(METHODS)}")
    METHODS[method].check_installed()
    if policy is None:
        return METHODS[method].make(task, episode, seed, budget)
    if method != LEARNED:
        raise ValueError(f"method {method} takes no policy; leave it out, or use {LEARNED}")
    from tuning.learned.tuner import LearnedTuner

    return LearnedTuner(task, episode, policy, seed)


def policy_of(path: Path | None) -> "HistoryPolicy | None":
    """The policy of a checkpoint, None without one. Errors as in `load_policy`."""
    if path is None:
        return None
    from tuning.learned.policy import load_policy

    return load_policy(path)[0]


def policy_digest(task: "Task", policy: "HistoryPolicy | None") -> str:
    """Hash of the weights of the learned tuner's policy; None stands for that of this package."""
    from tuning.learned.tuner import shipped_policy

    return (policy or shipped_policy(task)).digest
