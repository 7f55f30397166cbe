"""Stiffness and damping of one axis by plain least squares on the receptance, as the dissertation (D) does.

The equations are D eq 4.13-4.22 and the statistics those of D Appendix C. Both sides of eq 4.13 contain the measured
receptance G, so its noise biases the result: with rho = sum |G|^2 / sum (|G|^2 + sigma_G^2) over a narrow band, the
stiffness tends to rho k + (1 - rho) m w^2 and the damping to rho c, while R2 stays high. Where |G| is not far above its
noise, this estimate must not be trusted, however good the fit looks.
"""

from dataclasses import dataclass

import numpy as np
import scipy
from numpy.typing import ArrayLike, NDArray

CONFIDENCE = 0.95
COEFFICIENTS = 2


@dataclass(frozen=True, eq=False)
class LeastSquares:
    """Result of `least_squares`; every field has the leading shape (...) of the receptance, () for one band.

    Attributes:
        stiffness: N/m.
        damping: N s/m.
        stiffness_se: Standard error (D eq 4.22), N/m.
        damping_se: Standard error (D eq 4.22), N s/m.
        r2: Coefficient of determination (D eq 4.20).
        r2_adjusted: The same, adjusted for the number of coefficients.
        goodness_of_fit: sqrt(max(r2_adjusted, 0)), as D's tables report it (Appendix C).
        t_stiffness: Stiffness over its standard error.
        t_damping: Damping over its standard error.
        stiffness_significant: Whether |t_stiffness| reaches the two-sided 95 % quantile of Student's t.
        damping_significant: Whether |t_damping| does.
    """

    stiffness: NDArray[np.float64]
    damping: NDArray[np.float64]
    stiffness_se: NDArray[np.float64]
    damping_se: NDArray[np.float64]
    r2: NDArray[np.float64]
    r2_adjusted: NDArray[np.float64]
    goodness_of_fit: NDArray[np.float64]
    t_stiffness: NDArray[np.float64]
    t_damping: NDArray[np.float64]
    stiffness_significant: NDArray[np.bool_]
    damping_significant: NDArray[np.bool_]


def least_squares(frequency: ArrayLike, receptance: ArrayLike, mass: ArrayLike) -> LeastSquares:
    """Stiffness and damping of one band from its receptance, D eq 4.13-4.22.

    The 2n rows are the real and imaginary parts of G (k + j w c) = 1 + m w^2 G. R2 is taken about the mean of the
    right-hand side (Appendix C). The residual variance has 2n - 3 degrees of freedom (D eq 4.21); the 2N - 5 of
    Appendix C belongs to its five coefficients.

    Args:
        frequency: Frequencies (n,), Hz, n >= 2.
        receptance: Y / F of period averages, complex (..., n), m/N.
        mass: Moving mass, kg, scalar or broadcast with (...).

    Raises:
        ValueError: Bad shapes, values that are not finite, or a receptance that is zero on the whole band.
    """
    f = np.asarray(frequency, dtype=float)
    g = np.asarray(receptance, dtype=complex)
    m = np.asarray(mass, dtype=float)[..., None]
    if f.ndim != 1 or f.size < 2 or not np.all(np.isfinite(f)) or np.any(f <= 0):
        raise ValueError("frequency must hold at least 2 positive frequencies in Hz; widen the band")
    if g.ndim == 0 or g.shape[-1] != f.size:
        raise ValueError(f"receptance must have {f.size} lines in its last dimension, one per frequency")
    if not np.all(np.isfinite(g)):
        raise ValueError("receptance must be finite; leave out lines without a value")
    if not np.all(np.isfinite(m)) or np.any(m <= 0):
        raise ValueError("mass must be positive, in kg")
    omega = 2 * np.pi * f
    power = np.abs(g) ** 2
    normal_k = np.sum(power, axis=-1)
    normal_c = np.sum(omega**2 * power, axis=-1)
    if np.any(normal_k == 0):
        raise ValueError("receptance must not be zero on the whole band; check the displacement channel")

    # The two columns of W_F are orthogonal line by line, so the normal equations (D eq 4.19) decouple.
    target = m * omega**2 * g + 1
    inner = np.conj(g) * target
    stiffness = np.sum(inner.real, axis=-1) / normal_k
    damping = np.sum(omega * inner.imag, axis=-1) / normal_c

    residual = target - g * (stiffness[..., None] + 1j * omega * damping[..., None])
    rss = np.sum(np.abs(residual) ** 2, axis=-1)
    rows = 2 * f.size
    mean = np.sum(target.real + target.imag, axis=-1, keepdims=True) / rows
    total = np.sum((target.real - mean) ** 2 + (target.imag - mean) ** 2, axis=-1)
    r2 = 1 - rss / total
    r2_adjusted = 1 - (1 - r2) * (rows - 1) / (rows - COEFFICIENTS)

    freedom = rows - 3
    stiffness_se = np.sqrt(rss / freedom / normal_k)
    damping_se = np.sqrt(rss / freedom / normal_c)
    with np.errstate(divide="ignore", invalid="ignore"):  # an exact fit has no standard error
        t_stiffness = stiffness / stiffness_se
        t_damping = damping / damping_se
    limit = scipy.special.stdtrit(freedom, (1 + CONFIDENCE) / 2)  # scipy.stats takes half a second to import
    return LeastSquares(
        stiffness=stiffness,
        damping=damping,
        stiffness_se=stiffness_se,
        damping_se=damping_se,
        r2=r2,
        r2_adjusted=r2_adjusted,
        goodness_of_fit=np.sqrt(np.maximum(r2_adjusted, 0.0)),
        t_stiffness=t_stiffness,
        t_damping=t_damping,
        stiffness_significant=np.abs(t_stiffness) >= limit,
        damping_significant=np.abs(t_damping) >= limit,
    )
