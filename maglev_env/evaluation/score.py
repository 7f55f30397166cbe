"""The score of a gain set: named terms in (0, 1], combined as a weighted geometric mean."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields

import numpy as np

WEIGHTS: Mapping[str, float] = {
    "stiffness": 0.30,
    "damping": 0.20,
    "peak_sensitivity": 0.30,
    "displacement": 0.10,
    "current": 0.05,
    "gap_sensing": 0.05,
}


@dataclass(frozen=True)
class ScoreTarget:
    """Reference values of the terms in N/m, N s/m, peak |S|, m, A rms and m; numbers, or arrays (n,)."""

    stiffness: float | np.ndarray
    damping: float | np.ndarray
    peak_sensitivity: float | np.ndarray
    clearance: float | np.ndarray
    current_limit: float | np.ndarray
    gap: float | np.ndarray


def stacked(targets: Sequence[ScoreTarget]) -> ScoreTarget:
    """n targets as one, with every field an array (n,)."""
    return ScoreTarget(*(np.array([getattr(t, f.name) for t in targets]) for f in fields(ScoreTarget)))


def terms(
    target: ScoreTarget,
    stiffness: np.ndarray,
    damping: np.ndarray,
    peak_sensitivity: np.ndarray,
    displacement: np.ndarray,
    current: np.ndarray,
    gap_error: np.ndarray | float = 0.0,
) -> dict[str, np.ndarray]:
    """Score terms in (0, 1], arrays of one shape. A stiffness or damping that is not positive gives 0.

    Args:
        target: Reference values.
        stiffness: Identified in the target band, N/m.
        damping: Identified in the target band, N s/m.
        peak_sensitivity: From the injection lines.
        displacement: Largest reading, m.
        current: Rms, A.
        gap_error: Rms of the sensed gap, m; 0 with a probe.
    """
    with np.errstate(invalid="ignore", divide="ignore"):
        return {
            "stiffness": _ratio_term(stiffness / target.stiffness, 0.1),
            "damping": _ratio_term(damping / target.damping, 0.2),
            "peak_sensitivity": 1 / (1 + (np.maximum(0.0, peak_sensitivity / target.peak_sensitivity - 1) / 0.2) ** 2),
            "displacement": 1 / (1 + (displacement / (0.3 * target.clearance)) ** 4),
            "current": 1 / (1 + (current / target.current_limit) ** 2),
            "gap_sensing": 1 / (1 + (gap_error / (0.02 * target.gap)) ** 2) + 0 * np.asarray(stiffness),
        }


def _ratio_term(ratio: np.ndarray, width: float) -> np.ndarray:
    """1 at ratio 1, one half where its logarithm is +-width, 0 for a ratio that is not positive."""
    log = np.log(np.where(ratio > 0, ratio, np.nan))
    return np.where(ratio > 0, 1 / (1 + (log / width) ** 2), np.where(np.isnan(ratio), np.nan, 0.0))


def score(terms: Mapping[str, np.ndarray]) -> np.ndarray:
    """exp(sum of w ln t), in [0, 1]; 0 where a term is 0 or unknown, as after a touchdown."""
    with np.errstate(divide="ignore"):
        total = sum(weight * np.log(terms[name]) for name, weight in WEIGHTS.items())
    return np.where(np.isnan(total), 0.0, np.exp(total))
