"""Points spread over the box whatever is found there: Sobol's and a grid."""

import warnings

import numpy as np
from scipy.stats import qmc

from tuning.tuner import Trials


class Sobol:
    """Scrambled Sobol points of [-1, 1]^k (Owen 1998), without end."""

    def __init__(self, dimension: int, seed: int) -> None:
        self._engine = qmc.Sobol(dimension, rng=np.random.default_rng(seed))

    def ask(self, n: int) -> np.ndarray:
        with warnings.catch_warnings():  # balance is lost when a power of two is cut short, not the spread
            warnings.simplefilter("ignore", UserWarning)
            return 2 * self._engine.random(n) - 1

    def tell(self, trials: Trials) -> None:
        """Nothing is learned."""


class Grid:
    """The largest full grid of [-1, 1]^k within a budget, in an order drawn from seed; then from its start again."""

    def __init__(self, dimension: int, seed: int, budget: int) -> None:
        per_axis = max(int(budget ** (1 / dimension) + 1e-9), 1)
        axis = np.linspace(-1, 1, per_axis) if per_axis > 1 else np.zeros(1)
        points = np.stack(np.meshgrid(*[axis] * dimension, indexing="ij"), axis=-1).reshape(-1, dimension)
        self._points, self._done = np.random.default_rng(seed).permutation(points), 0

    def ask(self, n: int) -> np.ndarray:
        at = (self._done + np.arange(n)) % len(self._points)
        self._done += n
        return self._points[at]

    def tell(self, trials: Trials) -> None:
        """Nothing is learned."""
