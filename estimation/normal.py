"""What all estimators of normal errors share."""

import numpy as np
import scipy

NORMAL_95 = 1.959964  # standard errors on either side of a normal estimate that hold 95 %
NOISELESS = 1e-18  # relative power: a record without noise is weighted as if it had a relative noise of 1e-9


def reach(freedom: np.ndarray | float, level: float = 0.95) -> np.ndarray:
    """Standard errors on either side of a normal estimate that hold a share of them, where the error is estimated too.

    That is Student's quantile. From an infinite freedom on it is that of the normal distribution.

    Args:
        freedom: Degrees of freedom of the squared standard error (...), real ones: a complex amplitude of P periods has
            2 (P - 1).
        level: The share.
    """
    known = np.isinf(freedom)
    several = scipy.special.stdtrit(np.where(known, 1.0, freedom), (1 + level) / 2)
    return np.asarray(np.where(known, scipy.special.ndtri((1 + level) / 2), several))


def widening(freedom: np.ndarray | float) -> np.ndarray:
    """Factor (...) on a standard error of so many degrees of freedom, of which NORMAL_95 then hold 95 %."""
    return reach(freedom) / NORMAL_95


def freedom_of_sum(freedom: np.ndarray | float, part: np.ndarray, whole: np.ndarray) -> np.ndarray:
    """Degrees of freedom of a variance of which only a part was estimated with few (Welch and Satterthwaite).

    Args:
        freedom: Of that part (...).
        part: Its variance (...).
        whole: The variance with what is known well (...), at least as large.
    """
    with np.errstate(divide="ignore", invalid="ignore"):  # where nothing of it was estimated, the whole is known
        return np.asarray(np.where(part > 0, freedom * (whole / part) ** 2, np.inf))


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
