"""What lies between a physical quantity and its logged channel, outside the control loop: low-passes and a delay."""

from collections.abc import Sequence

import numpy as np
import scipy

LARGEST_GAIN = 30.0  # of the correction: beyond it, a low-pass has left nothing but noise


def corrected(values: np.ndarray, rate: float, filters: Sequence[float], delay: float) -> np.ndarray:
    """A channel (samples,) as it was before the chain: low-passes undone, and advanced by the delay.

    The correction acts on the spectrum of the channel continued by its mirror image, less a straight line, so that its
    ends stay in place. Its gain is limited to LARGEST_GAIN.

    Args:
        values: (samples,).
        rate: Hz.
        filters: corner frequencies of first-order low-passes, Hz.
        delay: s.
    """
    if not filters and not delay:
        return values
    n = values.size
    line = np.linspace(values[0], values[-1], n)
    rest = values - line
    whole = np.concatenate([rest, -rest[::-1]])  # odd: continuous at both ends
    frequency = np.fft.rfftfreq(2 * n, 1 / rate)
    gain = np.exp(2j * np.pi * frequency * delay)
    for corner in filters:
        gain = gain * (1 + 1j * frequency / corner)
    gain *= np.minimum(1.0, LARGEST_GAIN / np.abs(gain))
    late = delay + sum(1 / (2 * np.pi * corner) for corner in filters)  # a straight line comes late by this much
    slope = (values[-1] - values[0]) / max(n - 1, 1) * rate
    return np.asarray(scipy.fft.irfft(scipy.fft.rfft(whole) * gain, 2 * n))[:n] + line + late * slope
