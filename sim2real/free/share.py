"""How much of an excess over noise is closed, and how surely; what is wanted of a free correction."""

import numpy as np

GAINED, SURELY = 0.2, 0.1  # share of what its rival leaves that must be closed, and the lower end of its 95 % interval
BEYOND_NOISE, DRAWN = 4.0, 400  # standard deviations of the noise's cost that a rival must leave; draws of the noise


def share_closed(before: np.ndarray, after: np.ndarray, seed: int) -> tuple[float | None, tuple[float, float] | None]:
    """Share of the excess over noise that is closed, with the 95 % interval that the noise of these lines leaves it.

    Noise is drawn once more for both residuals together (a parametric bootstrap), because a gap of a few lines leaves
    too little to draw from.

    Args:
        before: Whitened residual (K,) to compare with.
        after: Whitened residual (K,).
        seed: Of the noise.

    Returns:
        The share and its interval; None where the rotor touches down, or there is no excess beyond the noise.
    """
    n = before.size
    total = float(np.sum(abs(before) ** 2)) - 2.0 * n
    if not (np.isfinite(before).all() and np.isfinite(after).all()) or total < BEYOND_NOISE * np.sqrt(4.0 * n):
        return None, None
    rng = np.random.default_rng(seed)
    noise = rng.standard_normal((DRAWN, n, 2)) @ np.array([1.0, 1.0j])
    b, a = (np.sum(abs(r + noise) ** 2, axis=1) - 4.0 * n for r in (before, after))
    lo, hi = np.quantile(1 - a / np.maximum(b, 1e-9), [0.025, 0.975])
    return 1 - (float(np.sum(abs(after) ** 2)) - 2.0 * n) / total, (float(lo), float(hi))
