"""A fit of a hypothesis: its coordinates and cost, and how surely they are told."""

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from sim2real.search.hypotheses import Hypothesis

EDGE = 1e-6  # distance, in coordinates, within which a bound counts as reached
# Cost of a further parameter of an effect: what noise lets it save of further records, and the judge's.
PARAMETER = 6.0
LEFT_SD = 3.0  # standard deviations of the noise's power up to which a cost leaves noise alone
NOT_TOLD = 1e6  # coordinates: standard error of one that nothing tells
# Share of the largest eigenvalue below which a combination of coordinates is not told, and least share of such a
# combination that one of them must have not to be told either.
SINGULAR, SHARED = 1e-14, 1e-6


@dataclass(eq=False)
class Fit:
    """A hypothesis at coordinates u.

    The cost is sum |r|^2 plus the sum of the squared changes in units of their tolerances: -2 ln of the likelihood
    except for a constant. A complex residual counts twice; |r|^2 is scaled to variance 1 per real part.

    Attributes:
        hypothesis: The hypothesis.
        u: Coordinates (size,).
        residual: Whitened complex residual (K,).
        cost: Cost at u.
        jacobian: Derivative (size, K) of the prediction; None while unknown.
        damping: Levenberg-Marquardt parameter.
        age: Steps since the tolerances' rows were computed.
        refused: Consecutive iterations without a lower trial step, as where all of them touch down.
        fresh: Whether all rows were computed at u.
        idle: Whether the last iteration gained too little.
        bent: Whether it gained much less than the linear prediction.
        done: Whether the fit has ended.
    """

    hypothesis: Hypothesis
    u: np.ndarray
    residual: np.ndarray
    cost: float
    jacobian: np.ndarray | None = None
    damping: float = 1e-3
    age: int = 0
    refused: int = 0
    fresh: bool = False
    idle: bool = False
    bent: bool = False
    done: bool = False

    @property
    def prior(self) -> np.ndarray:
        return self.hypothesis.prior

    @property
    def normal(self) -> np.ndarray:
        """Hessian of half the cost, (size, size)."""
        return real_product(self.jacobian, self.jacobian) + np.diag(self.prior)

    @property
    def gradient(self) -> np.ndarray:
        """Negative gradient of half the cost, (size,)."""
        return real_product(self.jacobian, self.residual) - self.prior * self.u

    @property
    def occam(self) -> float:
        """Cost of the freedom of forms: by how much the data narrow the priors of their coordinates (Laplace's method).

        It is minus twice the logarithm of the ratio of volumes. Coordinates at a bound cost nothing.
        """
        h = self.hypothesis
        if not h.shapes or self.jacobian is None:
            return 0.0
        at = [len(h.coordinates) + h.calibrated.index(name) for name in h.shapes]
        nudges = (h.bounded(self.u + EDGE), h.bounded(self.u - EDGE))
        inside = [i for i in at if all(abs(v[i] - self.u[i]) > 0.5 * EDGE for v in nudges)]
        return -float(np.linalg.slogdet(self.covariance()[np.ix_(inside, inside)])[1]) if inside else 0.0

    @property
    def charged(self) -> np.ndarray:
        """Share of the cost of a parameter that each coordinate of an effect has, (coordinates,).

        The first one of an effect has all. With an end of its range for a constant instead of a further one, the effect
        explains less by the square of its distance in standard errors, to second order, and costs a parameter less: it
        is charged what is less.
        """
        own = self.hypothesis.coordinates
        found = np.ones(len(own))
        if self.jacobian is None:
            return found
        sd = self.spread
        for i, (before, c) in enumerate(pairwise(own), 1):
            if before.effect == c.effect:
                found[i] = min((c.to_end(float(self.u[i])) / sd[i]) ** 2 / PARAMETER, 1.0) if sd[i] else 1.0
        return found

    def covariance(self) -> np.ndarray:
        """Covariance of the coordinates, (size, size)."""
        return inverse(self.normal)

    @property
    def excess(self) -> float:
        """Cost beyond the noise."""
        return self.cost - 2.0 * self.residual.size

    @property
    def spread(self) -> np.ndarray:
        """Standard errors (size,) by the curvature.

        NOT_TOLD where that is none, as where the rotor falls beside, and of coordinates of which only a combination is
        told.
        """
        scaled, _ = _scaled(self.normal)
        values, vectors = np.linalg.eigh(scaled)
        lost = np.sum(vectors[:, values <= SINGULAR * values.max(initial=0.0)] ** 2, axis=1)
        told = (np.diag(self.normal) > 0) & (lost < SHARED)
        return np.where(told, np.sqrt(np.diag(self.covariance())), NOT_TOLD)


def inverse(normal: np.ndarray) -> np.ndarray:
    """Pseudo-inverse of a normal matrix (size, size), whose coordinates may be told to very different accuracies.

    One that is told a billion times better than another would count as all of the matrix, and the other as known.
    """
    scaled, size = _scaled(normal)
    return np.linalg.pinv(scaled, rcond=SINGULAR, hermitian=True) / np.outer(size, size)


def _scaled(normal: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """A normal matrix with ones on its diagonal, and what each coordinate was divided by."""
    size = np.sqrt(np.diag(normal))
    size = np.where(size > 0, size, 1.0)
    return normal / np.outer(size, size), size


def real_product(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Re(a b^H) of complex rows (..., K): as real numbers it takes a quarter of the time."""
    rows, columns = (np.ascontiguousarray(v, complex).view(float) for v in (a, b))
    return rows @ columns.T


def above_noise(cost: float, residuals: int) -> bool:
    """Whether a cost of so many complex residuals is clearly more than their noise alone makes it."""
    count = 2.0 * residuals
    return cost > count + LEFT_SD * float(np.sqrt(2 * count))


def cost_of(residual: np.ndarray, u: np.ndarray, prior: np.ndarray) -> float:
    return float(np.vdot(residual, residual).real + prior @ u**2)
