"""Where a general search starts: within a small region around a point, and at the rule's third step."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from tuning.tuner import Trials, Tuner, close

STEPS = 2  # of the rule, before the point at which a search starts


class Around:
    """A search of [-1, 1]^k that is confined to a cube around a point of the box, and begins at that point."""

    def __init__(self, centre: np.ndarray, half: float, make: Callable[[np.ndarray], Tuner]) -> None:
        """Set up.

        Args:
            centre: The point (k,).
            half: Half the edge of the cube, of the box's half width; the box cuts it.
            make: The search that begins at a point (k,) of its own box.
        """
        self._low, self._high = np.maximum(centre - half, -1.0), np.minimum(centre + half, 1.0)
        self._tuner = make(self._inside(centre))

    def ask(self, n: int) -> np.ndarray:
        return self._low + (self._high - self._low) * (self._tuner.ask(n) + 1) / 2

    def tell(self, trials: Trials) -> None:
        self._tuner.tell(replace(trials, points=self._inside(trials.points)))

    def close(self) -> None:
        """End the search."""
        close(self._tuner)

    def _inside(self, points: np.ndarray) -> np.ndarray:
        return 2 * (points - self._low) / (self._high - self._low) - 1


class AfterRule:
    """STEPS experiments by a rule, then a search from the gains that the rule would try next."""

    def __init__(self, rule: Tuner, make: Callable[[np.ndarray], Tuner]) -> None:
        self._rule, self._make, self._tuner, self._count = rule, make, None, 0

    def ask(self, n: int) -> np.ndarray:
        if self._count < STEPS:
            return self._rule.ask(1)
        if self._tuner is None:
            self._tuner = self._make(self._rule.ask(1)[0])
        return self._tuner.ask(n)

    def tell(self, trials: Trials) -> None:
        if self._tuner is None:
            self._rule.tell(trials)
            self._count += len(trials)
        else:
            self._tuner.tell(trials)

    def close(self) -> None:
        """End the search."""
        close(self._tuner)
