"""A library's loop over an objective, turned around: the objective waits in a thread until it is told the scores."""

from collections.abc import Callable
from queue import Queue
from threading import Thread

import numpy as np

from tuning.tuner import Trials

Objective = Callable[[np.ndarray], np.ndarray]  # points (n, k) to scores (n,), which are to be large


class _Ended(Exception):
    """Raised inside the library's loop when nobody asks any more."""


class Inverted:
    """A search that calls its objective, as a tuner."""

    def __init__(self, dimension: int, search: Callable[[Objective], object]) -> None:
        """Start the search, which is repeated when it ends; dimension is that of its points."""
        self._asked: Queue[np.ndarray | Exception] = Queue(1)
        self._told: Queue[np.ndarray | None] = Queue(1)
        self._waiting = np.empty((0, dimension))  # part of what the search wants at once that was not asked for yet
        self._scores: list[np.ndarray] = []
        self._size = 0
        Thread(target=self._run, args=(search,), daemon=True).start()

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

    def _objective(self, points: np.ndarray) -> np.ndarray:
        self._asked.put(np.atleast_2d(points).copy())
        scores = self._told.get()
        if scores is None:
            raise _Ended
        return scores

    def _run(self, search: Callable[[Objective], object]) -> None:
        try:
            while True:
                search(self._objective)
        except _Ended:
            return
        except Exception as error:  # passed on, because the caller of ask would otherwise wait for ever
            self._asked.put(error)
