"""Dynamic calibration of a gap sensor, recorded or simulated: its response and delay (D 6.3.2, 6.4.2.3)."""

from dataclasses import dataclass
from math import ceil

import numpy as np
import scipy
from numpy.typing import ArrayLike

from estimation.lines.frequency_response import frequency_response
from estimation.lines.periods import LineStatistics, line_statistics, period_spectra, split_periods
from estimation.multisine.sphs import harmonic_range, sphs, synthesise
from selfsense.sensor import SelfSensor
from selfsense.simulate import simulate
from selfsense.validity import SETTLING, refuse_invalid


@dataclass(frozen=True)
class DynamicCalibration:
    """Response of an estimate to a displacement at n lines. The errors contain noise, not what repeats every period.

    Attributes:
        frequency: Hz, (n,).
        response: Complex, (n,).
        standard_error: Root of E|n|^2, (n,).
        polarity: 1, or -1 where the estimate falls with the displacement.
        delay: Best-fitting pure delay, less than half a period, s.
        delay_se: Its standard error.
        delay_low: Its lower 95 % bound.
        delay_high: Its upper 95 % bound.
        gain: Magnitude at the three lowest lines, or the lowest hundredth of them.
        bandwidth: Frequency at which the response is 3 dB below the gain, Hz; inf where no line shows it.
    """

    frequency: np.ndarray
    response: np.ndarray
    standard_error: np.ndarray
    polarity: int
    delay: float
    delay_se: float
    delay_low: float
    delay_high: float
    gain: float
    bandwidth: float

    def lag(self, frequency: ArrayLike) -> tuple[np.ndarray, np.ndarray]:
        """Phase lag (rad) at frequencies (Hz) and its standard error, interpolated between lines; shape of frequency.

        Raises:
            ValueError: A frequency is outside the measured lines.
        """
        at = np.asarray(frequency, dtype=float)
        first, last = self.frequency[[0, -1]]
        if not np.all((at >= first) & (at <= last)):
            raise ValueError(f"lag: {at} Hz is outside the lines measured, {first:g} .. {last:g} Hz")
        delayed = 2 * np.pi * self.frequency * self.delay
        phase = np.unwrap(np.angle(self.polarity * self.response * np.exp(1j * delayed))) - delayed
        error = self.standard_error / np.abs(self.response) / np.sqrt(2)
        return -np.interp(at, self.frequency, phase), np.interp(at, self.frequency, error)


def dynamic_calibration(
    displacement: ArrayLike, estimate: ArrayLike, rate: float, fundamental: float, lines: ArrayLike, periods: int
) -> DynamicCalibration:
    """Response of an estimate to a periodic displacement, from the last whole periods of a record.

    Args:
        displacement: (samples,).
        estimate: (samples,).
        rate: Hz.
        fundamental: Hz.
        lines: Harmonics that the displacement excites.
        periods: Number of last periods used, at least two; the samples before them are the transient.

    Raises:
        ValueError: The record is too short, a period is not a whole number of samples, a used sample is not finite, or
            a line is not excited.
    """
    signals = [np.asarray(s, dtype=float) for s in (displacement, estimate)]
    lines, per_period = np.asarray(lines), _samples_per_period(rate, fundamental, periods)
    if signals[0].ndim != 1 or signals[0].shape != signals[1].shape:
        raise ValueError(f"displacement {signals[0].shape} and estimate {signals[1].shape} must both be (samples,)")
    start = signals[0].size - periods * per_period
    if start < 0:
        raise ValueError(
            f"{periods} periods of {per_period} samples are asked of {signals[0].size} samples; record more or ask less"
        )
    if lines.ndim != 1 or not np.issubdtype(lines.dtype, np.integer) or np.any(np.diff(lines, prepend=0) <= 0):
        raise ValueError("lines must be rising whole numbers from 1 on: the harmonics that the displacement excites")
    if lines.size == 0 or 2 * lines[-1] >= per_period:
        raise ValueError(f"lines must be given, and lie below half of the {per_period} samples of a period")
    used = np.stack([s[start:] for s in signals])
    for name, values in zip(("displacement", "estimate"), used, strict=True):
        bad = np.flatnonzero(~np.isfinite(values))
        if bad.size:
            raise ValueError(
                f"{name}: sample {start + bad[0]} is {values[bad[0]]}; use periods without invalid samples"
            )
    spectra = (period_spectra(p, lines) for p in split_periods(used, per_period))
    return _calibrated(line_statistics(spectra, fundamental, lines, ("displacement", "estimate")))


def simulated_dynamic(
    sensor: SelfSensor,
    fundamental: float,
    top: float,
    amplitude: float,
    periods: int = 4,
    drive: float = 0.0,
    seed: int = 0,
) -> DynamicCalibration:
    """Dynamic calibration of a simulated sensor whose gap follows a Schroeder multisine (D 6.3.2).

    Periods are simulated side by side, each with its own noise. The estimate is kept at every sample: at one sample per
    PWM period, its ripple, which the motion modulates, would fold onto the lines (0.5 % at 4 kHz with the standard
    coil). One second at 250 kHz takes 150 MB for up to 16 periods.

    Args:
        sensor: The sensor.
        fundamental: Hz.
        top: Highest excited frequency, Hz; every harmonic up to it is excited.
        amplitude: Peak, m.
        periods: Number of periods.
        drive: Constant drive.
        seed: Seed of the noise.

    Raises:
        ValueError: The estimate cannot be trusted throughout.
    """
    rate = sensor.acquisition.rate
    per_period = _samples_per_period(rate, fundamental, periods)
    if abs(top / fundamental - round(top / fundamental)) > 1e-6:
        raise ValueError(f"top = {top:g} Hz is no multiple of the fundamental {fundamental:g} Hz; give one that is")
    lines = harmonic_range(1, round(top / fundamental))
    wave = synthesise(sphs(lines, per_period, amplitude), per_period)
    settling = ceil(SETTLING * rate)
    displacement = np.tile(wave, 2 + settling // per_period)[-settling - per_period :]
    sensors = [sensor] * periods
    sensed = simulate(sensors, sensor.gap + displacement, drive, seed=seed)
    refuse_invalid(sensed, sensors, settling)
    estimate = sensed.estimate[:, settling:].reshape(-1)
    return dynamic_calibration(np.tile(wave, periods), estimate, rate, fundamental, lines, periods)


def _calibrated(statistics: LineStatistics) -> DynamicCalibration:
    power = np.abs(statistics.amplitude("displacement")) ** 2
    if not power.min() > 0:
        raise ValueError(
            f"displacement: line {statistics.lines[np.argmin(power)]} holds nothing; leave it out of lines"
        )
    g, variance = frequency_response(statistics, "estimate", "displacement")
    w = 2 * np.pi * statistics.frequency
    delay, polarity = _correlation_peak(statistics.lines, power * g)
    delay /= statistics.frequency[0] / statistics.lines[0]
    # Least squares of G on e^(-j w delay), which is the peak of the correlation. It is linear in G, so a noisy line
    # causes no bias.
    upright, weight = polarity * g, w**2 * power
    for _ in range(10):
        turned = weight * upright * np.exp(1j * w * delay)
        delay -= np.sum(turned.imag / w) / np.sum(turned.real)
    parts = (weight / w) ** 2 * variance / 2
    delay_se = np.sqrt(parts.sum()) / np.sum((weight * upright * np.exp(1j * w * delay)).real)
    # Satterthwaite: every line's variance has 2 (P - 1) degrees of freedom.
    freedom = 2 * (statistics.periods - 1) * parts.sum() ** 2 / max(np.sum(parts**2), np.finfo(float).tiny)
    half = scipy.stats.t.ppf(0.975, max(freedom, 1.0)) * delay_se
    lowest = slice(max(3, g.size // 100))
    gain = float(np.abs(np.mean((upright * np.exp(1j * w * delay))[lowest])))
    error = np.sqrt(variance)
    return DynamicCalibration(
        statistics.frequency,
        g,
        error,
        polarity,
        float(delay),
        float(delay_se),
        float(delay - half),
        float(delay + half),
        gain,
        _bandwidth(statistics.frequency, np.abs(g), error, gain / np.sqrt(2)),
    )


def _correlation_peak(lines: np.ndarray, cross: np.ndarray) -> tuple[float, int]:
    """Delay, in periods from -1/2 to 1/2, at which the correlation of two signals peaks, and the sign of the peak.

    cross (n,) is conj(X) Y at the lines. The grid is a sixteenth of the highest line's period.
    """
    spectrum = np.zeros(8 * int(lines[-1]) + 1, complex)
    spectrum[lines] = cross
    correlation = np.fft.irfft(spectrum)
    peak = int(np.argmax(np.abs(correlation)))
    shift = peak / correlation.size
    return shift - (shift > 0.5), int(np.sign(correlation[peak]))


def _bandwidth(frequency: np.ndarray, magnitude: np.ndarray, error: np.ndarray, level: float) -> float:
    """First frequency (Hz) at which a magnitude falls below a level by more than its noise."""
    below = np.flatnonzero(magnitude + 2 * error < level)
    above = np.flatnonzero(magnitude[: below[0]] >= level) if below.size else below
    if not above.size:
        return float("inf")
    i, j = above[-1], above[-1] + 1
    return float(np.interp(-level, -magnitude[[i, j]], frequency[[i, j]]))


def _samples_per_period(rate: float, fundamental: float, periods: int) -> int:
    samples = round(rate / fundamental) if fundamental > 0 else 0
    if samples == 0 or abs(samples * fundamental / rate - 1) > 1e-9:
        raise ValueError(f"fundamental = {fundamental} Hz: its period is not a whole number of samples at {rate:g} Hz")
    if periods < 2:
        raise ValueError(f"periods = {periods}: two or more are needed for standard errors")
    return samples
