"""Curves over log frequency through values at lines: interpolation, smoothing, peaks and crossings."""

from collections.abc import Iterator
from dataclasses import dataclass

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
    v = np.asarray(values, dtype=complex)
    grid, curves = refined_parts(frequency, v.reshape(-1, v.shape[-1]), v.size)
    return grid, next(curves).reshape(*v.shape[:-1], grid.size)


def refined_parts(
    frequency: ArrayLike, values: NDArray[np.complex128], together: int
) -> tuple[Array, Iterator[NDArray[np.complex128]]]:
    """As `refine`, of values (k, n), a few curves (`together`, m) at a time, which stay in the fast memory."""
    x = np.log(_checked_frequency(frequency))
    grid = refined_grid(x)
    inside = grid[:-1].reshape(-1, REFINEMENT)
    coefficients = _spline(x, values)

    def parts() -> Iterator[NDArray[np.complex128]]:
        # The same in real numbers and in order of the grid takes a fifth of the time of the spline's own evaluation.
        for start in range(0, max(len(values), 1), together):
            own = np.ascontiguousarray(coefficients[..., start : start + together]).view(float)
            curve = np.empty((grid.size, own.shape[-1]))
            within = curve[:-1].reshape(*inside.shape, own.shape[-1])
            _cubic(own[:, :, None], (inside - x[:-1, None])[..., None], within)
            _cubic(own[:, -1], x[-1] - x[-2], curve[-1])
            yield np.ascontiguousarray(curve.view(complex).T)

    return grid, parts()


def refined_grid(log_frequency: Array, times: int = REFINEMENT) -> Array:
    """The grid (m,) of `refine` for logarithms of frequencies (n,), with so many points per interval."""
    steps = np.diff(log_frequency)[:, None] * (np.arange(times) / times)
    return np.append((log_frequency[:-1, None] + steps).ravel(), log_frequency[-1])


def _spline(x: Array, values: NDArray[np.complex128]) -> NDArray[np.complex128]:
    """Coefficients (4, n - 1, k), highest power first, of cubic splines through values (k, n) at x (n,), n >= 4.

    The two cubics at either end are one ("not a knot"). Equations and solution are those of
    scipy.interpolate.CubicSpline; importing that takes as long as a hundred gain sets.
    """
    y, h = np.ascontiguousarray(values.T), np.diff(x)
    step = h[:, None]
    slope = np.diff(y, axis=0) / step
    start, end = x[2] - x[0], x[-1] - x[-3]
    bands, right = np.zeros((3, x.size)), np.empty(y.shape, y.dtype)
    bands[1, 1:-1], bands[0, 2:], bands[2, :-2] = 2 * (h[:-1] + h[1:]), h[:-1], h[1:]
    bands[1, 0], bands[0, 1], bands[1, -1], bands[2, -2] = h[1], start, h[-2], end
    right[1:-1] = 3 * (step[1:] * slope[:-1] + step[:-1] * slope[1:])
    right[0] = ((step[0] + 2 * start) * step[1] * slope[0] + step[0] ** 2 * slope[1]) / start
    right[-1] = (step[-1] ** 2 * slope[-2] + (2 * end + step[-1]) * step[-2] * slope[-1]) / end
    tangent = scipy.linalg.solve_banded((1, 1), bands, right, check_finite=False)
    bend = (tangent[:-1] + tangent[1:] - 2 * slope) / step
    return np.stack([bend / step, (slope - tangent[:-1]) / step - bend, tangent[:-1], y[:-1]])


def _cubic(coefficients: Array, s: ArrayLike, out: Array) -> None:
    """Write cubics of s with coefficients (4, ...), that of the highest power first."""
    power = np.asarray(s)
    np.multiply(coefficients[2], power, out=out)
    out += coefficients[3]
    for coefficient in coefficients[1::-1]:
        power = power * s
        out += coefficient * power


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


@dataclass(frozen=True)
class Crossings:
    """Where curves (..., m) change their sign, (k,) each; those of one curve follow each other.

    Attributes:
        shape: Of the curves (...).
        curve: Number of the curve.
        log_frequency: Of the crossing.
        others: Further curves at the crossing.
    """

    shape: tuple[int, ...]
    curve: NDArray[np.int64]
    log_frequency: Array
    others: tuple[Array, ...]

    def least(self, values: Array, key: Array) -> tuple[Array, Array]:
        """Value and frequency in Hz, each (...), at the smallest key of each curve; nan where that value is infinite.

        Args:
            values: (k,).
            key: (k,).
        """
        order = np.lexsort((key, self.curve))
        curves, first = np.unique(self.curve[order], return_index=True)
        chosen = order[first]
        found = np.full((2, int(np.prod(self.shape))), np.nan)
        found[:, curves] = values[chosen], np.exp(self.log_frequency[chosen])
        found[:, np.isinf(found[0])] = np.nan
        value, at = found.reshape(2, *self.shape)
        return value, at


def crossings(grid: Array, level: Array, *others: Array) -> Crossings:
    """Sign changes of curves, by linear interpolation within each grid interval.

    Args:
        grid: Log frequencies (m,).
        level: Curves (..., m) whose sign changes are sought.
        others: Further curves (..., m) to be evaluated at the crossings.
    """
    above = (level > 0).reshape(-1, grid.size)
    curve, i = np.nonzero(above[:, 1:] != above[:, :-1])
    ends = [(v.reshape(-1, grid.size)[curve, i], v.reshape(-1, grid.size)[curve, i + 1]) for v in (level, *others)]
    (a, b), *rest = ends
    part = a / (a - b)
    at = grid[i] + part * (grid[i + 1] - grid[i])
    return Crossings(level.shape[:-1], curve, at, tuple(low + part * (high - low) for low, high in rest))


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
