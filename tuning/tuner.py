"""The contract of every tuner, whether a library's search, a rule or a learned policy."""

from collections.abc import Mapping
from dataclasses import dataclass, fields
from typing import Any, Protocol

import numpy as np


@dataclass(frozen=True, eq=False)
class Trials:
    """n experiments: points (n, k) of the box [-1, 1]^k; score (n,) in [0, 1], 0 where the loop is unstable;
    observation (n, size), as the environments encode what was identified; info (n,): the same in SI; touchdown (n,)
    whether the rotor touched down."""

    points: np.ndarray
    score: np.ndarray
    observation: np.ndarray
    info: tuple[Mapping[str, Any], ...]
    touchdown: np.ndarray

    def __len__(self) -> int:
        return len(self.points)

    def __add__(self, other: "Trials") -> "Trials":
        """Both, these first."""
        mine, theirs = ([getattr(t, f.name) for f in fields(Trials)] for t in (self, other))
        joined = [a + b if isinstance(a, tuple) else np.concatenate([a, b]) for a, b in zip(mine, theirs, strict=True)]
        return Trials(*joined)

    @property
    def best(self) -> int:
        """Index of the highest score; of equal ones the first."""
        return int(np.argmax(self.score))


class Tuner(Protocol):
    """Asks for experiments and is told what they found, in any number at a time; all it draws comes from its seed.

    A tuner is told everything it asked for, in the order asked, before it asks again.
    """

    def ask(self, n: int) -> np.ndarray:
        """Points (m, k) of the box to try next, at most n, at least one."""

    def tell(self, trials: Trials) -> None:
        """What the points asked for last have found."""
