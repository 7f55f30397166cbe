"""Errors of the gap from wrong assumptions about coil and supply, for the parameter estimator and for demodulation.

Wrong constants shift and stretch the estimate, which a static calibration corrects. What bends the ripple remains: a
saturated core, whose slope changes with the current, and eddy currents, which jump at every edge. Samples locked to the
PWM (10 per period) see such a jump entirely or not at all as the duty moves; 10.5 per period average it.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from selfsense.sensor import SelfSensor, samples_and_periods
from selfsense.simulate import simulate

STEPS = 5  # resting gaps of a static calibration
PERIODS = 3  # periods of the motion; the first is not evaluated


@dataclass(frozen=True)
class MismatchErrors:
    """One mismatch: static errors at half duty, and errors along a moving gap while the duty moves.

    Attributes:
        name: Name of the mismatch.
        offset: Error at rest, m.
        expected_offset: The same by `expected_gap`.
        gain: Estimate over gap.
        expected_gain: The same by `expected_gap`.
        raw: Rms error of the estimate, m.
        estimator: Rms error of the estimator after calibration of offset and gain, at steps of the gap at half duty
            with the same mismatch, m.
        demodulator: The same of the demodulator, m.
        estimator_duty: Rms contribution of the moving duty alone, m: the difference from the same motion at half duty,
            calibrated in the same way, which excludes the lag behind the motion.
        demodulator_duty: The same of the demodulator, m.
    """

    name: str
    offset: float
    expected_offset: float
    gain: float
    expected_gain: float
    raw: float
    estimator: float
    demodulator: float
    estimator_duty: float
    demodulator_duty: float

    @property
    def suppression(self) -> float:
        """Rms error of the demodulator over that of the estimator, including lag."""
        return self.demodulator / self.estimator

    @property
    def duty_suppression(self) -> float:
        """The same ratio for the contribution of the duty alone."""
        return self.demodulator_duty / self.estimator_duty


def mismatches(
    sensor: SelfSensor,
    change: float = 0.2,
    lamination: float = 0.23e-3,
    saturation_field: float = 1.5,
    bias_field: float = 0.55,
    dead_time: float = 1e-6,
) -> dict[str, SelfSensor]:
    """The sensor as assumed, and with one unknown deviation at a time in its coil or supply.

    Args:
        sensor: The sensor.
        change: Relative change of supply voltage, resistance, pole area and core length, in both directions.
        lamination: Thickness of the sheets of a core with eddy currents, m.
        saturation_field: Saturation field of a core, T.
        bias_field: Field of the magnet in that core, T.
        dead_time: Dead time, s, which the estimator sees in the switching voltage.

    Raises:
        ValueError: The coil has no core, which eddy currents and saturation need.
    """
    coil, supply = sensor.coil, sensor.supply
    if coil.core_length == 0:
        raise ValueError("mismatches: coil.core_length = 0, and eddy currents and saturation need a core; give one")
    table = {"as believed": sensor}
    for sign, factor in (("+", 1 + change), ("-", 1 - change)):
        by = f"{sign}{change:.0%}"
        table[f"voltage {by}"] = replace(sensor, supply=replace(supply, voltage=supply.voltage * factor))
        for name in ("resistance", "pole_area", "core_length"):
            changed = replace(coil, **{name: getattr(coil, name) * factor})
            table[f"{name.replace('_', ' ')} {by}"] = replace(sensor, coil=changed)
    table["eddy currents"] = replace(sensor, coil=replace(coil, lamination=lamination))
    magnet = replace(coil, saturation_field=saturation_field, bias_field=bias_field)
    table["saturation"] = replace(sensor, coil=magnet)
    table["dead time"] = replace(sensor, supply=replace(supply, dead_time=dead_time))
    return table


def expected_gap(sensor: SelfSensor, gap: float) -> float:
    """Gap (m) at which the estimator settles at half duty, neglecting resistance and the ripple's harmonics.

    (V / V_m) (K_m / K) (g + l / 2) - l_m / 2, where K is mu_0 N^2 A of the coil and of the assumed coil (index m), and
    l is the core's length over its permeability. Eddy currents make l complex, l z coth z at the PWM frequency;
    saturation adds its slope at the magnet's field, 9 l (B / B_sat)^8.
    """
    coil, believed = sensor.coil, sensor.estimator.coil
    core = coil.core_length + 0j
    if coil.lamination:
        z = np.sqrt(2j * np.pi * sensor.supply.frequency * coil.diffusion_time)
        core *= z / np.tanh(z)
    if coil.saturation_field is not None:
        core += 9 * coil.core_length * (coil.bias_field / coil.saturation_field) ** 8
    ratio = sensor.supply.voltage / sensor.estimator.voltage * believed.constant / coil.constant
    return float(ratio * abs(gap + core / 2) - believed.core_length / 2)


def robustness(
    sensors: Mapping[str, SelfSensor], amplitude: float = 50e-6, frequency: float = 100.0, duty: float = 0.1
) -> list[MismatchErrors]:
    """Errors of each sensor along a sine of its gap while the duty moves about one half as a cosine.

    The frequency is rounded to whole PWM periods. Errors are those of means over a PWM period, so the ripple that is
    left on a reading does not count; it would mainly affect the demodulator.

    Args:
        sensors: Sensors by name.
        amplitude: Amplitude of the gap, m.
        frequency: Frequency of the gap, Hz.
        duty: Amplitude of the duty.

    Raises:
        ValueError: Amplitude, frequency or duty is out of range, a supply does not have two states, or an estimate
            reaches the end of its gap_range.
    """
    if not 0 < duty < 0.5:
        raise ValueError(f"duty = {duty} must be above 0 and below 0.5, where no ripple is left")
    if not amplitude > 0:
        raise ValueError(f"amplitude = {amplitude} m must be positive: the calibration needs steps of the gap")
    for name, sensor in sensors.items():
        cycles = sensor.acquisition.rate / samples_and_periods(sensor)[0]
        if not 0 < frequency <= cycles / 10:
            raise ValueError(
                f"{name}: frequency = {frequency} Hz must be positive and at most {cycles / 10:g} Hz, a tenth of how "
                "often samples and PWM periods coincide"
            )
        if sensor.supply.states != 2:
            raise ValueError(f"{name}: the supply has {sensor.supply.states} states; half duty is rest with two only")
    return [_errors(name, sensor, amplitude, frequency, 2 * duty) for name, sensor in sensors.items()]


def _errors(name: str, sensor: SelfSensor, amplitude: float, frequency: float, swing: float) -> MismatchErrors:
    cycle, _ = samples_and_periods(sensor)
    cycles = round(sensor.acquisition.rate / frequency / cycle)
    angle = 2 * np.pi * np.arange(1, PERIODS * cycles * cycle + 1) / (cycles * cycle)
    steps = sensor.gap + amplitude * np.linspace(-1, 1, STEPS)
    motion = sensor.gap + amplitude * np.sin(angle)
    gap = np.concatenate([np.repeat(steps[:, None], angle.size, axis=1), [motion, motion]])
    drive = np.zeros_like(gap)
    drive[-1] = swing * np.cos(angle)
    sensed = simulate([sensor] * len(gap), gap, drive)
    low, high = sensor.estimator.gap_range
    if sensed.estimate.min() <= low or sensed.estimate.max() >= high:
        raise ValueError(f"{name}: the estimate runs into the end of gap_range = {low} .. {high} m; widen it")

    def per_cycle(values: np.ndarray) -> np.ndarray:
        return values.reshape(*values.shape[:-1], -1, cycle).mean(axis=-1)[..., cycles:]

    estimate, amplitudes = per_cycle(sensed.estimate), per_cycle(sensed.amplitude)
    true = per_cycle(motion)
    gain, offset = np.polyfit(steps - sensor.gap, estimate[:STEPS].mean(axis=-1) - sensor.gap, 1)
    half, moved = _calibrated(estimate, steps)
    demodulated_half, demodulated = _calibrated(amplitudes, steps)
    around = [expected_gap(sensor, sensor.gap + move) for move in (-amplitude, 0.0, amplitude)]
    return MismatchErrors(
        name=name,
        offset=float(offset),
        expected_offset=around[1] - sensor.gap,
        gain=float(gain),
        expected_gain=(around[2] - around[0]) / (2 * amplitude),
        raw=_rms(estimate[-1] - true),
        estimator=_rms(moved - true),
        demodulator=_rms(demodulated - true),
        estimator_duty=_rms(moved - half),
        demodulator_duty=_rms(demodulated - demodulated_half),
    )


def _calibrated(reading: np.ndarray, steps: np.ndarray) -> np.ndarray:
    """Gaps (2, n) of the two moving records, calibrated by the static records of a reading (STEPS + 2, n)."""
    return np.polyval(np.polyfit(reading[:STEPS].mean(axis=-1), steps, 1), reading[STEPS:])


def _rms(error: np.ndarray) -> float:
    return float(np.sqrt(np.mean(error**2)))
