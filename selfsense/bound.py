"""Accuracy limit of a gap reading: the Cramer-Rao bound of the ripple, and how close the estimator comes to it.

A reading is i_k = s_k(gap) + slow current + noise, where s is the ripple at a known switching voltage. Over a window of
N samples, with the unknown mean and slope of the slow current projected out, the information on a constant gap is
N P / sigma^2, where P is the mean square of ds/dgap. Averaged over N = rate T samples, a bandwidth of 1 / (2 T), this
is a white gap noise of 2 sigma^2 / (rate P) m^2/Hz, one-sided. An estimator that weights sample k by w_k moves by h,
the sum of w ds/dgap over a PWM period, per period of changed gap. Its variance is sigma^2 sum w^2, which is at least
sigma^2 sum h^2 / (P samples per period) by Cauchy's inequality: the same noise times the integral of its tracking
|T|^2, which is its noise bandwidth.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import ceil, isfinite

import numpy as np
from numpy.typing import ArrayLike

from selfsense.demodulation import demodulated_gap
from selfsense.forward_path import response, unit_circle
from selfsense.linear import controller_response, linearise, stable
from selfsense.sensor import SelfSensor, samples_and_periods
from selfsense.simulate import simulate

STEADY = 0.01  # s until the ripple is steady
LEAST_RIPPLE = 1e-9  # A
LINES = 2000  # frequencies of the noise bandwidth's integral


@dataclass(frozen=True)
class NoisePoint:
    """The estimator at one resolution and noise level beside its bound; all errors in m.

    Attributes:
        bits: Resolution of the converter; 0 for an ideal one.
        noise: A rms.
        bound: Bound on the rms error at the estimator's noise bandwidth.
        rms: Deviation from the run without noise and converter.
        bias: Mean of that deviation.
        total: Rms deviation from the true gap, including lag and switching ripple.
        demodulator: Rms deviation of `demodulated_gap` on the same readings, at its own noise bandwidth.
    """

    bits: int
    noise: float
    bound: float
    rms: float
    bias: float
    total: float
    demodulator: float

    @property
    def ratio(self) -> float:
        """rms over bound."""
        return self.rms / self.bound


def ripple_sensitivity(sensor: SelfSensor, drive: float = 0.0) -> np.ndarray:
    """Steady d current / d gap (A/m) at the samples (n,) of a cycle of whole PWM periods, without mean and slope.

    It comes from the simulated coil at two gaps around rest, so core, dead time and states are included. The slope is
    taken from one cycle to the next, as over a long window.

    Raises:
        ValueError: The supply makes no ripple at this drive.
    """
    cycle, _ = samples_and_periods(sensor)
    samples = cycle * (2 + ceil(STEADY * sensor.acquisition.rate / cycle))
    ideal = replace(sensor, acquisition=replace(sensor.acquisition, bits=0, noise=0.0))
    step = 1e-3 * sensor.gap
    ends = [replace(ideal, gap=sensor.gap + move) for move in (-step, step)]
    gap = np.repeat([[end.gap] for end in ends], samples, axis=1)
    low, high = simulate(ends, gap, drive).current[:, -2 * cycle :]
    before, last = ((high - low) / (2 * step)).reshape(2, cycle)
    sensitivity = last - np.mean(last - before) * np.arange(cycle) / cycle
    sensitivity -= sensitivity.mean()
    if np.abs(sensitivity).max() * sensor.gap < LEAST_RIPPLE:
        raise ValueError(f"drive = {drive}: the supply makes no ripple there that could tell a gap; choose another")
    return sensitivity


def cramer_rao_density(sensor: SelfSensor, drive: float = 0.0) -> float:
    """Lowest noise density (m/sqrt(Hz), one-sided) of an unbiased gap estimate at a constant drive.

    `Acquisition.reading_noise` is treated as white and normal.

    Raises:
        ValueError: As `ripple_sensitivity`.
    """
    power = np.mean(ripple_sensitivity(sensor, drive) ** 2)
    return float(sensor.acquisition.reading_noise * np.sqrt(2 / (sensor.acquisition.rate * power)))


def cramer_rao_rms(sensor: SelfSensor, noise_bandwidth: float, drive: float = 0.0) -> float:
    """Lowest rms error (m) of an unbiased gap estimate at a noise bandwidth (Hz, one-sided).

    Raises:
        ValueError: The bandwidth is not positive, or as `cramer_rao_density`.
    """
    if not (isfinite(noise_bandwidth) and noise_bandwidth > 0):
        raise ValueError(f"noise_bandwidth = {noise_bandwidth} Hz must be a positive number")
    return cramer_rao_density(sensor, drive) * float(np.sqrt(noise_bandwidth))


def noise_bandwidth(sensor: SelfSensor, drive: float = 0.0) -> float:
    """Noise bandwidth (Hz, one-sided) of the estimator: the integral of |T|^2 up to half the PWM frequency.

    T is the response to the effect of the gap on the ripple. The effect of motion on a standing current also leaks
    through the high-pass; at a drive of 0.6 it would double the integral. The bound counts it as slow current. Above
    half the PWM frequency a gap cannot be distinguished from its image. Core losses are left out.

    Raises:
        ValueError: The estimator is unstable, or as `linear.linearise`.
    """
    if not stable(sensor, drive):
        raise ValueError(f"estimator: unstable at a drive of {drive}, its noise grows without end; lower kp and ki")
    linear = linearise(sensor, drive)
    parts = ("by_gap", "by_last_gap", "direct")
    ripple = replace(linear, **{name: getattr(linear, name) - getattr(linear, name).mean() for name in parts})
    frequency = (np.arange(LINES) + 0.5) * (sensor.supply.frequency / 2 / LINES)
    controller = controller_response(sensor.estimator.kp, sensor.estimator.ki, linear.rate, frequency)
    tracking = controller * ripple.coil(frequency) / (1 + controller * linear.forward(frequency))
    return float(np.mean(np.abs(tracking) ** 2) * sensor.supply.frequency / 2)


def forward_path_cost(sensor: SelfSensor, drive: float = 0.0) -> float:
    """Noise of the estimator's forward path over the bound, at low frequency and small noise; 1 for a matched filter.

    A rectifier weights samples by the sign of the filtered ripple, a true rms by the filtered ripple itself, both
    passed back through the filters. The core is taken as free of losses.

    Raises:
        ValueError: As `ripple_sensitivity`.
    """
    slope = ripple_sensitivity(sensor, drive)
    # The ripple has the same shape as its slope, because the gap only scales it.
    filters = response(sensor.estimator.path.sections(sensor.acquisition.rate)[0], unit_circle(slope.size))
    filtered = np.fft.ifft(filters * np.fft.fft(slope)).real
    weight = filtered if sensor.estimator.path.rms else np.sign(filtered)
    weight = np.fft.ifft(np.conj(filters) * np.fft.fft(weight)).real
    return float(np.sqrt((weight**2).sum() * (slope**2).sum()) / (weight @ slope))


def noise_sweep(
    sensor: SelfSensor,
    bits: Sequence[int],
    noises: Sequence[float],
    drive: float = 0.0,
    amplitude: float = 50e-6,
    frequency: float = 100.0,
    seeds: int = 4,
    seed: int = 0,
) -> list[NoisePoint]:
    """Simulate the estimator along a sine of the gap, at every resolution and every noise level, bits first.

    Two periods, rounded to whole samples, are evaluated after a first one.

    Args:
        sensor: The sensor.
        bits: Resolutions.
        noises: Noise levels, A.
        drive: Constant drive.
        amplitude: Amplitude of the gap, m.
        frequency: Frequency of the gap, Hz.
        seeds: Number of runs per point.
        seed: Seed of their noise.

    Raises:
        ValueError: A point has neither noise nor a converter, seeds or frequency is not positive, or a value is out of
            the range of `Acquisition`, `simulate` or `noise_bandwidth`.
    """
    if not 0 < frequency <= sensor.supply.frequency / 10:
        raise ValueError(f"frequency = {frequency} Hz must be positive and at most a tenth of the PWM frequency")
    if seeds < 1:
        raise ValueError(f"seeds = {seeds}: at least one run is needed")
    points = [(b, noise) for b in bits for noise in noises]
    if (0, 0.0) in points:
        raise ValueError("bits = 0 with noise = 0: an ideal reading has no bound; leave that point out")
    period = round(sensor.acquisition.rate / frequency)
    gap = sensor.gap + amplitude * np.sin(2 * np.pi * np.arange(1, 3 * period + 1) / period)
    noisy = [replace(sensor, acquisition=replace(sensor.acquisition, bits=b, noise=noise)) for b, noise in points]
    quiet = simulate([replace(sensor, acquisition=replace(sensor.acquisition, bits=0, noise=0.0))], gap, drive)
    bandwidth = noise_bandwidth(sensor, drive)
    table = []
    for i, one in enumerate(noisy):
        sensed = simulate([one] * seeds, gap, drive, seed=seed + 1000 * i)
        change = (sensed.estimate - quiet.estimate)[:, period:]
        demodulated = demodulated_gap(np.concatenate([sensed.amplitude, quiet.amplitude]), sensor, drive)[:, period:]
        table.append(
            NoisePoint(
                bits=one.acquisition.bits,
                noise=one.acquisition.noise,
                bound=cramer_rao_rms(one, bandwidth, drive),
                rms=_rms(change),
                bias=float(change.mean()),
                total=_rms((sensed.estimate - gap)[:, period:]),
                demodulator=_rms(demodulated[:-1] - demodulated[-1]),
            )
        )
    return table


def _rms(values: ArrayLike) -> float:
    return float(np.sqrt(np.mean(np.square(values))))
