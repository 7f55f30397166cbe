"""Searches of Optuna behind the tuners' contract: TPE, CMA-ES and a Gaussian process."""

import warnings
from collections.abc import Callable

import numpy as np

from tuning.tuner import Trials

SAMPLERS = ("tpe", "cma-es", "gp")


class OptunaTuner:
    """One of Optuna's samplers on [-1, 1]^k; what is asked for together counts as lying there while it is not told."""

    def __init__(self, dimension: int, seed: int, sampler: str, start: np.ndarray | None = None) -> None:
        """start: the point (k,) asked for first."""
        import optuna

        optuna.logging.set_verbosity(optuna.logging.ERROR)  # it warns of an optional package that only saves time
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", optuna.exceptions.ExperimentalWarning)
            self._study = optuna.create_study(direction="maximize", sampler=_samplers()[sampler](seed))
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


def _samplers() -> dict[str, Callable]:
    from optuna.samplers import CmaEsSampler, GPSampler, TPESampler

    return {
        "tpe": lambda seed: TPESampler(seed=seed, multivariate=True, constant_liar=True),
        "cma-es": lambda seed: CmaEsSampler(seed=seed),
        "gp": lambda seed: GPSampler(seed=seed, deterministic_objective=False),
    }
