"""The contract of every tuner: a library's search, a rule or a learned policy."""

from collections.abc import Mapping
from dataclasses import dataclass, fields
from typing import Any, Protocol

import numpy as np


@dataclass(frozen=True, eq=False)
class Trials:
    """Results of n experiments.

    Attributes:
        points: Points of the box [-1, 1]^k, (n, k).
        score: (n,) in 0 to 1; 0 where the loop is unstable.
        observation: Identified values as the environments encode them, (n, size).
        info: The same in SI, (n,).
        touchdown: Whether the rotor touched down, (n,).
    """

    points: np.ndarray
    score: np.ndarray
    observation: np.ndarray
    info: tuple[Mapping[str, Any], ...]
    touchdown: np.ndarray

    def __len__(self) -> int:
        return len(self.points)

    def __add__(self, other: "Trials") -> "Trials":
        """The trials of both, these first."""
        mine, theirs = ([getattr(t, f.name) for f in fields(Trials)] for t in (self, other))
        joined = [a + b if isinstance(a, tuple) else np.concatenate([a, b]) for a, b in zip(mine, theirs, strict=True)]
        return Trials(*joined)

    @property
    def best(self) -> int:
        """Index of the highest score, the first of equal ones."""
        return int(np.argmax(self.score))


class Tuner(Protocol):
    """Asks for experiments and is told their results, in any number at a time; all its randomness comes from its seed.

    A tuner is told everything that it asked for, in the same order, before it asks again.
    """

    def ask(self, n: int) -> np.ndarray:
        """Points (m, k) of the box to try next, with 1 <= m <= n."""

    def tell(self, trials: Trials) -> None:
        """Receive the results of the points asked for last."""


def close(tuner: Tuner | None) -> None:
    """End a search, if it holds anything that must be ended: a thread, or a library's loop."""
    if hasattr(tuner, "close"):
        tuner.close()
