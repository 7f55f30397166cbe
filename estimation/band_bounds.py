"""Bounds of intervals: where the profile of the cost, its minimum over the other coefficient, has risen far enough."""

import numpy as np

from estimation.band_errors import Found
from estimation.band_likelihood import Bands
from estimation.band_search import C, K

_ROUGH = 1e-4  # change of the cost that counts as converged; a bound lies where the cost has risen by about 2
_DOUBLINGS, _CLOSER = 40, 30


def bounds(bands: Bands, found: Found, threshold: np.ndarray) -> np.ndarray:
    """Profile-likelihood bounds (k low, k high, c low, c high) of every band of every lane, (4, cells).

    Infinite where the cost never rises that far.

    Args:
        bands: The bands.
        found: What was estimated of them.
        threshold: Rise of the cost that defines a bound of k and of c, (2, cells).
    """
    with np.errstate(divide="ignore", invalid="ignore"):
        steps = np.sqrt(2 * threshold / found.ratio) * found.se
        # Cost of an infinitely stiff or damped support, for which all measured displacement would be noise.
        py = bands.pooled[1]
        far = np.where(py > 0, bands.moments[0] / py - found.cost, np.inf)
        steps = np.where(np.isfinite(found.se) & (far > threshold), steps, np.nan)
    return np.stack([
        _bound(bands, found, threshold[of], sign * steps[of], of, sign * np.inf)
        for of in range(2)
        for sign in (-1, 1)
    ])  # fmt: skip


def _bound(bands: Bands, found: Found, threshold: np.ndarray, step: np.ndarray, of: int, far: float) -> np.ndarray:
    """Bounds (cells) of k (of = 0) or c (1), which are sought from the minimum in steps of `step`; far if not found."""
    end = np.where(np.isfinite(found.at[of]), far, np.nan)
    leaving = np.isfinite(step)
    closing, known = np.zeros_like(leaving), found.at
    inside, g_in = np.zeros(step.shape), np.full(step.shape, -1.0)
    outside, g_out = np.zeros(step.shape), np.zeros(step.shape)
    remaining = np.full(step.shape, _DOUBLINGS)
    while (sought := leaving | closing).any():
        known, cost = _profile(bands, found, known, np.where(sought, step, np.nan), of)
        with np.errstate(divide="ignore", invalid="ignore"):
            # How far beyond the threshold, as a share of the distance at which it is reached.
            g = np.sqrt(np.maximum(cost - found.cost, 0.0) / threshold) - 1.0
            remaining -= 1
            passed = leaving & (g >= 0)
            reached = closing & ((np.abs(g) < 1e-3) | (remaining == 0))
            end = np.where(reached, found.at[of] + step, end)
            within, beyond = leaving & ~passed, passed
            within, beyond = within | (closing & ~reached & (g <= 0)), beyond | (closing & ~reached & (g > 0))
            # The end that stays counts half, so that it moves, too.
            g_out, g_in = np.where(within & closing, g_out / 2, g_out), np.where(beyond & closing, g_in / 2, g_in)
            inside, g_in = np.where(within, step, inside), np.where(within, g, g_in)
            outside, g_out = np.where(beyond, step, outside), np.where(beyond, g, g_out)
            closing = (closing & ~reached) | passed
            remaining = np.where(passed, _CLOSER, remaining)
            leaving &= ~passed & (remaining > 0)
            between = inside - g_in * (outside - inside) / (g_out - g_in)
            step = np.where(closing, between, np.where(leaving, step * 1.5, step))
            narrow = closing & (np.abs(outside - inside) < 1e-3 * np.abs(outside))
        end = np.where(narrow, found.at[of] + step, end)
        closing &= ~narrow
    return end


def _profile(
    bands: Bands, found: Found, known: np.ndarray, step: np.ndarray, of: int
) -> tuple[np.ndarray, np.ndarray]:  # fmt: skip
    """Points (2, cells) of lowest cost, and that cost, with one coefficient held at a distance from the minimum.

    The other coefficient starts from the cheapest of three points: where it was last (`known`), along the ridge, or at
    the minimum. Noise gives the profile side valleys, and a search that keeps to the last point could stay in one.
    """
    other = found.at[1 - of]
    held = found.at[of] + step
    starts = [(held, start) for start in (known[1 - of], other + found.slope[of] * step, other)]
    points = bands.found(np.array([pair[:: 1 - 2 * of] for pair in starts]), (K, C)[of], _ROUGH)
    return points[:2], points[2]
