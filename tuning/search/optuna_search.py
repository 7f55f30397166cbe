"""Optuna's searches as tuners: TPE, CMA-ES and a Gaussian process."""

import warnings
from importlib.util import find_spec
from typing import TYPE_CHECKING

import numpy as np

from tuning.tuner import Trials

if TYPE_CHECKING:
    from optuna.samplers import BaseSampler


class OptunaTuner:
    """One of Optuna's samplers on [-1, 1]^k. Points asked in one batch stay pending (constant liar) until told."""

    def __init__(
        self, dimension: int, seed: int, sampler: str, start: np.ndarray | None = None, startup: int | None = None
    ) -> None:
        """Create the sampler.

        Args:
            dimension: Number of gains.
            seed: Of the sampler.
            sampler: "tpe", "cma-es" or "gp".
            start: The point (k,) asked for first.
            startup: Points that tpe and gp draw at random before they learn; None: ten, as Optuna has it.
        """
        import optuna

        optuna.logging.set_verbosity(optuna.logging.ERROR)  # it warns about an optional package that only saves time
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", optuna.exceptions.ExperimentalWarning)
            self._study = optuna.create_study(direction="maximize", sampler=_sampler(sampler, seed, startup))
        self._space = {f"x{j}": optuna.distributions.FloatDistribution(-1.0, 1.0) for j in range(dimension)}
        if start is not None:
            self._study.enqueue_trial(dict(zip(self._space, map(float, start), strict=True)))
        self._open: list = []

    def ask(self, n: int) -> np.ndarray:
        self._open = [self._study.ask(self._space) for _ in range(n)]
        return np.array([[t.params[name] for name in self._space] for t in self._open])

    def tell(self, trials: Trials) -> None:
        for trial, score in zip(self._open, trials.score, strict=True):
            self._study.tell(trial, float(score))
        self._open = []


def _sampler(name: str, seed: int, startup: int | None) -> "BaseSampler":
    from optuna.samplers import CmaEsSampler, GPSampler, TPESampler

    first = {} if startup is None else {"n_startup_trials": startup}
    match name:
        case "tpe":
            return TPESampler(seed=seed, multivariate=True, constant_liar=True, **first)
        case "cma-es":
            return CmaEsSampler(seed=seed)
        case "gp":
            # Optuna computes with torch, but only after ten experiments, and says only then that it is missing. Loading
            # it takes many seconds, so that here it is only looked for.
            if find_spec("torch") is None:
                raise ModuleNotFoundError("No module named 'torch'", name="torch")
            return GPSampler(seed=seed, deterministic_objective=False, **first)
    raise ValueError(f"sampler = {name!r}: Optuna's tpe, cma-es and gp are made here")
