"""What lies between a physical quantity and its logged channel, outside the control loop: filters and a delay.

A sampled channel holds what the quantity does above half the rate, folded in. Where nothing is known of that, a
low-pass is undone by its response at the frequency of a line. A current that lags behind a command held from sample to
sample is known between its samples too: its low-pass is undone by the ratio of the two sampled responses, exactly.
"""

from collections.abc import Sequence

import numpy as np
import scipy

from maglev_env.rig.rig import Rig

LARGEST_GAIN = 30.0  # of the correction: beyond it, a low-pass has left nothing but noise


def corrected(
    values: np.ndarray, rate: float, filters: Sequence[float], delay: float, held: float | None = None
) -> np.ndarray:
    """A channel (samples,) as it was before the chain: low-passes undone, and advanced by the delay.

    The correction acts on the spectrum of the channel continued by its mirror image, less a straight line, so that its
    ends stay in place. Its gain is limited to LARGEST_GAIN.

    Args:
        values: (samples,).
        rate: Hz.
        filters: corner frequencies of first-order low-passes, Hz.
        delay: s.
        held: time constant (s) of the first-order lag with which the quantity follows what is held between samples;
            None: nothing is known of it between them.
    """
    if not filters and not delay:
        return values
    n = values.size
    line = np.linspace(values[0], values[-1], n)
    rest = values - line
    whole = np.concatenate([rest, -rest[::-1]])  # odd: continuous at both ends
    frequency = np.fft.rfftfreq(2 * n, 1 / rate)
    gain = np.exp(2j * np.pi * frequency * delay) * _undone(frequency, rate, filters, held)
    gain *= np.minimum(1.0, LARGEST_GAIN / np.abs(gain))
    slow = 1e-4 * rate  # a straight line comes late by what a slow sine does
    late = delay + float(np.angle(_undone(np.array([slow]), rate, filters, held))[0]) / (2 * np.pi * slow)
    slope = (values[-1] - values[0]) / max(n - 1, 1) * rate
    return np.asarray(scipy.fft.irfft(scipy.fft.rfft(whole) * gain, 2 * n))[:n] + line + late * slope


def coupled(values: np.ndarray, rate: float, corners: Sequence[float]) -> np.ndarray:
    """A channel (samples,) as it was before it was coupled by first-order high-passes, as of an oscilloscope or a
    piezoelectric sensor.

    What the zero of what follows the coupling hides is left out: mean and trend, and a parabola behind two high-passes.

    Args:
        values: (samples,).
        rate: Hz.
        corners: corner frequencies, Hz.
    """
    for corner in corners:  # x' = y' - w x, so y = x + w times the integral of x
        whole = scipy.integrate.cumulative_trapezoid(values, dx=1 / rate, initial=0.0)
        values = values + 2 * np.pi * corner * whole
    if not corners:
        return values
    at = np.linspace(-1.0, 1.0, values.size)
    return values - np.polynomial.Polynomial.fit(at, values, len(corners))(at)


def _undone(frequency: np.ndarray, rate: float, filters: Sequence[float], held: float | None) -> np.ndarray:
    """Factor (n,) on the lines of a sampled channel that undoes low-passes, at frequencies in Hz."""
    if held is None:
        return np.prod([1 + 1j * frequency / corner for corner in filters], axis=0) + 0 * frequency
    lag = [1 / held]
    return _sampled(frequency, rate, lag) / _sampled(frequency, rate, [*lag, *(2 * np.pi * f for f in filters)])


def _sampled(frequency: np.ndarray, rate: float, corners: Sequence[float]) -> np.ndarray:
    """Response (n,) of first-order lags in a row (corners in 1/s) from what is held between samples to the samples."""
    chain = scipy.signal.zpk2ss([], [-c for c in corners], np.prod(corners))
    numerator, denominator = scipy.signal.ss2tf(*scipy.signal.cont2discrete(chain, 1 / rate)[:4])
    return scipy.signal.freqz(numerator[0], denominator, 2 * np.pi * frequency / rate)[1]


def lagless(rig: Rig) -> bool:
    """Whether a rig states that its amplifier has no lag. One that leaves the time constant out does not say so."""
    return not rig.amplifier_time_constant and rig.tolerance.get("amplifier_time_constant") == 0.0
