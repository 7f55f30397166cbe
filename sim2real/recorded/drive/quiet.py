"""The reading that a stand-in controller answers to: the recorded displacement without what is noise of its sensor.

A stand-in only keeps the simulated mass where the recorded one was. In a linear loop it does not matter what reading it
is given: what its answer adds to the drive is part of the command at which the loop is opened. The pull of a magnet is
no line: the current that a stand-in makes of 10 um of noise stiffens a pair by its square, and a fit takes that off the
stiffness of the rig. So it is given what of the displacement stands above the noise (N. Wiener, Extrapolation,
Interpolation, and Smoothing of Stationary Time Series, 1949).
"""

import numpy as np
import scipy.fft
from scipy.ndimage import uniform_filter1d

from estimation.lines.line_windows import NOISE_ALONE

MEDIAN = 0.4549  # of a chi-square of one degree of freedom
SMOOTHED = 41  # lines over which the power of the reading is averaged


def quiet(readings: np.ndarray) -> np.ndarray:
    """Readings (axes, samples) without white noise of the size that they have at their highest frequencies."""
    n = readings.shape[-1]
    spectrum = np.asarray(scipy.fft.rfft(np.concatenate([readings, readings[..., ::-1]], axis=-1), axis=-1))
    power = abs(spectrum) ** 2
    first, last = (int(2 * n * share) for share in NOISE_ALONE)
    # Mirrored white noise has lines of one phase, whose power is a chi-square of one degree of freedom. Its median is
    # not moved by a tone that stands there.
    noise = np.median(power[..., first:last], axis=-1, keepdims=True) / MEDIAN
    noise = np.maximum(noise, np.finfo(float).tiny)
    kept = 1 - noise / np.maximum(uniform_filter1d(power, SMOOTHED, axis=-1, mode="nearest"), noise)
    return np.asarray(scipy.fft.irfft(kept * spectrum, 2 * n, axis=-1))[..., :n]
