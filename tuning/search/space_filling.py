"""Points that fill the box regardless of the results: Sobol points and a grid."""

import warnings

import numpy as np
import scipy

from tuning.tuner import Trials


class Sobol:
    """Scrambled Sobol points of [-1, 1]^k (Owen 1998), without end."""

    def __init__(self, dimension: int, seed: int) -> None:
        self._engine = scipy.stats.qmc.Sobol(dimension, rng=np.random.default_rng(seed))

    def ask(self, n: int) -> np.ndarray:
        with warnings.catch_warnings():  # cutting a power of two short loses balance, not the spread of the points
            warnings.simplefilter("ignore", UserWarning)
            return 2 * self._engine.random(n) - 1

    def tell(self, trials: Trials) -> None:
        """Nothing: the points do not depend on results."""


class Grid:
    """The largest full grid of [-1, 1]^k within a budget, in random order; then from its beginning again."""

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
        """Nothing: the points do not depend on results."""
