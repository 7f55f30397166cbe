"""Levels at which a recorded displacement rests, and what a sensor reads there."""

import numpy as np

from selfsense.validity import SETTLING

_STILL = 0.01  # of the whole travel: so little a displacement may scatter within a piece of time that counts as a step
_LEVELS = 50  # told apart over the whole travel


def static_steps(displacement: np.ndarray, output: np.ndarray, rate: float) -> tuple[np.ndarray, np.ndarray]:
    """Displacement and output (n,), means over the pieces of time in which the displacement (samples,) hardly moves.

    rate: Hz. Pieces last as long as a sensor needs to settle; the first after a move is left out. Pieces within 2 % of
    the travel are one step. A slow ramp counts as steps, noise and fast motion do not: n is then 0 or small.
    """
    piece = max(2, round(SETTLING * rate))
    n = displacement.size // piece
    x, y = (a[: n * piece].reshape(n, piece) for a in (displacement, output))
    travel = float(np.ptp(displacement))
    still = (x.std(axis=1) <= _STILL * travel) if travel > 0 else np.zeros(n, dtype=bool)
    still &= np.concatenate([[False], still[:-1]])
    if not still.any():
        return np.empty(0), np.empty(0)
    level, read = x[still].mean(axis=1), y[still].mean(axis=1)
    group = np.round((level - displacement.min()) / travel * _LEVELS)
    steps = np.unique(group)
    return tuple(np.array([values[group == g].mean() for g in steps]) for values in (level, read))
