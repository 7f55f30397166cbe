"""A change of a fit's prediction with all else following it, to first order.

What a fit leaves may be changed by an effect that it lacks, a form or a drift. Its own parameters then find another
optimum. To first order this is the least-squares step under the changed residual, which needs no further simulation.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from sim2real.search.fit import Fit, inverse, real_product


@dataclass(frozen=True)
class Following:
    """The coordinates that follow, and the residual from which on they do.

    Attributes:
        jacobian: Derivative (size, K) of the prediction.
        prior: Prior precision (size,).
        u: The coordinates (size,).
        residual: What is left there (K,).
    """

    jacobian: np.ndarray
    prior: np.ndarray
    u: np.ndarray
    residual: np.ndarray

    @cached_property
    def solve(self) -> np.ndarray:
        """Inverse (size, size) of the Hessian of half the cost."""
        return inverse(real_product(self.jacobian, self.jacobian) + np.diag(self.prior))

    @cached_property
    def gradient(self) -> np.ndarray:
        """Negative gradient (size,) of half the cost at the residual."""
        return real_product(self.jacobian, self.residual) - self.prior * self.u

    @cached_property
    def promised(self) -> float:
        """What following saves of the cost without any change."""
        return float(self.gradient @ self.solve @ self.gradient)

    def crossed(self, changes: np.ndarray) -> np.ndarray:
        """What changes (..., K) of the prediction take off the gradient, (..., size)."""
        return real_product(changes, self.jacobian)

    def along(self, changes: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Products of changes (n, K) of the prediction among one another (n, n) and with the residual (n,), of what
        nothing that follows can make up for.

        Shares s of the changes then save 2 s along - s own s of the cost, beside what is promised without them.
        """
        cross = self.crossed(changes)
        own = real_product(changes, changes) - cross @ self.solve @ cross.T
        return own, real_product(changes, self.residual[None])[:, 0] - cross @ self.solve @ self.gradient

    def step(self, change: np.ndarray | None = None) -> np.ndarray:
        """How the coordinates follow a change (K,) of the prediction, (size,)."""
        gradient = self.gradient if change is None else self.gradient - self.crossed(change[None])[0]
        return self.solve @ gradient

    def cost(self, change: np.ndarray) -> float:
        """The cost with a change (K,) of the prediction when they have followed."""
        left = self.residual - change
        gradient = self.gradient - self.crossed(change[None])[0]
        followed = gradient @ self.solve @ gradient
        return float(np.vdot(left, left).real + self.prior @ self.u**2 - followed)


def following(
    fit: Fit, coordinates: np.ndarray | Sequence[int] | slice = slice(None), at: slice = slice(None)
) -> Following:
    """What of a fit whose Jacobian is known follows.

    Args:
        fit: The fit.
        coordinates: Those that follow; all by default.
        at: Which of the residuals count; all by default.
    """
    rows = np.ascontiguousarray(fit.jacobian[coordinates][:, at])
    return Following(rows, fit.prior[coordinates], fit.u[coordinates], fit.residual[at])
