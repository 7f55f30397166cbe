"""What no linear controller of one axis can better, of any order: margins by interpolation, and the noise current.

A loop is stable inside only if its sensitivity S is 0 at every unstable pole of the plant and 1 at every zero outside
the unit circle, those at infinity (samples of delay) included. The least supremum of a function with given values there
is that of Nevanlinna and Pick, exactly (Doyle, Francis and Tannenbaum 1992, Feedback control theory, ch. 9 and 11).
Each limit is that of its quantity alone: a loop that reaches one of them is far from the others.
"""

from collections.abc import Mapping

import numpy as np
import scipy

from maglev_env.design.lqg import feedback, riccati
from maglev_env.linear.open_loop import OpenLoop, balanced

OUTSIDE = 1 + 1e-9  # radius from which on a pole or zero limits what is possible
NONE = 1e-12  # of the largest response to an impulse: a response that counts as none, before the delay is over
FREE = 1e-9  # weight of the command beside the current's square, without which the equation has no solution


def least_peak(plant: OpenLoop, at_poles: float, at_zeros: float) -> float:
    """The least supremum over all frequencies of a stable function with these values at the plant's poles and zeros.

    Args:
        plant: Of one axis.
        at_poles: Value at the poles outside the unit circle: 0 of the sensitivity.
        at_zeros: Value at the zeros outside, and with all derivatives that their order asks for at infinity: 1.

    Returns:
        The supremum; nothing smaller than the largest of both values where there is something to hold.
    """
    poles = np.linalg.eigvals(plant.a)
    held = 1 / poles[np.abs(poles) > OUTSIDE]
    points = np.concatenate([held, 1 / zeros_outside(plant), np.zeros(samples_of_delay(plant))])
    # The least supremum is the norm of the function of the shift, compressed to what the points span (Sarason 1967). In
    # the basis of a chain of all-pass sections that is a triangular matrix, whatever points coincide.
    shift, width = np.diag(points).astype(complex), np.sqrt(1 - np.abs(points) ** 2)
    for i in range(len(points)):
        passed = 1.0
        for j in range(i - 1, -1, -1):
            shift[i, j] = width[i] * passed * width[j]
            passed *= -points[j].conj()
    m = len(held)
    function = np.diag([at_poles] * m + [at_zeros] * (len(points) - m)).astype(complex)
    if m:
        across = (at_zeros - at_poles) * shift[m:, :m]
        function[m:, :m] = scipy.linalg.solve_sylvester(shift[m:, m:], -shift[:m, :m], across)
    return float(np.linalg.norm(function, 2))


def linear_limits(plant: OpenLoop, noise: float) -> Mapping[str, float]:
    """The best that any linear controller of the reading can have of single quantities, each alone, by name.

    Args:
        plant: Of one axis.
        noise: Rms of the reading's noise, m.

    Returns:
        peak_sensitivity, phase_margin (degrees), gain_margin (the smaller of the factors by which the gain may rise and
        fall), disk_margin and noise_current (A rms).
    """
    whole = least_peak(plant, 1.0, 0.0)  # of the complementary sensitivity
    return {
        "peak_sensitivity": least_peak(plant, 0.0, 1.0),
        "phase_margin": float(np.degrees(2 * np.arcsin(1 / whole))) if whole > 1 else 180.0,
        "gain_margin": (whole + 1) / (whole - 1) if whole > 1 else np.inf,
        "disk_margin": 1 / least_peak(plant, -0.5, 0.5),
        "noise_current": noise * least_current(plant),
    }


def zeros_outside(plant: OpenLoop) -> np.ndarray:
    """Finite zeros of the plant from command to reading outside the unit circle."""
    own, delay = balanced(plant), samples_of_delay(plant)
    # Those of the reading that comes when the delay is over, which adds zeros at 0 and leaves none at infinity.
    ahead = own.reading @ np.linalg.matrix_power(own.a, delay - 1)
    zeros = np.linalg.eigvals(own.a - own.command @ (ahead @ own.a) / float((ahead @ own.command)[0, 0]))
    return zeros[np.abs(zeros) > OUTSIDE]


def samples_of_delay(plant: OpenLoop) -> int:
    """Samples after which a command first shows in the reading."""
    shown, state = [], plant.command
    for _ in range(len(plant.a)):
        shown.append(abs(float((plant.reading @ state)[0, 0])))
        state = plant.a @ state
    return int(np.flatnonzero(np.array(shown) > NONE * max(shown))[0]) + 1


def least_current(plant: OpenLoop) -> float:
    """The least rms current per rms of the reading's white noise with which a linear controller holds the axis, A/m."""
    plant = balanced(plant)
    a, b, c = plant.a, plant.command, plant.reading
    n = len(a)
    # The coil follows a command without lag only where the weight of that is there already.
    weight = FREE + float(plant.jump[0, 0]) ** 2
    cross = plant.current.T * plant.jump
    try:
        cost = scipy.linalg.solve_discrete_are(
            a, b, plant.current.T @ plant.current, np.array([[weight]]), s=cross if plant.jump.any() else None
        )
    except (np.linalg.LinAlgError, ValueError) as error:
        raise ValueError(f"no stabilising solution of a Riccati equation: {error}") from None
    gain = (b.T @ cost @ a + cross.T) / (weight + b.T @ cost @ b)
    spread = riccati(a.T, c.T, np.zeros((n, n)), 1.0)
    update = feedback(a.T, c.T, spread, 1.0).T  # of the prediction
    newest = spread @ c.T / (1 + c @ spread @ c.T)
    # States: those of the plant and their prediction; the noise of the reading enters by the newest estimate.
    seen = np.eye(n) - newest @ c
    u = np.hstack([-gain @ newest @ c, -gain @ seen])
    from_noise = -gain @ newest
    whole = np.block([[a, np.zeros((n, n))], [update @ c, a - update @ c]])
    whole += np.vstack([b, b]) @ u
    entering = np.vstack([b @ from_noise, update + b @ from_noise])
    if np.abs(np.linalg.eigvals(whole)).max() >= 1:
        raise ValueError("a Riccati equation loses its digits")
    power = scipy.linalg.solve_discrete_lyapunov(whole, entering @ entering.T)
    shown = np.hstack([plant.current, np.zeros((1, n))]) + plant.jump @ u
    return float(np.sqrt((shown @ power @ shown.T)[0, 0] + ((plant.jump @ from_noise) ** 2)[0, 0]))
