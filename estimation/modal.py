"""One mass, stiffness and damping for a whole record, for rigs whose moving mass is not known."""

from dataclasses import dataclass
from functools import cache

import numpy as np
import scipy
from numpy.typing import NDArray

from estimation.lines.frequency_response import mean_of_neighbours
from estimation.lines.periods import LineStatistics
from estimation.normal import NOISELESS, variance_of_difference

_POOL = 15  # lines over which the noise covariance is averaged; its own scatter falls to a few per cent
_UNLIKELY = 0.01  # p-value of a residual that noise alone does not explain


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
    noise = _noise(statistics)
    power = float(np.mean(np.abs(y) ** 2))
    start = _linear_start(f, y, w)
    fit = _fit(f, y, w, noise, 0.0, start)
    ratio, extra = fit.ratio, 0.0
    if _by_chance(fit, f.size, statistics.periods) < _UNLIKELY:
        low, high = power * 1e-14, power
        path = [fit.at]

        @cache  # begun from another fit the same variance may give another value, and then its sign
        def excess(log_variance: float) -> float:
            trial = _fit(f, y, w, noise, np.exp(log_variance), path[-1])
            path.append(trial.at)
            return np.log(trial.ratio)

        if excess(np.log(low)) > 0:
            if excess(np.log(high)) > 0:
                raise ValueError("mass estimate: no mass, stiffness and damping come near the record")
            root = scipy.optimize.brentq(excess, np.log(low), np.log(high), xtol=1e-3)
            extra = np.exp(root)  # pyright: ignore[reportArgumentType, reportCallIssue]  # scipy's full_output=True
        fit = _fit(f, y, w, noise, extra, path[-1])
    return GlobalFit(fit.at, fit.covariance, float(ratio), float(np.sqrt(extra / power)))


@dataclass(frozen=True)
class _Covariance:
    force: np.ndarray
    displacement: np.ndarray
    cross: np.ndarray

    def of_misfit(self, z: np.ndarray, extra: float) -> np.ndarray:
        """Variance of F - z Y (n,), with a further variance of the displacement."""
        return variance_of_difference(self.force, self.displacement + extra, self.cross, z)


@dataclass(frozen=True)
class _Noise:
    """Noise of the lines: their own, and its mean over neighbouring lines, which weights them."""

    own: _Covariance
    pooled: _Covariance


@dataclass(frozen=True)
class _Fit:
    """k, c and m, their covariance, the residual over the power expected of it, and the noise of each line over that
    which weights it, for the real and the imaginary part (2 n,)."""

    at: np.ndarray
    covariance: np.ndarray
    ratio: float
    noise: np.ndarray


def _noise(statistics: LineStatistics) -> _Noise:
    def of(a: str, b: str) -> tuple[np.ndarray, np.ndarray]:
        c = np.asarray(statistics.cross(a, b), dtype=np.complex128)
        return c, mean_of_neighbours(c, _POOL)

    force, displacement = of("force", "force"), of("displacement", "displacement")
    # A record without noise keeps a weight.
    none = NOISELESS * np.mean(np.abs(statistics.amplitude("force")) ** 2)
    return _Noise(*(
        _Covariance(f.real + none, y.real, c)
        for f, y, c in zip(force, displacement, of("force", "displacement"), strict=True)
    ))  # fmt: skip


def _by_chance(fit: _Fit, lines: int, periods: int) -> float:
    """How likely noise alone leaves that much: the p-value of the residual power.

    Numerator and denominator are sums over all lines, of fewer equal ones where the noise is not equal (Satterthwaite;
    the square of a sample variance exceeds that of the true one by the factor 1 + 1 / (periods - 1)). The weights are
    means over few lines, whose inverse is too large on average.
    """
    equal = min(periods / (periods - 1) * fit.noise.sum() ** 2 / (fit.noise**2).sum(), 2.0 * lines)
    freedom = (periods - 1) * equal, 2 * (periods - 1) * min(lines, _POOL)
    of_sum, of_weights = (n / (n - 2) for n in freedom)
    return float(scipy.stats.f.sf(fit.ratio * of_sum / of_weights, max(equal - 3, 1.0), freedom[0]))


def _linear_start(f: NDArray[np.complex128], y: NDArray[np.complex128], w: np.ndarray) -> np.ndarray:
    scale = np.array([1.0, np.mean(w), np.mean(w**2)])
    columns = np.stack([y, 1j * w * y, -(w**2) * y], axis=1) / scale
    real = np.concatenate([columns.real, columns.imag]), np.concatenate([f.real, f.imag])
    return np.linalg.lstsq(*real, rcond=None)[0] / scale


def _fit(f: np.ndarray, y: np.ndarray, w: np.ndarray, noise: _Noise, extra: float, start: np.ndarray) -> _Fit:
    """Levenberg-Marquardt search from `start` (k, c, m), in SI units.

    The covariance holds although the noise differs between the lines over which the weights average it.
    """
    scale = np.abs(start) + 1e-6 * np.abs(start[0]) / np.array([1.0, np.mean(w), np.mean(w**2)])

    def stiffness(p: np.ndarray) -> np.ndarray:
        k, c, m = p * scale
        return k - m * w**2 + 1j * w * c

    def residual(p: np.ndarray) -> np.ndarray:
        z = stiffness(p)
        r = (f - z * y) / np.sqrt(noise.pooled.of_misfit(z, extra))
        return np.concatenate([r.real, r.imag])

    fit = scipy.optimize.least_squares(residual, start / scale, method="lm", xtol=1e-12, ftol=1e-12)
    z = stiffness(fit.x)
    share = np.tile(noise.own.of_misfit(z, extra) / noise.pooled.of_misfit(z, extra), 2)
    jac = fit.jac / scale
    inverse = np.linalg.inv(jac.T @ jac)
    middle = (jac.T * share) @ jac
    expected = 0.5 * (share.sum() - np.trace(inverse @ middle))
    return _Fit(fit.x * scale, 0.5 * inverse @ middle @ inverse, 2 * fit.cost / expected, share)
