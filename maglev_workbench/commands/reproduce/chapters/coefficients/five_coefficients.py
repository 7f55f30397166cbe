"""The program of Appendix C: stiffness, damping and input of two coupled axes from one excitation (eq 5.9), and of one
axis in the same way."""

from dataclasses import dataclass

import numpy as np

from estimation.bands import band_slices

SIGNIFICANT = 2.0  # Tvalue of the program


@dataclass(frozen=True, eq=False)
class FiveCoefficients:
    """What the program prints for each band.

    Attributes:
        stiffness: (bands, 2, 2), N/m; no spring is subtracted.
        damping: (bands, 2, 2), N s/m.
        input: (bands, 2): beta_x and beta_y, the shares of the force along the axes, which are fitted too.
        goodness_of_fit: (bands, 2), of the equations in x and y.
        stiffness_significant: (bands, 2, 2), |t| of at least SIGNIFICANT.
        damping_significant: (bands, 2, 2).
    """

    stiffness: np.ndarray
    damping: np.ndarray
    input: np.ndarray
    goodness_of_fit: np.ndarray
    stiffness_significant: np.ndarray
    damping_significant: np.ndarray

    @property
    def angle(self) -> np.ndarray:
        """Forcing angle (bands,) in degrees from x toward y."""
        return np.degrees(np.arctan(self.input[:, 1] / self.input[:, 0]))


def five_coefficients(frequency: np.ndarray, response: np.ndarray, mass: float, bands: np.ndarray) -> FiveCoefficients:
    """Least squares on K G + j w C G - beta = m w^2 G in each band, as Appendix C has it.

    Args:
        frequency: lines (n,), Hz.
        response: displacements in x and y over the magnitude of the force, complex (2, n), m/N.
        mass: kg.
        bands: (bands, 2), Hz.
    """
    omega = 2 * np.pi * frequency
    gx, gy = response
    columns = np.stack([gx, gy, 1j * omega * gx, 1j * omega * gy, -np.ones(len(omega))], axis=1)
    target = (mass * omega**2 * response).T
    parts = [_fit(_real(columns[rows]), _real(target[rows])) for rows in _slices(frequency, bands)]
    values, fit, significant = (np.array(part) for part in zip(*parts, strict=True))
    # A column of the program's coefficients belongs to one equation: (coefficient, axis) becomes (axis, coefficient).
    turned, sure = np.swapaxes(values, 1, 2), np.swapaxes(significant, 1, 2)
    return FiveCoefficients(turned[..., :2], turned[..., 2:4], turned[..., 4], fit, sure[..., :2], sure[..., 2:4])


def three_coefficients(frequency: np.ndarray, response: np.ndarray, mass: float, bands: np.ndarray) -> np.ndarray:
    """Stiffness, damping, input and goodness of fit (4, bands) of one axis whose input is fitted as Appendix C does.

    response: displacement over force, complex (n,), m/N; the others as in `five_coefficients`.
    """
    omega = 2 * np.pi * frequency
    columns = np.stack([response, 1j * omega * response, -np.ones(len(omega))], axis=1)
    target = (mass * omega**2 * response)[:, None]
    parts = [_fit(_real(columns[rows]), _real(target[rows])) for rows in _slices(frequency, bands)]
    return np.array([(*values[:, 0], fit[0]) for values, fit, _ in parts]).T


def _slices(frequency: np.ndarray, bands: np.ndarray) -> list[slice]:
    return [slice(*pair) for pair in band_slices(frequency, bands)]


def _real(rows: np.ndarray) -> np.ndarray:
    return np.concatenate([rows.real, rows.imag])


def _fit(columns: np.ndarray, target: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Coefficients (k, axes), goodness of fit (axes,) and significance (k, axes) of one band."""
    length = np.linalg.norm(columns, axis=0)
    left, spread, right = np.linalg.svd(columns / length, full_matrices=False)
    inverse = right.T / spread
    values = inverse @ (left.T @ target)
    rows, freedom = len(target), len(target) - columns.shape[1]
    residual = np.sum((target - columns / length @ values) ** 2, axis=0)
    total = np.sum((target - target.mean(axis=0)) ** 2, axis=0)
    fit = np.sqrt(np.maximum(1 - (rows - 1) * residual / (freedom * total), 0.0))
    error = np.sqrt(np.outer(np.sum(inverse**2, axis=1), residual / freedom))
    return values / length[:, None], fit, np.abs(values) >= SIGNIFICANT * error
