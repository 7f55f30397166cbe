"""Switching-noise demodulation (D 6.2): the gap from the ripple's amplitude alone, and the error of a moving duty."""

from dataclasses import replace
from math import ceil, isfinite

import numpy as np
from numpy.typing import ArrayLike

from selfsense.coil import Coil
from selfsense.sensor import SelfSensor, samples_and_periods
from selfsense.simulate import simulate
from selfsense.supply import Acquisition, Supply

_SETTLED = 50  # of 1 / low_pass (Hz); both filters have then settled to 1e-12


def ripple_amplitude(coil: Coil, supply: Supply, gap: ArrayLike, drive: ArrayLike = 0.0) -> np.ndarray:
    """Mean rectified ripple (A) of a coil without resistance, at a gap (m) and a constant drive (-1 .. 1).

    It is half of D eq 6.20, because a ripple without its mean swings to both sides and D counts its full height.
    Shapes broadcast.
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
    """Settled output of the sampled forward path over `ripple_amplitude`.

    It is computed for the coil and voltage that the estimator assumes, at the rest gap and a constant drive (-1 .. 1).
    It contains the filters' gain, the few samples per period of the rectifier, and the coil's resistance: 1.038 with
    the standard coil, the digital path and 10 samples per period.

    Raises:
        ValueError: This drive makes no ripple.
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
    """Gap (m) from the amplitude (A) behind the forward path, assuming a constant drive (-1 .. 1); shape of amplitude.

    The calibration uses what the estimator assumes at the sensor's rest gap (`path_factor`). The coil's resistance
    bends it by 0.3 % at a gap of 0.5 mm for the standard coil.

    Raises:
        ValueError: The drive makes no ripple.
    """
    coil = sensor.estimator.coil
    supply = Supply(sensor.estimator.voltage, sensor.supply.frequency, sensor.supply.states)
    # The ripple is proportional to core_length + 2 gap.
    per_gap = path_factor(sensor, drive) * ripple_amplitude(coil, supply, sensor.gap, drive)
    per_gap = per_gap / (sensor.gap + coil.core_length / 2)
    return np.asarray(amplitude, dtype=float) / per_gap - coil.core_length / 2


def demodulation_error(
    gap: ArrayLike, coil: Coil, supply: Supply, drive: ArrayLike, assumed: float = 0.0
) -> np.ndarray:
    """Distance (m) by which the demodulated gap exceeds the gap when the drive is not the assumed one.

    It follows from the factor alpha (1 - alpha) of D eq 6.20; for two states with half duty assumed it is
    -(gap + core_length / 2) drive^2. A forward path adds the effect of its high-pass and of few samples on another
    ripple shape: with D's corners, 0.7 % of the gap at a duty of 0.6 and 100 samples per PWM period, and up to 5 % at
    10 samples. Shapes broadcast.

    Raises:
        ValueError: The assumed drive makes no ripple.
    """
    _check_drive(supply, assumed)
    ratio = _duty_product(supply, drive) / _duty_product(supply, assumed)
    return (ratio - 1) * (np.asarray(gap, dtype=float) + coil.core_length / 2)


def duty_swing(frequency: float, inductance: float, current: float, voltage: float) -> float:
    """Swing of the duty about one half, alpha_m of D eq 6.25, that drives a current; the drive swings twice as much.

    Args:
        frequency: Hz.
        inductance: H.
        current: Peak, A.
        voltage: Voltage of a supply with two states, V; the resistance is neglected.

    Raises:
        ValueError: The swing exceeds one half, so the supply cannot follow.
    """
    swing = np.pi * frequency * inductance * current / voltage
    if not 0 <= swing <= 0.5:
        raise ValueError(
            f"duty_swing: {current:g} A at {frequency:g} Hz through {inductance:g} H asks {voltage:g} V for a swing of "
            f"{swing:.3g}, outside 0 .. 0.5; lower the current or the frequency, or raise the voltage"
        )
    return float(swing)


def _duty_product(supply: Supply, drive: ArrayLike) -> np.ndarray:
    """alpha (1 - alpha), where alpha is the share of a PWM period at the upper level."""
    drive = np.asarray(drive, dtype=float)
    alpha = (1 + drive) / 2 if supply.states == 2 else np.abs(drive)
    return alpha * (1 - alpha)


def _check_drive(supply: Supply, drive: float) -> None:
    if not isfinite(drive) or abs(drive) > 1 or not _duty_product(supply, drive) > 0:
        raise ValueError(
            f"demodulation: with {supply.states} states a drive of {drive!r} leaves no ripple to demodulate; "
            f"assume one inside {'-1 .. 1' if supply.states == 2 else '0 .. 1, ends excluded'}"
        )
