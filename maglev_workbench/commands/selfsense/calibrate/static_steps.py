"""Levels at which a recorded displacement rests, and a sensor's reading at these levels."""

import numpy as np

from selfsense.validity import SETTLING

_STILL = 0.02  # largest scatter of the displacement within a step, as a share of the whole travel
_APART = 0.02  # smallest distance of two different steps, as a share of the whole travel


def static_steps(displacement: np.ndarray, output: np.ndarray, rate: float) -> tuple[np.ndarray, np.ndarray]:
    """Displacement and output (n,), means over the pieces of time in which the displacement (samples,) hardly moves.

    Pieces last as long as a sensor needs to settle. Those next to a motion are left out, and those within 2 % of the
    travel are one step. A slow ramp counts as steps; noise and fast motion do not, so that n is 0 or small.

    Args:
        displacement: (samples,).
        output: (samples,).
        rate: sample rate, Hz.
    """
    piece = max(2, round(SETTLING * rate))
    n = displacement.size // piece
    if n < 3:  # each piece has a motion before or behind it
        return np.empty(0), np.empty(0)
    x, y = (a[: n * piece].reshape(n, piece) for a in (displacement, output))
    travel = float(np.ptp(displacement))
    still = (x.std(axis=1) <= _STILL * travel) if travel > 0 else np.zeros(n, dtype=bool)
    still[1:-1] &= still[:-2] & still[2:]
    still[[0, -1]] = False
    if not still.any():
        return np.empty(0), np.empty(0)
    level, read = x[still].mean(axis=1), y[still].mean(axis=1)
    order = np.argsort(level)
    starts = [0]
    for i, value in enumerate(level[order]):
        if value - level[order[starts[-1]]] > _APART * travel:
            starts.append(i)
    groups = np.split(order, starts[1:])
    return tuple(np.array([values[group].mean() for group in groups]) for values in (level, read))
