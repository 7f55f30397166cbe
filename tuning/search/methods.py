"""Every tuner by its name, made for one rig."""

from collections.abc import Callable, Mapping

from maglev_env.envs.episodes import Episode
from maglev_env.envs.task import Task
from tuning.search.evolution import DifferentialEvolution
from tuning.search.model_based import ModelBased
from tuning.search.optuna_search import OptunaTuner
from tuning.search.rule import DissertationRule
from tuning.search.space_filling import Grid, Sobol
from tuning.search.tuner import Tuner

# From the task, its episode, a seed and the budget; all but grid and sobol begin at the episode's safe start.
METHODS: Mapping[str, Callable[[Task, Episode, int, int], Tuner]] = {
    "grid": lambda task, episode, seed, budget: Grid(len(task.box.names), seed, budget),
    "sobol": lambda task, episode, seed, budget: Sobol(len(task.box.names), seed),
    "de": lambda task, episode, seed, budget: DifferentialEvolution(len(task.box.names), seed, start=episode.start),
    "cma-es": lambda task, episode, seed, budget: OptunaTuner(len(task.box.names), seed, "cma-es", episode.start),
    "tpe": lambda task, episode, seed, budget: OptunaTuner(len(task.box.names), seed, "tpe", episode.start),
    "gp": lambda task, episode, seed, budget: OptunaTuner(len(task.box.names), seed, "gp", episode.start),
    "rule": lambda task, episode, seed, budget: DissertationRule(task, episode),
    "model": lambda task, episode, seed, budget: ModelBased(task, episode, seed),
}


def make_tuner(method: str, task: Task, episode: Episode, seed: int, budget: int) -> Tuner:
    """The tuner of that name; ValueError lists the names."""
    if method not in METHODS:
        raise ValueError(f"method {method!r} is unknown; use one of {', '.join(METHODS)}")
    return METHODS[method](task, episode, seed, budget)
