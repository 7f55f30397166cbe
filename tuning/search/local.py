"""Local searches without derivatives: Nelder and Mead's simplex, and quadratic models in a trust region."""

import numpy as np
import scipy

from tuning.search.inverted import Inverted, Objective
from tuning.tuner import Trials

FINEST = 0.01  # of the box's half width: where a search has converged
SHORTER = 0.5  # of the first step: that of a simplex which begins again where the last one ended
LOOKED = 400  # points at which a quadratic model is compared
FAR = 2.0  # trust radii within which experiments shape the model
WIDER, NARROWER = 1.5, 0.6  # of a trust radius after a step that gained, and after one that did not
STIFF = 0.03  # ridge on the curvatures, of a model whose variables are in trust radii


class NelderMead(Inverted):
    """Nelder and Mead (1965), scipy's with adapted coefficients.

    After convergence it starts again from the best point, with shorter first steps in other directions.
    """

    def __init__(self, dimension: int, seed: int, start: np.ndarray, step: float) -> None:
        """Start the search at the point start (k,); step: edge of the first simplex, of the box's half width."""
        rng, bounds = np.random.default_rng(seed), [(-1.0, 1.0)] * dimension
        best, score, size = np.asarray(start, float), -np.inf, step

        def search(objective: Objective) -> None:
            nonlocal best, score, size

            def cost(x: np.ndarray) -> float:
                nonlocal best, score
                value = float(objective(x[None])[0])
                if value > score:
                    best, score = x.copy(), value
                return -value

            away = rng.choice([-size, size], dimension)
            away = np.where(np.abs(best + away) > 1, -away, away)
            options = {"initial_simplex": np.vstack([best, best + np.diag(away)]), "xatol": FINEST, "fatol": 1e-4}
            scipy.optimize.minimize(
                cost, best, method="Nelder-Mead", bounds=bounds, options={**options, "adaptive": True}
            )
            size = max(SHORTER * size, 2 * FINEST)

        super().__init__(dimension, search)


class Quadratic:
    """The best point of a quadratic model within a trust region, as in Powell's methods (NEWUOA, 2006).

    It first takes a step along each gain. Then the model of the least curvature that fits the experiments near the best
    one is followed to the edge of a region, which grows where that gains and shrinks where it does not.
    """

    def __init__(self, dimension: int, seed: int, start: np.ndarray, step: float) -> None:
        """Start at the point start (k,); step: first trust radius, of the box's half width."""
        self._rng, self._start, self._radius = np.random.default_rng(seed), np.asarray(start, float), step
        away = self._rng.choice([-step, step], dimension)
        away = np.where(np.abs(self._start + away) > 1, -away, away)
        self._first = list(np.clip(np.vstack([self._start, self._start + np.diag(away)]), -1.0, 1.0))
        self._told: Trials | None = None

    def ask(self, n: int) -> np.ndarray:
        if self._first:
            return np.array([self._first.pop(0) for _ in range(min(n, len(self._first)))])
        told = self._told
        best = told.points[told.best]
        offsets = (told.points - best) / self._radius
        near = np.flatnonzero(np.abs(offsets).max(axis=1) <= FAR)
        tried = self._rng.uniform(-1, 1, (LOOKED, best.size))
        tried = (np.clip(best + self._radius * tried, -1, 1) - best) / self._radius
        # Not where an experiment was made already.
        apart = np.abs(tried[:, None] - offsets[None]).max(axis=2).min(axis=1)
        terms, at = _quadratic(offsets[near]), _quadratic(tried)
        ridge = np.full(terms.shape[1], STIFF)
        ridge[: best.size + 1] = 1e-6
        model = np.linalg.solve(terms.T @ terms + np.diag(ridge), terms.T @ told.score[near])
        value = np.where(apart > 0.1, at @ model, -np.inf)
        chosen = tried[np.argsort(-value)[:n]]
        return np.clip(best + self._radius * chosen, -1.0, 1.0)

    def tell(self, trials: Trials) -> None:
        if self._told is not None and not self._first and len(self._told) > self._start.size:
            gained = trials.score.max() > self._told.score.max()
            self._radius = float(np.clip(self._radius * (WIDER if gained else NARROWER), FINEST, 1.0))
        self._told = trials if self._told is None else self._told + trials


def _quadratic(x: np.ndarray) -> np.ndarray:
    """1, linear and quadratic terms (n, 1 + k + k (k + 1) / 2) of points (n, k)."""
    i, j = np.triu_indices(x.shape[1])
    return np.concatenate([np.ones((len(x), 1)), x, x[:, i] * x[:, j]], axis=1)
