"""What all estimators of normal errors share."""

import numpy as np

NORMAL_95 = 1.959964  # standard errors on either side of a normal estimate that hold 95 %
NOISELESS = 1e-18  # relative power: a record without noise is weighted as if it had a relative noise of 1e-9


def variance_of_difference(
    of_a: np.ndarray, of_b: np.ndarray, of_both: np.ndarray, factor: np.ndarray | complex
) -> np.ndarray:
    """Variance E|n|^2 of a - factor b, where a and b are complex amplitudes with noise.

    Args:
        of_a, of_b: Variances of both (...).
        of_both: Their covariance E[n_a conj(n_b)] (...).
        factor: Complex (...), such as the dynamic stiffness between force and displacement.
    """
    return of_a + np.abs(factor) ** 2 * of_b - 2 * np.real(np.conj(factor) * of_both)
