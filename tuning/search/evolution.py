"""scipy's differential evolution with reversed control: its vectorised objective waits until it is told the scores."""

from queue import Queue
from threading import Thread

import numpy as np
import scipy

from tuning.tuner import Trials

POPULATION = 15  # times the number of gains, scipy's default


class _Ended(Exception):
    """Raised inside scipy's loop when nobody asks any more."""


class DifferentialEvolution:
    """Storn and Price (1997), best1bin with dithered mutation, one population at a time.

    After convergence it starts again from another population.
    """

    def __init__(
        self, dimension: int, seed: int, population: int = POPULATION, start: np.ndarray | None = None
    ) -> None:
        """Start the search; the first population contains the point start (k,), if given."""
        self._asked: Queue[np.ndarray | Exception] = Queue(1)
        self._told: Queue[np.ndarray | None] = Queue(1)
        self._waiting = np.empty((0, dimension))  # part of the population that was not asked for yet
        self._scores: list[np.ndarray] = []
        self._size = 0
        arguments = ([(-1.0, 1.0)] * dimension, np.random.default_rng(seed), population, start)
        Thread(target=self._run, args=arguments, daemon=True).start()

    def ask(self, n: int) -> np.ndarray:
        if not len(self._waiting):
            found = self._asked.get()
            if isinstance(found, Exception):
                raise found
            self._waiting = found
            self._size, self._scores = len(self._waiting), []
        points, self._waiting = self._waiting[:n], self._waiting[n:]
        return points

    def tell(self, trials: Trials) -> None:
        self._scores.append(trials.score)
        if sum(map(len, self._scores)) == self._size:
            self._told.put(np.concatenate(self._scores))

    def close(self) -> None:
        """End the search."""
        self._told.put(None)

    def _run(
        self, bounds: list[tuple[float, float]], rng: np.random.Generator, population: int, start: np.ndarray | None
    ) -> None:
        def objective(x: np.ndarray) -> np.ndarray:
            self._asked.put(np.atleast_2d(x.T).copy())
            scores = self._told.get()
            if scores is None:
                raise _Ended
            return -scores

        try:
            while True:
                scipy.optimize.differential_evolution(
                    objective, bounds, popsize=population, rng=rng, vectorized=True, updating="deferred", polish=False,
                    maxiter=10_000, x0=start,
                )  # fmt: skip
        except _Ended:
            return
        except Exception as error:  # passed on, because the caller of ask would otherwise wait for ever
            self._asked.put(error)
