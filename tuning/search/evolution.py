"""scipy's differential evolution."""

import numpy as np
import scipy

from tuning.search.inverted import Inverted, Objective

POPULATION = 15  # times the number of gains, scipy's default


class DifferentialEvolution(Inverted):
    """Storn and Price (1997), best1bin with dithered mutation, one population at a time.

    After convergence it starts again from another population.
    """

    def __init__(
        self, dimension: int, seed: int, population: int = POPULATION, start: np.ndarray | None = None
    ) -> None:
        """Start the search; the first population contains the point start (k,), if given."""
        rng = np.random.default_rng(seed)

        def search(objective: Objective) -> None:
            scipy.optimize.differential_evolution(
                lambda x: -objective(x.T), [(-1.0, 1.0)] * dimension, popsize=population, rng=rng, vectorized=True,
                updating="deferred", polish=False, maxiter=10_000, x0=start,
            )  # fmt: skip

        super().__init__(dimension, search)
