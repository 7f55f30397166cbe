"""Standard errors of the estimates of bands, from sums over their lines."""

from dataclasses import dataclass
from functools import partial

import numpy as np

from estimation import band_sums as rows
from maglev_lanes.layout import row


@dataclass(frozen=True)
class Found:
    """What the search found in every band of every lane, arrays (lanes, bands); pairs (2, ...) are of k and c.

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
        power: The displacement's power.
        pooled: Covariance pooled over the band, (4, ...): of the force, of the displacement, and of both, real and
            imaginary.
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
    power: np.ndarray
    pooled: np.ndarray

    @classmethod
    def of(cls, left: np.ndarray, lanes: int, count: np.ndarray, periods: int) -> "Found":
        """From what the search leaves.

        The pooled covariance weights the lines; the covariances of the single lines say how much noise entered. The
        pooled covariance is itself estimated, and where constant coefficients do not fit the band, other weights move
        the optimum; the delta method adds that variance.

        Args:
            left: rows POWER to END of `band_sums`, (blocks, bands, rows, LANES).
            lanes: number of lanes.
            count: number of lines of each band, (bands,).
            periods: number of periods.
        """
        get = partial(_of_rows, left)
        n = count[:, None].astype(float)
        k, c, cost, hkk, hkc, hcc = get(rows.BEST_K, 6)
        pooled = get(rows.COVARIANCE, 4)
        sums, squares = get(rows.SUM_K, 2), get(rows.SQUARE_K, 2)
        hats, by_hat, hat_square, cross, alike, alike_square = get(rows.HATS, 6)
        by = get(rows.KA, 8).reshape(2, 4, *k.shape)
        ik, ix, ic = get(rows.IK, 3)
        power = get(rows.POWER, 1)[0]
        most = 2 * n * (periods - 1)
        # The square of a sample variance exceeds the square of the true variance by the factor 1 + 1 / (periods - 1).
        thin = periods / (periods - 1)
        with np.errstate(all="ignore"):  # what is not finite is replaced below
            # Lines of unequal noise give a pooled covariance with fewer degrees of freedom.
            same = np.minimum(thin * alike * alike / alike_square, n)
            weights = np.stack(
                [_quadratic(*(ik * by[0] + ix * by[1]), *pooled), _quadratic(*(ix * by[0] + ic * by[1]), *pooled)]
            )
            sums = sums + 2 * weights / (same * (periods - 1))
            # The leverages are scaled to sum to one; those of the exact Hessian can be far from that in noise.
            expected = alike - by_hat / hats
            spread = alike_square - 2 * cross / hats + hat_square / (hats * hats)
            ratio, se = sums / np.stack([ik, ic]), np.sqrt(0.5 * sums)
            freedom = np.minimum(2 * periods * sums * sums / squares, most)
            cost_freedom = np.minimum(2 * thin * expected * expected / spread, 2 * (n - 1))
            slope = -hkc / np.stack([hcc, hkk])
            share = np.minimum(n * pooled[1] / power, 1.0)
            # Of an optimum that ran to infinity k and c are unknown, and no interval is bounded.
            sure = (hkk > 0) & (hkk * hcc - hkc * hkc > 0) & np.isfinite(ik) & np.isfinite(ic)
        found = {
            "at": np.stack([k, c]),
            "se": np.where(sure, se, np.inf),
            "ratio": np.where(sure, ratio, 1.0),
            "freedom": np.where(sure, freedom, most),
            "slope": slope,
            "cost": cost,
            "expected": np.where(sure, expected, n - 1),
            "cost_freedom": np.where(sure, cost_freedom, 2 * (n - 1)),
            "noise_share": share,
            "power": power,
            "pooled": pooled,
        }
        unknown = ~np.isfinite(power)
        return cls(**{name: _of_lanes(np.where(unknown, np.nan, values), lanes) for name, values in found.items()})


def _of_rows(left: np.ndarray, offset: np.uint64, count: int) -> np.ndarray:
    """Rows from an offset on, (count, blocks, bands, LANES)."""
    first = row(int(offset - rows.POWER))
    return np.moveaxis(left[:, :, first : first + count], 2, 0)


def _of_lanes(values: np.ndarray, lanes: int) -> np.ndarray:
    """(..., lanes, bands) of (..., blocks, bands, LANES)."""
    turned = np.swapaxes(values, -1, -2)
    return turned.reshape(*values.shape[:-3], -1, values.shape[-2])[..., :lanes, :]


def _quadratic(
    a: np.ndarray, b: np.ndarray, re: np.ndarray, im: np.ndarray, pf: np.ndarray, py: np.ndarray, pr: np.ndarray,
    pi: np.ndarray,
) -> np.ndarray:  # fmt: skip
    """Variance of a s_F^2 + b s_Y^2 + re Re s_FY + im Im s_FY, times the degrees of freedom of the Wishart covariance.

    It equals tr(M C M C) with the Hermitian matrix M of the coefficients.
    """
    g, cross = (re + 1j * im) / 2, pr + 1j * pi
    p, q = a * pf + g * cross.conj(), a * cross + g * py
    u, v = g.conj() * pf + b * cross.conj(), g.conj() * cross + b * py
    return (p * p + 2.0 * q * u + v * v).real
