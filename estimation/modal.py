"""One mass, stiffness and damping for a whole record, for rigs whose moving mass is not known."""

from dataclasses import dataclass
from functools import cache

import numpy as np
import scipy
from numpy.typing import NDArray

from estimation.lines.periods import LineStatistics
from estimation.normal import NOISELESS

_POOL = 15  # lines over which the noise covariance is averaged; its own scatter falls to a few per cent


@dataclass(frozen=True)
class ModalEstimate:
    """Result of `modal_estimate`; each of the first five quantities has a standard error with the suffix `_se`.

    Attributes:
        mass: kg.
        stiffness: N/m.
        damping: N s/m.
        natural_frequency: Hz.
        damping_ratio: Dimensionless.
        cost_ratio: Residual power over the power that the measured noise explains; 1 for a perfect model.
        discrepancy: Rms displacement that the model cannot follow, as a share of the record's. It widens the
            standard errors.
    """

    mass: float
    stiffness: float
    damping: float
    natural_frequency: float
    damping_ratio: float
    mass_se: float
    stiffness_se: float
    damping_se: float
    natural_frequency_se: float
    damping_ratio_se: float
    cost_ratio: float
    discrepancy: float


def modal_estimate(statistics: LineStatistics) -> ModalEstimate:
    """Errors-in-variables maximum likelihood of F = (k - m w^2 + j w c) Y over all lines of one record.

    A rig that is not quite linear leaves more residual than noise alone, and weights from the noise alone would let
    the quietest lines decide. Where the residual exceeds its noise at p < 0.01, a displacement variance common to all
    lines is therefore added, just large enough that the residual agrees with its weights (the random-effects estimate
    of meta-analysis).

    Args:
        statistics: Channels "force" and "displacement", no leading dimensions, at least four lines.

    Raises:
        ValueError: Fewer than four lines, or no positive mass and stiffness fit (no resonance in the excited band).
    """
    fit = global_fit(statistics)
    k, c, m = fit.values
    if not (m > 0 and k > 0):
        raise ValueError("mass estimate: no positive mass and stiffness fit the record; is a resonance in the band?")
    covariance = fit.covariance
    natural, zeta = np.sqrt(k / m) / (2 * np.pi), c / (2 * np.sqrt(k * m))
    d_natural = natural * np.array([0.5 / k, 0.0, -0.5 / m])
    d_zeta = zeta * np.array([-0.5 / k, 1 / c, -0.5 / m])
    se = np.sqrt(np.diag(covariance))
    return ModalEstimate(
        m, k, c, natural, zeta, se[2], se[0], se[1],
        float(np.sqrt(d_natural @ covariance @ d_natural)),
        float(np.sqrt(d_zeta @ covariance @ d_zeta)),
        fit.cost_ratio, fit.discrepancy,
    )  # fmt: skip


@dataclass(frozen=True)
class GlobalFit:
    """Fit of F = (k - m w^2 + j w c) Y, before any check of the signs.

    Attributes:
        values: k, c and m, (3,).
        covariance: Their covariance (3, 3).
        cost_ratio: As in `ModalEstimate`.
        discrepancy: As in `ModalEstimate`.
    """

    values: np.ndarray
    covariance: np.ndarray
    cost_ratio: float
    discrepancy: float


def global_fit(statistics: LineStatistics) -> GlobalFit:
    """The fit behind `modal_estimate`.

    Raises:
        ValueError: Fewer than four lines.
    """
    f, y = statistics.amplitude("force"), statistics.amplitude("displacement")
    if f.ndim != 1 or f.size < 4:
        raise ValueError(f"mass estimate: {f.size} lines; at least four excited lines are needed")
    w = 2 * np.pi * statistics.frequency
    noise = _Noise(_pooled(statistics, "force", "force").real, _pooled(statistics, "displacement", "displacement").real,
                   _pooled(statistics, "force", "displacement"))  # fmt: skip
    power = float(np.mean(np.abs(y) ** 2))
    start = _linear_start(f, y, w)
    fit, ratio = _fit(f, y, w, noise, 0.0, start)
    freedom = 2 * f.size - 3
    extra = 0.0
    if scipy.stats.f.sf(ratio, freedom, 2 * (statistics.periods - 1) * min(f.size, _POOL)) < 0.01:
        low, high = power * 1e-14, power
        path = [fit.x]

        @cache  # begun from another fit the same variance may give another value, and then its sign
        def excess(log_variance: float) -> float:
            trial, at = _fit(f, y, w, noise, np.exp(log_variance), path[-1])
            path.append(trial.x)
            return np.log(at)

        if excess(np.log(low)) > 0:
            if excess(np.log(high)) > 0:
                raise ValueError("mass estimate: no mass, stiffness and damping come near the record")
            root = scipy.optimize.brentq(excess, np.log(low), np.log(high), xtol=1e-3)
            extra = np.exp(root)  # pyright: ignore[reportArgumentType, reportCallIssue]  # scipy's full_output=True
        fit, _ = _fit(f, y, w, noise, extra, path[-1])
    covariance = np.linalg.inv(fit.jac.T @ fit.jac) * 0.5
    return GlobalFit(fit.x, covariance, float(ratio), float(np.sqrt(extra / power)))


@dataclass(frozen=True)
class _Noise:
    force: np.ndarray
    displacement: np.ndarray
    cross: np.ndarray


def _pooled(statistics: LineStatistics, a: str, b: str) -> NDArray[np.complex128]:
    c = np.asarray(statistics.cross(a, b), dtype=np.complex128)
    return np.asarray(
        scipy.ndimage.uniform_filter1d(c.real, _POOL) + 1j * scipy.ndimage.uniform_filter1d(c.imag, _POOL),
        dtype=np.complex128,
    )


def _linear_start(f: NDArray[np.complex128], y: NDArray[np.complex128], w: np.ndarray) -> np.ndarray:
    scale = np.array([1.0, np.mean(w), np.mean(w**2)])
    columns = np.stack([y, 1j * w * y, -(w**2) * y], axis=1) / scale
    real = np.concatenate([columns.real, columns.imag]), np.concatenate([f.real, f.imag])
    return np.linalg.lstsq(*real, rcond=None)[0] / scale


def _fit(
    f: np.ndarray, y: np.ndarray, w: np.ndarray, noise: _Noise, extra: float, start: np.ndarray
) -> "tuple[scipy.optimize.OptimizeResult, float]":
    """Levenberg-Marquardt search from `start` (k, c, m): the fit in SI units, and its residual over expected power."""
    # A record without noise keeps a weight.
    s_f = noise.force + NOISELESS * np.mean(np.abs(f) ** 2)
    s_y = noise.displacement + extra
    scale = np.abs(start) + 1e-6 * np.abs(start[0]) / np.array([1.0, np.mean(w), np.mean(w**2)])

    def residual(p: np.ndarray) -> np.ndarray:
        k, c, m = p * scale
        z = k - m * w**2 + 1j * w * c
        variance = s_f + np.abs(z) ** 2 * s_y - 2 * np.real(np.conj(z) * noise.cross)
        r = (f - z * y) / np.sqrt(variance)
        return np.concatenate([r.real, r.imag])

    fit = scipy.optimize.least_squares(residual, start / scale, method="lm", xtol=1e-12, ftol=1e-12)
    ratio = 2 * fit.cost / (0.5 * (2 * f.size - 3))
    fit.x = fit.x * scale
    fit.jac = fit.jac / scale
    return fit, ratio
