"""Whether a policy is in its depth: how far an observation lies from those that its training saw."""

from dataclasses import dataclass

import numpy as np

RIDGE = 0.02  # smallest standard deviation of an element of an observation, which lie in [-1, 1]
CORE = 0.95  # share of the observations by which the distances are measured: the farthest ones would stretch them
SHARE = 0.98  # of the observations of training that count as familiar
# The first gains of an episode are not the policy's, and some rigs hardly hold there: they tell little.
FROM = 1


@dataclass(frozen=True, eq=False)
class Familiar:
    """Mean (size,) and inverse covariance (size, size) of observations, and the largest familiar distance, ()."""

    mean: np.ndarray
    inverse: np.ndarray
    limit: np.ndarray

    def distance(self, observations: np.ndarray) -> np.ndarray:
        """Mahalanobis distances (n,) of observations (n, size)."""
        off = observations - self.mean
        return np.sqrt(np.einsum("ni,ij,nj->n", off, self.inverse, off))


def familiar(seen: np.ndarray) -> Familiar:
    """What the observations (episodes, experiments, size) of a training have in common, from the second on."""
    every = np.asarray(seen[:, FROM:], float).reshape(-1, seen.shape[2])
    found = _of(every)
    distance = found.distance(every)
    found = _of(every[distance <= np.quantile(distance, CORE)])
    return Familiar(found.mean, found.inverse, np.array(np.quantile(found.distance(every), SHARE)))


def _of(rows: np.ndarray) -> Familiar:
    covariance = np.cov(rows, rowvar=False) + RIDGE**2 * np.eye(rows.shape[1])
    return Familiar(rows.mean(axis=0), np.linalg.inv(covariance), np.zeros(()))
