"""Estimates of bands, with standard errors."""

from dataclasses import dataclass

import numpy as np

from estimation.band_likelihood import Bands
from estimation.band_search import NEITHER

_FINE = 1e-8  # change of the cost that counts as converged
_INFINITE = 1e300


@dataclass(frozen=True)
class Found:
    """What was found in every band of every lane, cells (see `band_likelihood`); pairs (2, ...) are of k and c.

    Attributes:
        at: k and c, in N/m and N s/m.
        se: Standard errors that hold although the noise differs between the lines of the band.
        ratio: Their squares over the inverse half Hessian.
        freedom: Their degrees of freedom (Satterthwaite).
        slope: Of the other coefficient, by this one, along the ridge of the cost.
        cost: At the minimum.
        expected: Cost that noise alone is expected to leave.
        cost_freedom: Degrees of freedom of the numerator of the cost.
        noise_share: Share of the displacement's power that is noise.
    """

    at: np.ndarray
    se: np.ndarray
    ratio: np.ndarray
    freedom: np.ndarray
    slope: np.ndarray
    cost: np.ndarray
    expected: np.ndarray
    cost_freedom: np.ndarray
    noise_share: np.ndarray


def estimate(bands: Bands, periods: int) -> Found:
    """Estimate every band of every lane; nan where the data are.

    The pooled covariance weights the lines; the covariances of the single lines say how much noise entered. The pooled
    covariance is itself estimated, and where constant coefficients do not fit the band, other weights move the optimum;
    the delta method adds that variance.

    Args:
        bands: The bands.
        periods: Number of periods.
    """
    best = np.zeros((6, *bands.mass.shape))
    best[2] = _INFINITE
    for start in _starts(bands):
        own = bands.found(start[None], NEITHER, _FINE)
        best = np.where(own[2] < best[2], own, best)
    cost, hkk, hkc, hcc = best[2:]
    h, g, hr, gr, hr2, hg, gr2, hrr, grr, alike, alike_square, *by = bands.sums(best)
    n, power = bands.count, bands.moments[0]
    most = 2 * n * (periods - 1)
    # The square of a sample variance exceeds the square of the true variance by the factor 1 + 1 / (periods - 1).
    thin = periods / (periods - 1)
    with np.errstate(all="ignore"):  # what is not finite is replaced below
        det = hkk * hcc - hkc * hkc
        ik, ix, ic = hcc / det, -hkc / det, hkk / det
        direct, across = np.stack([ik, ic]), ix * ix
        # By each line of h (k) and g = w^2 h (c), with its noise.
        of_h, of_g = np.stack([ik * ik, across]), np.stack([across, ic * ic])
        sums = of_h * hr + of_g * gr
        squares = of_h * of_h * hr2 + 2 * of_h * of_g * hg + of_g * of_g * gr2
        # Lines of unequal noise give a pooled covariance with fewer degrees of freedom.
        same = np.minimum(thin * alike * alike / alike_square, n)
        of_k, of_c = by[:4], by[4:]
        for i, (x, y) in enumerate(((ik, ix), (ix, ic))):
            turned = (x * a + y * b for a, b in zip(of_k, of_c, strict=True))
            sums[i] += 2 * _quadratic(*turned, *bands.pooled) / (same * (periods - 1))
        # The leverages are scaled to sum to one; those of the exact Hessian can be far from that in noise.
        hats = ik * h + ic * g
        expected = alike - (ik * hr + ic * gr) / hats
        spread = alike_square - 2 * (ik * hrr + ic * grr) / hats
        spread += (ik * ik * hr2 + 2 * ik * ic * hg + ic * ic * gr2) / (hats * hats)
        ratio, se = sums / direct, np.sqrt(0.5 * sums)
        freedom = np.minimum(2 * periods * sums * sums / squares, most)
        cost_freedom = np.minimum(2 * thin * expected * expected / spread, 2 * (n - 1))
        # Of an optimum that ran to infinity k and c are unknown, and no interval is bounded.
        sure = (hkk > 0) & (det > 0) & np.isfinite(ik) & np.isfinite(ic)
        found = {
            "at": best[:2],
            "se": np.where(sure, se, np.inf),
            "ratio": np.where(sure, ratio, 1.0),
            "freedom": np.where(sure, freedom, most),
            "slope": -hkc / np.stack([hcc, hkk]),
            "cost": cost,
            "expected": np.where(sure, expected, n - 1),
            "cost_freedom": np.where(sure, cost_freedom, 2 * (n - 1)),
            "noise_share": np.minimum(n * bands.pooled[1] / power, 1.0),
        }
    known = np.isfinite(power)
    return Found(**(found if known.all() else {name: np.where(known, v, np.nan) for name, v in found.items()}))


def _starts(bands: Bands) -> list[np.ndarray]:
    """The moment estimator, corrected for noise, and the dissertation's least squares, (2, cells) each."""
    power, fast, along, across = bands.moments
    _, py, pr, pi = bands.pooled
    powers = np.append(bands.w, 0.0) ** np.array([[1], [2]])  # one more, because no band may end beyond them
    w1, w2 = np.add.reduceat(powers, bands.slices.reshape(-1), axis=1)[:, ::2, None]
    found = []
    for noise in (1.0, 0.0):
        n, still, moving = noise * bands.count, power - noise * bands.count * py, fast - noise * w2 * py
        with np.errstate(divide="ignore", invalid="ignore"):
            k, c = (along - n * pr + bands.mass * moving) / still, (across - noise * w1 * pi) / moving
        found.append(np.where((still > 0) & (moving > 0), np.stack([k, c]), np.nan))
    return found


def _quadratic(
    a: np.ndarray, b: np.ndarray, re: np.ndarray, im: np.ndarray, pf: np.ndarray, py: np.ndarray, pr: np.ndarray,
    pi: np.ndarray,
) -> np.ndarray:  # fmt: skip
    """Variance of a s_F^2 + b s_Y^2 + re Re s_FY + im Im s_FY, times the degrees of freedom of the Wishart covariance.

    It equals tr(M C M C) with the Hermitian matrix M of the coefficients.
    """
    g_re, g_im = re / 2, im / 2
    along, across = g_re * pr + g_im * pi, g_im * pr - g_re * pi
    p, v = a * pf + along, along + b * py
    q_re, q_im = a * pr + g_re * py, a * pi + g_im * py
    u_re, u_im = g_re * pf + b * pr, g_im * pf + b * pi
    return p * p + v * v - 2.0 * (across * across - q_re * u_re - q_im * u_im)
