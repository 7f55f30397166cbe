"""The registry of tuners: each by its name, made for one rig. It loads a tuner when one is made."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import numpy as np

    from maglev_env.task.episodes import Episode
    from maglev_env.task.task import Task
    from tuning.learned.policy import HistoryPolicy
    from tuning.tuner import Tuner

    Search = Callable[[int, int, np.ndarray, float | None], Tuner]


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
        near: the same search for a number of gains, a seed, the first point and the size of its first steps, of the
            box's half width; None: it is no general search, and its start is its own (see `STARTS`).
    """

    about: str
    make: "Callable[[Task, Episode, int, int], Tuner]"
    safe_start: bool = True
    longest: int | None = None
    needs: tuple[str, ...] = ()
    near: "Search | None" = None

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


def _evolution(k: int, seed: int, start: "np.ndarray", step: float | None) -> "Tuner":
    from tuning.search.evolution import POPULATION, DifferentialEvolution

    if step is None:
        return DifferentialEvolution(k, seed, POPULATION, start)
    return _around(start, CUBE * step, lambda own: DifferentialEvolution(k, seed, FEW, own))


def _optuna(sampler: str) -> "Search":
    def make(k: int, seed: int, start: "np.ndarray", step: float | None) -> "Tuner":
        from tuning.search.optuna_search import OptunaTuner

        if step is None:
            return OptunaTuner(k, seed, sampler, start)
        return _around(start, CUBE * step, lambda own: OptunaTuner(k, seed, sampler, own, STARTUP))

    return make


def _simplex(k: int, seed: int, start: "np.ndarray", step: float | None) -> "Tuner":
    from tuning.search.local import NelderMead

    return NelderMead(k, seed, start, step or COLD)


def _quadratic(k: int, seed: int, start: "np.ndarray", step: float | None) -> "Tuner":
    from tuning.search.local import Quadratic

    return Quadratic(k, seed, start, step or COLD)


def _around(start: "np.ndarray", half: float, make: "Callable[[np.ndarray], Tuner]") -> "Tuner":
    from tuning.search.started import Around

    return Around(start, half, make)


def _general(about: str, search: "Search", longest: int | None = None, needs: tuple[str, ...] = ()) -> Method:
    """A search that knows nothing but the score; from the episode's start where nothing else is said."""

    def make(task: "Task", episode: "Episode", seed: int, budget: int) -> "Tuner":
        return search(len(task.box.names), seed, episode.start, None)

    return Method(about, make, longest=longest, needs=needs, near=search)


def _rule(task: "Task", episode: "Episode", seed: int, budget: int) -> "Tuner":
    from tuning.search.rule import DissertationRule

    return DissertationRule(task, episode)


def _learned(task: "Task", episode: "Episode", seed: int, budget: int) -> "Tuner":
    from tuning.learned.tuner import LearnedTuner, shipped_policy
    from tuning.search.corrected.tuner import ModelCorrected

    try:
        policy = shipped_policy(task)
    except ValueError as error:
        tuner = ModelCorrected(task, episode, seed)
        tuner.note = f"{error}; the model-corrected tuner works instead"
        return tuner
    return LearnedTuner(task, episode, policy, seed)


def _model(task: "Task", episode: "Episode", seed: int, budget: int) -> "Tuner":
    from tuning.search.corrected.tuner import ModelCorrected

    return ModelCorrected(task, episode, seed)


LEARNED = "learned"
COLD = 0.5  # of the box's half width: first steps of a local search that knows no good gains
STEP, CUBE = 0.15, 3.0  # the same, where a search starts at good gains; half the edge of its cube in such steps
STARTUP = 4  # gain sets that tpe and gp draw at random there before they learn
FEW = 5  # population per gain of an evolution near good gains
METHODS: Mapping[str, Method] = {
    "grid": Method("points on a grid", _grid, safe_start=False),
    "sobol": Method("points that fill the box evenly", _sobol, safe_start=False),
    "de": _general("differential evolution", _evolution),
    "cma-es": _general("Optuna's evolution with an adapted covariance", _optuna("cma-es"), needs=("optuna", "cmaes")),
    "tpe": _general("Optuna's tree of Parzen estimators", _optuna("tpe"), needs=("optuna",)),
    "gp": _general("Optuna's Gaussian process", _optuna("gp"), longest=30, needs=("torch", "optuna")),
    "nelder-mead": _general("scipy's simplex", _simplex),
    "quadratic": _general("quadratic models in a trust region", _quadratic),
    "rule": Method("the dissertation's rule", _rule),
    LEARNED: Method("a policy learned on simulated rigs", _learned),
    "model": Method("fits the rig, carries what it differs by, and searches on both", _model, safe_start=False),
}
DEFAULT = "model"
STARTS: Mapping[str, str] = {
    "preset": "starts at the rig's own gains, with small steps",
    "rule": "starts at the third step of the dissertation's rule, with small steps",
}


def split_name(name: str) -> tuple[str, str | None]:
    """Name in METHODS and in STARTS of a tuner's name, such as cma-es@preset; None: started as its method has it.

    Raises:
        ValueError: There is no such tuner; the message lists what there is.
    """
    method, sign, start = name.partition("@")
    if method not in METHODS:
        raise ValueError(f"method {name!r} is unknown; use one of {', '.join(METHODS)}")
    if not sign:
        return method, None
    if start not in STARTS or METHODS[method].near is None:
        general = ", ".join(n for n, m in METHODS.items() if m.near)
        raise ValueError(f"method {name!r}: a start, @{' or @'.join(STARTS)}, goes with {general}")
    return method, start


def method_of(name: str) -> Method:
    """The method of a tuner's name, wherever it starts. Errors as in `split_name`."""
    return METHODS[split_name(name)[0]]


def make_tuner(
    method: str, task: "Task", episode: "Episode", seed: int, budget: int, policy: "HistoryPolicy | None" = None
) -> "Tuner":
    """The tuner of a name.

    Args:
        method: Name of the tuner, with @ and one of STARTS after that of a general search.
        task: The task.
        episode: The rig.
        seed: Seed of the tuner.
        budget: Number of experiments.
        policy: Policy of the learned tuner; None for that of this package.

    Raises:
        ValueError: The name is unknown (the message lists the names), or a policy does not fit.
        ModuleNotFoundError: A package that the tuner needs is not installed.
    """
    name, start = split_name(method)
    own = METHODS[name]
    own.check_installed()
    if policy is None:
        if start is not None:
            return _heeding(_started(own, start, task, episode, seed), task, episode)
        made = own.make(task, episode, seed, budget)
        return _heeding(made, task, episode) if own.near else made
    if name != LEARNED:
        raise ValueError(f"method {method} takes no policy; leave it out, or use {LEARNED}")
    from tuning.learned.tuner import LearnedTuner

    return LearnedTuner(task, episode, policy, seed)


def _heeding(search: "Tuner", task: "Task", episode: "Episode") -> "Tuner":
    """A general search that knows what a recommendation refuses, under a goal of requirements on one or two axes."""
    from maglev_env.task.task import Task

    if not isinstance(task, Task) or task.layout.goal is None:
        return search
    from tuning.search.heeding import Heeding

    return Heeding(search, task, episode)


def _started(method: Method, start: str, task: "Task", episode: "Episode", seed: int) -> "Tuner":
    """A general search from one of STARTS."""
    from maglev_env.loop.gains import of_axis

    preset = task.box.point(of_axis(task.rig.gains, 0))

    def search(point: "np.ndarray") -> "Tuner":
        return method.near(len(task.box.names), seed, point, STEP)

    if start == "preset":
        return search(preset)
    from tuning.search.rule import DissertationRule
    from tuning.search.started import AfterRule

    return AfterRule(DissertationRule(task, replace(episode, start=preset)), search)


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


def digest_or_none(task: "Task", policy: "HistoryPolicy | None") -> str | None:
    """The same; None where no policy of this package fits and another tuner works instead."""
    try:
        return policy_digest(task, policy)
    except ValueError:
        return None
