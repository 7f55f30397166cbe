"""Choice of multisine lines for a spinning rotor: those clear of every harmonic of the rotation frequency."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray


def lines_off_spin(
    lines: ArrayLike,
    fundamental: float,
    speeds_rpm: Sequence[float | tuple[float, float]],
    harmonics: ArrayLike,
    clearance_hz: float,
    least: int = 10,
) -> NDArray[np.int64]:
    """Lines that keep at least clearance_hz from every harmonic of the rotation frequency, at all given speeds.

    Args:
        lines: Harmonic numbers (n,) of the fundamental.
        fundamental: Fundamental frequency, Hz.
        speeds_rpm: Speeds in rpm; a pair (low, high) stands for all speeds between.
        harmonics: Orders of the rotation frequency; 0.5 for a half-speed whirl.
        clearance_hz: Smallest distance, Hz. One over the block's length lets `estimation.lines.spin` separate lines and
            harmonics at little cost in noise.
        least: Smallest number of lines that must remain.

    Raises:
        ValueError: A value does not fit, or fewer than `least` lines remain; the message then names the speeds and
            the lines that each removes.
    """
    lines, orders = np.asarray(lines), np.asarray(harmonics, dtype=float)
    if lines.ndim != 1 or lines.size == 0 or not np.issubdtype(lines.dtype, np.integer) or lines.min() < 1:
        raise ValueError("lines off spin: lines must be a non-empty one-dimensional sequence of positive integers")
    if not (np.isfinite(fundamental) and fundamental > 0):
        raise ValueError(f"lines off spin: fundamental = {fundamental} Hz must be positive")
    if orders.ndim != 1 or orders.size == 0 or not np.all(np.isfinite(orders) & (orders > 0)):
        raise ValueError(f"lines off spin: harmonics = {harmonics} must be positive orders, at least one")
    if not (np.isfinite(clearance_hz) and clearance_hz >= 0):
        raise ValueError(f"lines off spin: clearance_hz = {clearance_hz} must be at least 0")
    frequency = lines * fundamental
    taken = np.array([_taken(frequency, speed, orders, clearance_hz) for speed in speeds_rpm])
    if not len(taken):
        raise ValueError("lines off spin: speeds_rpm is empty; give the speeds of interest")
    kept = lines[~taken.any(axis=0)]
    if kept.size < least:
        raise ValueError(
            f"lines off spin: {kept.size} of {lines.size} lines stay {clearance_hz:g} Hz clear of the spin, {least} "
            f"are needed; {_who_takes(taken, speeds_rpm, lines)}. Excite more lines, of a lower fundamental, or allow "
            "fewer speeds or less clearance"
        )
    return kept.astype(np.int64)


def _taken(
    frequency: np.ndarray, speed: float | tuple[float, float], orders: np.ndarray, clearance: float
) -> np.ndarray:
    ends = np.atleast_1d(np.asarray(speed, dtype=float))
    if ends.shape not in ((1,), (2,)) or not np.all(np.isfinite(ends)) or ends[0] <= 0 or ends[-1] < ends[0]:
        raise ValueError(f"lines off spin: speed {speed} rpm must be a positive number or (low, high)")
    low, high = ends[0] / 60 * orders[:, None], ends[-1] / 60 * orders[:, None]
    distance = np.maximum(np.maximum(low - frequency, frequency - high), 0.0)
    # A line exactly at the clearance must not be lost to rounding; a line on a harmonic is lost even at zero clearance.
    return np.any(distance <= 1e-9 * frequency, axis=0) | np.any(distance < clearance - 1e-9 * frequency, axis=0)


def _who_takes(taken: np.ndarray, speeds: Sequence[float | tuple[float, float]], lines: np.ndarray) -> str:
    parts = []
    for row, speed in zip(taken, speeds, strict=True):
        name = " to ".join(f"{s:g}" for s in np.atleast_1d(speed))
        which = lines[row]
        shown = ", ".join(map(str, which[:10])) + (f" and {which.size - 10} more" if which.size > 10 else "")
        parts.append(f"{name} rpm takes {'lines ' + shown if which.size else 'none'}")
    return "; ".join(parts)
