"""Curves over log frequency through values at lines: interpolation, smoothing, peaks and crossings."""

import numpy as np
import scipy
from numpy.typing import ArrayLike, NDArray

REFINEMENT = 16  # grid points per interval between lines, equally spaced in log frequency

Array = NDArray[np.float64]


def refine(frequency: ArrayLike, values: ArrayLike) -> tuple[Array, NDArray[np.complex128]]:
    """Cubic spline through values at lines, on a finer grid of log frequency.

    Args:
        frequency: Increasing positive frequencies (n,), Hz, n >= 4.
        values: Complex values (..., n).

    Returns:
        grid: Log frequencies (m,), m = 16 (n - 1) + 1.
        curve: Spline values (..., m).

    Raises:
        ValueError: Bad frequencies.
    """
    x = np.log(_checked_frequency(frequency))
    inside = x[:-1, None] + np.diff(x)[:, None] * (np.arange(REFINEMENT) / REFINEMENT)
    grid = np.append(inside.ravel(), x[-1])
    return grid, scipy.interpolate.CubicSpline(x, np.asarray(values, dtype=complex), axis=-1)(grid)


def largest(grid: Array, values: Array) -> tuple[Array, Array]:
    """Maximum of real values on a grid of log frequency.

    Args:
        grid: Log frequencies (m,).
        values: Real values (..., m).

    Returns:
        maximum: The largest grid value (...).
        frequency: Vertex (...) of the parabola through the largest value and its neighbours, Hz.
    """
    i = np.argmax(values, axis=-1)
    j = np.clip(i, 1, grid.size - 2)
    low, mid, high = (np.take_along_axis(values, (j + k)[..., None], axis=-1)[..., 0] for k in (-1, 0, 1))
    left, right = grid[j] - grid[j - 1], grid[j + 1] - grid[j]
    rise, fall = (mid - low) / left, (high - mid) / right
    inner = (rise > fall) & (i == j)  # at an end of the grid or on a plateau, the grid point itself is taken
    step = np.divide(rise * right + fall * left, 2 * (rise - fall), out=np.zeros_like(rise), where=inner)
    return np.take_along_axis(values, i[..., None], axis=-1)[..., 0], np.exp(grid[i] + step)


def crossings(grid: Array, level: Array, *others: Array) -> tuple[NDArray[np.bool_], *tuple[Array, ...]]:
    """Sign changes of a curve, by linear interpolation within each grid interval.

    Args:
        grid: Log frequencies (m,).
        level: Curve (..., m) whose sign changes are sought.
        others: Further curves (..., m) to be evaluated at the crossings.

    Returns:
        A mask (..., m-1) of the intervals with a crossing, then the log frequency and each of the others at the
        crossing, (..., m-1) each; these have no meaning where the mask is False.
    """
    a, b = level[..., :-1], level[..., 1:]
    found = (a > 0) != (b > 0)
    part = np.divide(a, a - b, out=np.zeros_like(a), where=found)
    return found, *(v[..., :-1] + part * (v[..., 1:] - v[..., :-1]) for v in (grid, *others))


def least(values: Array, log_frequency: Array, key: Array) -> tuple[Array, Array]:
    """Value and frequency in Hz, each (...), at the smallest key (..., m); nan where that value is infinite."""
    i = np.argmin(key, axis=-1)[..., None]
    value = np.take_along_axis(values, i, axis=-1)[..., 0]
    at = np.exp(np.take_along_axis(log_frequency, i, axis=-1)[..., 0])
    return np.where(np.isinf(value), np.nan, value), np.where(np.isinf(value), np.nan, at)


def smooth_response(frequency: ArrayLike, response: ArrayLike, variance: ArrayLike) -> NDArray[np.complex128]:
    """Natural cubic smoothing spline of a response over log frequency, evaluated at the response's own frequencies.

    Mallows' Cp chooses the smoothness, which minimises the expected squared error summed over all lines; the top of a
    narrow peak comes out somewhat low. Form of Green and Silverman, Nonparametric Regression and Generalized Linear
    Models, 1994, chapter 2.

    Args:
        frequency: Increasing positive frequencies (n,), Hz, n >= 4.
        response: Complex responses (..., n), each with a smoothness of its own.
        variance: Their noise variance E|noise|^2 (n,), which weights the lines. If all are zero, the response is
            returned unchanged.

    Raises:
        ValueError: Bad input.
    """
    f, s = _checked_frequency(frequency), np.asarray(response, dtype=complex)
    noise = np.asarray(variance, dtype=float)
    if s.ndim == 0 or s.shape[-1:] != f.shape or not np.all(np.isfinite(s)):
        raise ValueError(f"response must hold {f.size} finite values, one per frequency")
    if noise.shape != f.shape or not np.all(np.isfinite(noise)) or np.any(noise < 0):
        raise ValueError(f"variance must hold {f.size} finite values >= 0, one per frequency")
    if not np.any(noise):
        return s
    weight = 1 / np.sqrt(np.maximum(noise, 1e-6 * np.max(noise)))  # so that a line without noise does not dominate
    h, k = np.diff(np.log(f)), np.arange(f.size - 2)
    bend = np.zeros((f.size, k.size))  # second differences
    bend[k, k], bend[k + 1, k], bend[k + 2, k] = 1 / h[:-1], -1 / h[:-1] - 1 / h[1:], 1 / h[1:]
    gram = np.diag((h[:-1] + h[1:]) / 3) + np.diag(h[1:-1] / 6, 1) + np.diag(h[1:-1] / 6, -1)
    bend /= weight[:, None]
    roughness, basis = np.linalg.eigh(bend @ np.linalg.solve(gram, bend.T))
    roughness = np.maximum(roughness, 1e-15 * roughness[-1])
    part = (weight * s) @ basis
    penalty = np.geomspace(1e-3 / roughness[-1], 1e3 / roughness[2], 200)[:, None]
    # The two smallest eigenvalues belong to straight lines, which are never penalised.
    keep = 1 / (1 + penalty * np.concatenate([[0.0, 0.0], roughness[2:]]))
    risk = np.abs(part) ** 2 @ ((1 - keep) ** 2).T + 2 * keep.sum(axis=1)
    return (keep[np.argmin(risk, axis=-1)] * part) @ basis.T / weight


def _checked_frequency(frequency: ArrayLike) -> Array:
    f = np.asarray(frequency, dtype=float)
    if f.ndim != 1 or f.size < 4 or not np.all(np.isfinite(f)) or f[0] <= 0 or np.any(np.diff(f) <= 0):
        raise ValueError("frequency must hold at least 4 increasing positive frequencies in Hz")
    return f
