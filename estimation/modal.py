"""One mass, stiffness and damping for a whole record: for records whose moving mass is not known."""

from dataclasses import dataclass

import numpy as np
from scipy.ndimage import uniform_filter1d
from scipy.optimize import least_squares as minimise

from estimation.periods import LineStatistics

_POOL = 15  # lines over which the noise covariance is averaged: its own scatter drops to a few per cent


@dataclass(frozen=True)
class ModalEstimate:
    """mass kg, stiffness N/m, damping N s/m, natural_frequency Hz, damping_ratio, each with *_se; cost_ratio: residual
    power over what the noise explains (1 for a perfect model); standard errors include it when it exceeds 1."""

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


def modal_estimate(statistics: LineStatistics) -> ModalEstimate:
    """Errors-in-variables maximum likelihood of F = (k - m w^2 + j w c) Y over all lines of one record.

    statistics: channels "force" and "displacement", no leading dimensions, at least four lines. ValueError when there
    are fewer, or when the fit has no positive mass and stiffness (no resonance in the excited band).
    """
    f, y = statistics.amplitude("force"), statistics.amplitude("displacement")
    if f.ndim != 1 or f.size < 4:
        raise ValueError(f"mass estimate: {f.size} lines; at least four excited lines are needed")
    w = 2 * np.pi * statistics.frequency

    def pooled(a: str, b: str) -> np.ndarray:
        c = statistics.cross(a, b)
        return uniform_filter1d(c.real, _POOL) + 1j * uniform_filter1d(c.imag, _POOL)

    s_f, s_y, s_fy = (
        pooled("force", "force").real,
        pooled("displacement", "displacement").real,
        pooled("force", "displacement"),
    )
    # A record without noise is weighted as if its force had a relative noise of 1e-9.
    s_f = s_f + 1e-18 * np.mean(np.abs(f) ** 2)
    scale = np.array([1.0, np.mean(w), np.mean(w**2)])

    def residual(p: np.ndarray) -> np.ndarray:
        k, c, m = p / scale * size
        z = k - m * w**2 + 1j * w * c
        variance = s_f + np.abs(z) ** 2 * s_y - 2 * np.real(np.conj(z) * s_fy)
        r = (f - z * y) / np.sqrt(variance)
        return np.concatenate([r.real, r.imag])

    columns = np.stack([y, 1j * w * y, -(w**2) * y], axis=1) / scale
    start = np.linalg.lstsq(np.concatenate([columns.real, columns.imag]), np.concatenate([f.real, f.imag]), rcond=None)[
        0
    ]
    size = np.abs(start).max()
    fit = minimise(residual, start / size, method="lm", xtol=1e-12, ftol=1e-12)
    k, c, m = fit.x / scale * size
    if not (m > 0 and k > 0):
        raise ValueError("mass estimate: no positive mass and stiffness fit the record; is a resonance in the band?")
    freedom = 2 * f.size - 3
    ratio = 2 * fit.cost / (0.5 * freedom)
    covariance = np.linalg.inv(fit.jac.T @ fit.jac) * 0.5 * max(1.0, ratio)
    covariance = covariance * np.outer(size / scale, size / scale)
    natural, zeta = np.sqrt(k / m) / (2 * np.pi), c / (2 * np.sqrt(k * m))
    d_natural = natural * np.array([0.5 / k, 0.0, -0.5 / m])
    d_zeta = zeta * np.array([-0.5 / k, 1 / c, -0.5 / m])
    se = np.sqrt(np.diag(covariance))
    return ModalEstimate(
        m, k, c, natural, zeta, se[2], se[0], se[1],
        float(np.sqrt(d_natural @ covariance @ d_natural)),
        float(np.sqrt(d_zeta @ covariance @ d_zeta)),
        float(ratio),
    )  # fmt: skip
