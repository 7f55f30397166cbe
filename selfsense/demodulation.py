"""Switching-noise demodulation (D 6.2): the gap from the ripple's amplitude alone, and what a moving duty does."""

from dataclasses import replace
from math import ceil, isfinite

import numpy as np
from numpy.typing import ArrayLike

from selfsense.coil import Coil
from selfsense.sensor import SelfSensor, samples_and_periods
from selfsense.simulate import simulate
from selfsense.supply import Acquisition, Supply

_SETTLED = 50  # of 1 / low_pass (Hz): both filters are at rest to 1e-12 by then


def ripple_amplitude(coil: Coil, supply: Supply, gap: ArrayLike, drive: ArrayLike = 0.0) -> np.ndarray:
    """Mean rectified ripple (A) of a coil without resistance at a gap (m) and a constant drive (-1 .. 1).

    Half of D eq 6.20: a ripple without its mean swings to both sides, D's has all its height on one. Shapes broadcast.
    """
    swing = 2.0 if supply.states == 2 else 1.0
    height = (
        swing
        * supply.voltage
        / supply.frequency
        * _duty_product(supply, drive)
        / coil.inductance(np.asarray(gap, dtype=float))
    )
    return height / 4


def path_factor(sensor: SelfSensor, drive: float = 0.0) -> float:
    """What the sampled forward path makes of the ripple: its settled output over `ripple_amplitude`.

    For the coil and the voltage that the estimator believes in, at the rest gap and a constant drive (-1 .. 1). It
    holds the filters' gain, the rectifier's few samples per period and the coil's resistance: 1.038 with the standard
    coil, the digital path and 10 samples per period. ValueError when that drive makes no ripple.
    """
    estimator = sensor.estimator
    supply = Supply(estimator.voltage, sensor.supply.frequency, sensor.supply.states)
    _check_drive(supply, drive)
    believed = replace(sensor, coil=estimator.coil, supply=supply, acquisition=Acquisition(sensor.acquisition.rate))
    cycle, _ = samples_and_periods(believed)
    samples = ceil(_SETTLED / estimator.path.low_pass * sensor.acquisition.rate) + cycle
    amplitude = simulate([believed], np.full(samples, sensor.gap), drive).amplitude[0, -cycle:].mean()
    return float(amplitude / ripple_amplitude(estimator.coil, supply, sensor.gap, drive))


def demodulated_gap(amplitude: ArrayLike, sensor: SelfSensor, drive: float = 0.0) -> np.ndarray:
    """Gap (m) from the amplitude (A) behind the forward path, as if the drive (-1 .. 1) never changed.

    The calibration is that of what the estimator believes at the sensor's rest gap (`path_factor`); the coil's
    resistance bends it by 0.3 % of a gap of 0.5 mm for the standard coil. Shape of amplitude. ValueError when the drive
    makes no ripple.
    """
    coil = sensor.estimator.coil
    supply = Supply(sensor.estimator.voltage, sensor.supply.frequency, sensor.supply.states)
    # The ripple is proportional to core_length + 2 gap, which is twice the gap plus half the core.
    per_gap = path_factor(sensor, drive) * ripple_amplitude(coil, supply, sensor.gap, drive)
    per_gap = per_gap / (sensor.gap + coil.core_length / 2)
    return np.asarray(amplitude, dtype=float) / per_gap - coil.core_length / 2


def demodulation_error(
    gap: ArrayLike, coil: Coil, supply: Supply, drive: ArrayLike, assumed: float = 0.0
) -> np.ndarray:
    """How far (m) the demodulated gap lies above the gap when the drive is not the one assumed.

    From the factor alpha (1 - alpha) of D eq 6.20; two states, half assumed: -(gap + core_length / 2) drive^2. A path
    adds what its high-pass and its few samples make of another shape: with D's corners, 0.7 % of the gap at a duty of
    0.6 and 100 samples per PWM period, up to 5 % at 10 samples. Shapes broadcast. ValueError when the assumed drive
    makes no ripple.
    """
    _check_drive(supply, assumed)
    ratio = _duty_product(supply, drive) / _duty_product(supply, assumed)
    return (ratio - 1) * (np.asarray(gap, dtype=float) + coil.core_length / 2)


def duty_swing(frequency: float, inductance: float, current: float, voltage: float) -> float:
    """Swing of the duty about one half that drives a current (A, peak) at a frequency (Hz): alpha_m of D eq 6.25.

    inductance H, voltage V of the supply; two states, resistance neglected. The drive swings by twice as much.
    ValueError above one half, where the supply cannot follow.
    """
    swing = np.pi * frequency * inductance * current / voltage
    if not 0 <= swing <= 0.5:
        raise ValueError(
            f"duty_swing: {current:g} A at {frequency:g} Hz through {inductance:g} H asks {voltage:g} V for a swing of "
            f"{swing:.3g}, outside 0 .. 0.5; lower the current or the frequency, or raise the voltage"
        )
    return float(swing)


def _duty_product(supply: Supply, drive: ArrayLike) -> np.ndarray:
    """alpha (1 - alpha), alpha the share of a PWM period at the upper level."""
    drive = np.asarray(drive, dtype=float)
    alpha = (1 + drive) / 2 if supply.states == 2 else np.abs(drive)
    return alpha * (1 - alpha)


def _check_drive(supply: Supply, drive: float) -> None:
    if not isfinite(drive) or abs(drive) > 1 or not _duty_product(supply, drive) > 0:
        raise ValueError(
            f"demodulation: with {supply.states} states a drive of {drive!r} leaves no ripple to demodulate; "
            f"assume one inside {'-1 .. 1' if supply.states == 2 else '0 .. 1, ends excluded'}"
        )
