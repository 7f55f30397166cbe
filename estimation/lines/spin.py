"""Line amplitudes of a block that also holds tones of the rotation, which need not fit whole turns into the block.

The lines and the rotation's harmonics are fitted together. If the rotation were fitted and subtracted alone, it would
absorb the leakage of the lines into its harmonics, a bias of the order of 1 / (pi times their distance in bins).
"""

from dataclasses import dataclass

import numpy as np
import scipy
from numpy.typing import ArrayLike

CLOSEST = 0.1  # bins; at a smaller distance the noise of a line would rise more than 30-fold
SPEED_STEPS = 20


@dataclass(frozen=True, eq=False)
class LinesBesideSpin:
    """Amplitudes are complex peak values with the cosine phase at the first sample.

    Attributes:
        amplitude: Amplitudes (..., n) of the lines.
        spin: Amplitudes (..., h) of the rotation's harmonics.
        inflation: Variance (n,) of a line's amplitude in white noise, relative to that of a block without rotation,
            4 s^2 / samples.
        noise: That variance E|n|^2 (..., n), from the residual.
    """

    amplitude: np.ndarray
    spin: np.ndarray
    inflation: np.ndarray
    noise: np.ndarray


def lines_beside_spin(
    samples: ArrayLike, rate: float, frequency: ArrayLike, spin_hz: float, harmonics: ArrayLike
) -> LinesBesideSpin:
    """Least squares of a constant, the lines and the rotation's harmonics; unbiased for rotation tones of any size.

    Args:
        samples: Blocks (..., samples).
        rate: Sampling rate, Hz.
        frequency: Frequencies (n,) of the lines, Hz.
        spin_hz: Rotation frequency, Hz; it must be known to a small part of a turn over the block (`spin_speed`).
        harmonics: Orders of the rotation frequency.

    Raises:
        ValueError: A tone lies within a tenth of a bin of another, or at or above half the rate.
    """
    samples, tones = _checked(samples, rate, frequency, spin_hz, harmonics)
    n, count = np.size(frequency), samples.shape[-1]
    design = _design(tones, count, rate)
    # At this distance of the tones the normal equations are well conditioned and much faster than a QR decomposition.
    normal = scipy.linalg.cho_factor(design.T @ design)
    projected = samples @ design
    found = scipy.linalg.cho_solve(normal, projected.reshape(-1, design.shape[1]).T).T.reshape(projected.shape)
    power = np.sum(samples**2, axis=-1) - np.sum(found * projected, axis=-1)
    each = np.diag(scipy.linalg.cho_solve(normal, np.eye(design.shape[1])))[1:]
    variance = each[: tones.size] + each[tones.size :]
    complex_ = found[..., 1 : 1 + tones.size] - 1j * found[..., 1 + tones.size :]
    noise = np.maximum(power, 0.0)[..., None] / (count - design.shape[1]) * variance[:n]
    return LinesBesideSpin(complex_[..., :n], complex_[..., n:], variance[:n] * count / 4, noise)


def spin_speed(samples: ArrayLike, rate: float, frequency: ArrayLike, spin_hz: float, harmonics: ArrayLike) -> float:
    """Rotation frequency in Hz, near spin_hz, that fits one block (samples,) best.

    Gauss-Newton search for the one frequency of all harmonics; unbalance or runout must stand out of the noise. The
    other arguments are those of `lines_beside_spin`.

    Raises:
        ValueError: The fit leaves spin_hz by more than half a bin.
    """
    samples = np.asarray(samples, dtype=float)
    if samples.ndim != 1:
        raise ValueError(f"spin speed: samples have the shape {samples.shape}; give one block (samples,)")
    n, count, speed = np.size(frequency), samples.shape[-1], float(spin_hz)
    orders = np.asarray(harmonics, dtype=float)
    t = np.arange(count) / rate
    for _ in range(SPEED_STEPS):
        _, tones = _checked(samples, rate, frequency, speed, harmonics)
        design = _design(tones, count, rate)
        normal = scipy.linalg.cho_factor(design.T @ design)
        found = scipy.linalg.cho_solve(normal, samples @ design)
        cosines, sines = found[1 : 1 + tones.size][n:], found[1 + tones.size :][n:]
        cos, sin = design[:, 1 : 1 + tones.size][:, n:], design[:, 1 + tones.size :][:, n:]
        slope = 2 * np.pi * t * (cos @ (sines * orders) - sin @ (cosines * orders))
        slope -= design @ scipy.linalg.cho_solve(normal, slope @ design)
        step = (slope @ samples) / (slope @ slope)
        speed += step
        if not abs(speed - spin_hz) < rate / count / 2:
            raise ValueError(
                f"spin speed: no speed within half a bin ({rate / count / 2:g} Hz) of {spin_hz:g} Hz fits; give a "
                "nearer one, or leave out harmonics that do not stand out"
            )
        if abs(step) < 1e-10 * speed:
            break
    return speed


def _design(tones: np.ndarray, count: int, rate: float) -> np.ndarray:
    turn = 2 * np.pi * np.outer(np.arange(count) / rate, tones)
    return np.hstack([np.ones((count, 1)), np.cos(turn), np.sin(turn)])


def _checked(
    samples: ArrayLike, rate: float, frequency: ArrayLike, spin_hz: float, harmonics: ArrayLike
) -> tuple[np.ndarray, np.ndarray]:
    samples, f = np.asarray(samples, dtype=float), np.asarray(frequency, dtype=float)
    orders = np.asarray(harmonics, dtype=float)
    if samples.ndim == 0 or not np.all(np.isfinite(samples)):
        raise ValueError(f"lines beside spin: samples {samples.shape} must be finite blocks (..., samples)")
    for name, value in (("rate", rate), ("spin_hz", spin_hz)):
        if not (np.isfinite(value) and value > 0):
            raise ValueError(f"lines beside spin: {name} = {value} must be positive, in Hz")
    for name, values in (("frequency", f), ("harmonics", orders)):
        if values.ndim != 1 or values.size == 0 or not np.all(np.isfinite(values) & (values > 0)):
            raise ValueError(f"lines beside spin: {name} must be a non-empty sequence of positive numbers")
    tones, count = np.concatenate([f, spin_hz * orders]), samples.shape[-1]
    if count <= 2 * tones.size + 1:
        raise ValueError(f"lines beside spin: {count} samples do not hold {tones.size} tones; take longer blocks")
    if tones.max() >= rate / 2:
        raise ValueError(f"lines beside spin: {tones.max():g} Hz is not below half the rate, {rate / 2:g} Hz")
    order = np.sort(tones)
    bins = np.diff(order) * count / rate
    if bins.size and bins.min() < CLOSEST:
        a, b = order[bins.argmin()], order[bins.argmin() + 1]
        raise ValueError(
            f"lines beside spin: {a:g} and {b:g} Hz are {bins.min():.2g} bins apart, a block of {count / rate:g} s "
            "cannot part them; leave out the line (`lines_off_spin`) or take longer blocks"
        )
    return samples, tones
