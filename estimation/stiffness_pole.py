"""Does the stiffness of one mass jump over frequency as where a second body resonates?

A body m2 on a spring, which resonates alone at w2, adds -m2 w^2 w2^2 / (w2^2 - w^2) to the dynamic stiffness of its
carrier: below w2 it pulls the stiffness that one mass shows down without bound, above w2 it comes back from far above
and falls; where the mass of both is taken for one, it rises again from 1.4 w2 on.
"""

from dataclasses import dataclass

import numpy as np

CLEAR = 5.0  # standard errors of a jump, and 2 of the slopes beside it
SLOPE = 2.0
ALONE = 2.0  # times any other rise between neighbours
FAR_ALONE = 3.0  # the same where the stiffness falls below the jump alone: one mass of both bodies lets it rise above
APART = 2  # bands over which the jump may spread: the pole may stand inside one


@dataclass(frozen=True)
class StiffnessPole:
    """Where the stiffness jumps upward: frequencies below and above, Hz, and the stiffness there, N/m."""

    frequency: tuple[float, float]
    stiffness: tuple[float, float]


def stiffness_pole(frequency: np.ndarray, stiffness: np.ndarray, error: np.ndarray) -> StiffnessPole | None:
    """The clearest jump of a stiffness that falls before it.

    Args:
        frequency: middle of each band (n,), rising, Hz; the bands do not overlap.
        stiffness: of one mass in each band, (n,), N/m.
        error: standard error of each, (n,), N/m.

    Returns:
        None where there is none, or fewer than five bands.
    """
    known = np.isfinite(stiffness) & np.isfinite(error)
    f, k, se = frequency[known], stiffness[known], error[known]
    if f.size < 5:
        return None

    def rise(low: int, high: int) -> float:
        return float((k[high] - k[low]) / np.hypot(se[low], se[high]))

    def is_pole(low: int, high: int) -> bool:
        if rise(low - 1, low) > -SLOPE or rise(low, high) < CLEAR:
            return False
        others = [k[i + 1] - k[i] for i in range(f.size - 1) if i + 1 <= low or i >= high]
        alone = ALONE if rise(high, high + 1) < -SLOPE else FAR_ALONE
        return bool(k[high] - k[low] > alone * max(others, default=0.0))

    pairs = [(i, i + n) for n in range(1, APART + 1) for i in range(1, f.size - n - 1)]
    found = [pair for pair in pairs if is_pole(*pair)]
    if not found:
        return None
    low, high = max(found, key=lambda pair: k[pair[1]] - k[pair[0]])
    return StiffnessPole((float(f[low]), float(f[high])), (float(k[low]), float(k[high])))
