"""Linear-quadratic-Gaussian control of one axis: a Kalman filter of its plant, and a regulator of what that tells."""

from dataclasses import dataclass, replace

import numpy as np
import scipy

from maglev_env.linear.open_loop import OpenLoop, balanced


@dataclass(frozen=True)
class LqgWeights:
    """What an LQG controller weighs; only ratios matter, so the reading's noise and the weight of motion are 1.

    Args:
        force: Rms of a white force over that of the reading's noise, N/m.
        command: Weight of the squared command over that of the squared motion, (m/A)^2.
        drift: Rms of a force that drifts over that of the white one; it makes the controller stiff at rest.
        corner: Frequency below which that force drifts, Hz.
    """

    force: float
    command: float
    drift: float
    corner: float


def lqg(plant: OpenLoop, weights: LqgWeights) -> tuple[np.ndarray, np.ndarray, np.ndarray, float]:
    """The controller that makes motion^2 + command weight command^2 least on average, of one axis.

    It uses the newest reading, as every controller of a rig does: the filter's estimate is that after the measurement.

    Args:
        plant: Of one axis.
        weights: The weights.

    Returns:
        A (n, n), B (n,), C (n,) and D from the negative reading (m) to the command (A).

    Raises:
        ValueError: The Riccati equations have no stabilising solution that rounding leaves.
    """
    unit = weights.command**0.5  # of the reading, m for each A, in which both weights are 1
    a, b, c = drifting(plant, weights)
    own = balanced(replace(plant, a=a, command=b, force=_entering(plant, weights), reading=c / unit, current=0 * c))
    a, b, c, noise = own.a, own.command, own.reading, (unit * weights.force) ** 2 * own.force @ own.force.T
    spread = riccati(a.T, c.T, noise, 1.0)
    gain = feedback(a, b, riccati(a, b, c.T @ c, 1.0), 1.0)  # (1, n)
    update = spread @ c.T / (c @ spread @ c.T + 1.0) / unit  # (n, 1)
    advance, seen = a - b @ gain, np.eye(len(a)) - update @ c * unit
    return advance @ seen, -(advance @ update)[:, 0], -(gain @ seen)[0], float((gain @ update)[0, 0])


def _entering(plant: OpenLoop, weights: LqgWeights) -> np.ndarray:
    """How a white force and what drives the drifting one enter the states of `drifting`, (n + 1, 2)."""
    keeps = np.exp(-2 * np.pi * weights.corner * plant.dt)
    white, drift = np.vstack([plant.force, [[0.0]]]), np.zeros((len(plant.a) + 1, 1))
    drift[-1] = weights.drift * np.sqrt(1 - keeps**2)
    return np.hstack([white, drift])


def drifting(plant: OpenLoop, weights: LqgWeights) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """A (n + 1, n + 1), B (n + 1, 1) and C (1, n + 1) of a plant with a force that drifts as its last state."""
    n = len(plant.a)
    a = np.zeros((n + 1, n + 1))
    a[:n, :n], a[:n, n:] = plant.a, plant.force
    a[n, n] = np.exp(-2 * np.pi * weights.corner * plant.dt)
    return a, np.vstack([plant.command, [[0.0]]]), np.hstack([plant.reading, [[0.0]]])


def riccati(a: np.ndarray, b: np.ndarray, q: np.ndarray, r: float) -> np.ndarray:
    """The stabilising solution X (n, n) of X = a' X a - a' X b (r + b' X b)^-1 b' X a + q with one input b (n, 1).

    Raises:
        ValueError: There is none that rounding leaves.
    """
    try:
        return scipy.linalg.solve_discrete_are(a, b, q, np.array([[r]]))
    except (np.linalg.LinAlgError, ValueError) as error:
        raise ValueError(f"no stabilising solution of a Riccati equation: {error}") from None


def feedback(a: np.ndarray, b: np.ndarray, x: np.ndarray, r: float) -> np.ndarray:
    """The gain (1, n) of the input that a solution of `riccati` stands for."""
    return b.T @ x @ a / (r + b.T @ x @ b)
