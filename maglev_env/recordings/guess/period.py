"""Whether a signal repeats, after how many samples, and which lines it holds."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import scipy

_MOST = 1 << 20  # samples that are looked at
_LEAST = 0.8  # correlation of a signal with itself one period later
_SIGNIFICANT = 6.0  # standard deviations of a line's mean
_STRONG = 0.01  # of the strongest line
_MOST_LINES = 5000


@dataclass(frozen=True)
class Lines:
    """The lines of a periodic signal.

    Args:
        harmonics: harmonic numbers, increasing.
        phasors: of each, complex, in the signal's unit.
        period: in samples.
        periods: whole periods in the record.
    """

    harmonics: tuple[int, ...]
    phasors: tuple[complex, ...]
    period: int
    periods: int

    def peak(self, harmonics: Sequence[int]) -> float:
        """The largest value of some of these lines together over a period, as the format states a multisine's."""
        spectrum = np.zeros(self.period // 2 + 1, complex)
        for harmonic, phasor in zip(self.harmonics, self.phasors, strict=True):
            spectrum[harmonic] = phasor if harmonic in harmonics else 0.0
        return float(np.abs(np.fft.irfft(spectrum, self.period)).max()) * self.period / 2


def period_of(values: np.ndarray) -> tuple[int, float] | None:
    """Samples after which a signal repeats.

    Args:
        values: the signal (samples,).

    Returns:
        The period and the correlation of the signal with itself one period later; None where it does not repeat, or
        fewer than two whole periods are there.
    """
    values = values[:_MOST] - values[:_MOST].mean()
    n, power = values.size, float(values @ values)
    if n < 16 or not power > 0:
        return None
    size = scipy.fft.next_fast_len(2 * n, real=True)
    spectrum = np.fft.rfft(values, size)
    products = np.fft.irfft(np.abs(spectrum) ** 2, size)[: n // 2 + 1]
    # The powers of both overlapping parts, so that a stretch of rest at one end does not look like a repetition.
    running = np.concatenate([[0.0], np.cumsum(values**2)])
    lags = np.arange(n // 2 + 1)
    both = np.sqrt(np.maximum(running[n - lags] * (running[n] - running[lags]), 1e-300))
    alike = products / both
    fallen = np.flatnonzero(alike < 0.5)
    if not fallen.size:
        return None
    lags = lags[fallen[0] : -1]
    here = alike[fallen[0] : -1]
    local = (here >= alike[lags - 1]) & (here >= alike[lags + 1])
    lags, here = lags[local], here[local]
    if not lags.size or here.max() < _LEAST:
        return None
    # The shortest lag that is nearly as good as the best: multiples of a period are as good as itself.
    good = 1 - here <= 3 * (1 - here.max()) + 1e-6
    period = int(lags[np.argmax(good)])
    return period, float(here[np.argmax(good)])


def lines_of(values: np.ndarray, period: int) -> Lines:
    """The lines of a signal that repeats.

    Args:
        values: the signal (samples,), two whole periods of it at least.
        period: in samples.

    Returns:
        Lines that stand out of what differs between periods, and are not far below the strongest.
    """
    count = values.size // period
    whole = values[values.size - count * period :].reshape(count, period)
    steady = whole[1:] if count > 2 else whole
    spectra = np.fft.rfft(steady, axis=1)[:, 1 : (period - 1) // 2 + 1] * (2 / period)
    phasors = spectra.mean(axis=0)
    amplitude = np.abs(phasors)
    noise = np.sqrt(spectra.var(axis=0, ddof=1) / len(steady)) if len(steady) > 1 else np.zeros_like(amplitude)
    strong = (amplitude > _SIGNIFICANT * noise) & (amplitude > _STRONG * amplitude.max())
    chosen = np.flatnonzero(strong)
    if chosen.size > _MOST_LINES:
        chosen = np.sort(chosen[np.argsort(amplitude[chosen])[-_MOST_LINES:]])
    return Lines(tuple(int(k) + 1 for k in chosen), tuple(complex(p) for p in phasors[chosen]), period, count)


def strongest_line(values: np.ndarray) -> float:
    """Frequency of a signal's (samples,) strongest vibration, in cycles per sample, also between spectral lines."""
    values = values[:_MOST]
    power = np.abs(np.fft.rfft((values - values.mean()) * np.hanning(values.size)))
    top = int(np.argmax(power[1:-1])) + 1
    left, here, right = np.log(np.maximum(power[top - 1 : top + 2], 1e-300))
    bend = left - 2 * here + right
    return float(top + ((left - right) / (2 * bend) if bend else 0.0)) / values.size
