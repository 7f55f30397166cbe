"""Stiffness and damping matrices of two coupled axes by plain least squares, as the dissertation (D) fits them.

Displacement noise biases this estimate; `estimation.xy.planar` has the estimator that stays unbiased.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import scipy

from estimation.lines.periods import LineStatistics
from estimation.xy.planar_lines import Mass, checked_masses, equation_rows, planar_lines


@dataclass(frozen=True, eq=False)
class PlanarLeastSquares:
    """Estimates per lane and band.

    Attributes:
        stiffness: (..., bands, 2, 2), N/m.
        damping: (..., bands, 2, 2), N s/m.
        stiffness_se: Standard error, N/m.
        damping_se: Standard error, N s/m.
        stiffness_t: Stiffness over its standard error.
        damping_t: Damping over its standard error.
        stiffness_significant: Whether |t| reaches the two-sided 95 % quantile of Student's t.
        damping_significant: The same for the damping.
        r2: Coefficient of determination per force axis, (..., bands, 2).
        r2_adjusted: The same, adjusted for the number of coefficients.
        condition: Condition number (..., bands) of the measured columns X, Y, j w X, j w Y; noise appears in them as
            independent motion.
    """

    stiffness: np.ndarray
    damping: np.ndarray
    stiffness_se: np.ndarray
    damping_se: np.ndarray
    stiffness_t: np.ndarray
    damping_t: np.ndarray
    stiffness_significant: np.ndarray
    damping_significant: np.ndarray
    r2: np.ndarray
    r2_adjusted: np.ndarray
    condition: np.ndarray


def planar_least_squares(records: Sequence[LineStatistics], bands: np.ndarray, mass: Mass) -> PlanarLeastSquares:
    """Plain least squares on the responses G = (X, Y) / |F| of all records, D eq 5.5-5.9 and Appendix C.

    D drives through one input and divides by its force; here both components are measured, and |F| is their magnitude
    at the line. The rows of one axis are the real and imaginary parts of
    G_x (k_xx + j w c_xx) + G_y (k_xy + j w c_xy) = F_x / |F| + m_x w^2 G_x. R2 is taken about the mean of the
    right-hand side; the residual variance has 2 n - 4 degrees of freedom, as in Appendix C. Noise on G biases the
    result as it does in `least_squares`. A single excitation is fitted and not refused; check `condition`. Columns that
    are linearly dependent to within rounding give nan.

    Args:
        records: As in `eight_coefficients`.
        bands: As in `eight_coefficients`.
        mass: As in `eight_coefficients`.

    Raises:
        ValueError: As `eight_coefficients`, and when a band holds fewer than three lines.
    """
    masses, shape = checked_masses(records, bands, mass, fewest=3)
    size = (len(masses), len(bands))
    values, errors = np.full((*size, 4, 2), np.nan), np.full((*size, 4, 2), np.nan)
    r2, adjusted, limit = np.full((*size, 2), np.nan), np.full((*size, 2), np.nan), np.empty(len(bands))
    condition = np.full(size, np.nan)
    for b, edges in enumerate(bands):
        lines = planar_lines(records, edges)
        table = (equation_rows(lines, masses) @ lines.u[..., None])[..., 0]
        table = table * (1 / np.linalg.norm(lines.u[..., :2], axis=-1, keepdims=True))
        rows, freedom = 2 * len(lines.w), 2 * len(lines.w) - 4
        ok = np.isfinite(table).all((1, 2))
        table = np.concatenate([table[ok].real, table[ok].imag], axis=1)
        columns, target = table[..., :4], table[..., 4:]
        length = np.linalg.norm(columns, axis=1)
        left, spread, right = np.linalg.svd(columns / np.where(length > 0, length, 1.0)[:, None], full_matrices=False)
        rank = spread > spread[:, :1] * np.finfo(float).eps * table.shape[1]
        inverse = np.swapaxes(right, 1, 2) / (np.where(rank, spread, np.nan)[:, None] * length[:, :, None])
        values[ok, b] = inverse @ (np.swapaxes(left, 1, 2) @ target)
        rss = ((target - columns @ values[ok, b]) ** 2).sum(axis=1)
        errors[ok, b] = np.sqrt((inverse**2).sum(-1)[:, :, None] * rss[:, None] / freedom)
        r2[ok, b] = 1 - rss / ((target - target.mean(axis=1, keepdims=True)) ** 2).sum(axis=1)
        adjusted[ok, b] = 1 - (1 - r2[ok, b]) * (rows - 1) / freedom
        condition[ok, b] = np.where(rank.all(-1), spread[:, 0] / spread[:, -1], np.inf)
        limit[b] = scipy.special.stdtrit(freedom, 0.975)
    with np.errstate(divide="ignore", invalid="ignore"):  # an exact fit has no standard error
        t = values / errors
    parts = []
    for a in (values, errors, t, np.abs(t) >= limit[:, None, None]):
        # From (column, row) to stiffness and damping, each (row, column).
        a = np.swapaxes(a.reshape(*shape, len(bands), 2, 2, 2), -1, -2)
        parts += [a[..., 0, :, :], a[..., 1, :, :]]
    r2, adjusted = (a.reshape(*shape, len(bands), 2) for a in (r2, adjusted))
    return PlanarLeastSquares(*parts, r2=r2, r2_adjusted=adjusted, condition=condition.reshape(*shape, len(bands)))
