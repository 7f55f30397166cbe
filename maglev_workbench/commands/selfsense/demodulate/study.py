"""Demodulator and estimator along a sinusoidal gap, with the duty at one half and with it varying: the errors."""

from dataclasses import dataclass, replace
from math import ceil, isfinite, pi, sqrt

import numpy as np

from maglev_env.rig.rig import Rig
from selfsense.demodulation import demodulated_gap, demodulation_error, path_factor
from selfsense.sensor import SelfSensor
from selfsense.simulate import simulate
from selfsense.validity import SETTLING, refuse_invalid

DUTIES = ("constant", "varying")
METHODS = ("demodulated", "estimated")
_SHORTEST = 0.05  # s of motion that the errors are taken over, so that noise averages out
_LARGEST_SWING = 0.45  # of the duty: beyond it the ripple nearly vanishes once a period
_LOWEST = 1.0  # Hz


@dataclass(frozen=True)
class GapError:
    """Error of a gap: rms and bias (m), its delay (s), and the rms (m) after compensation of the delay."""

    rms: float
    bias: float
    delay: float
    rms_without_lag: float


@dataclass(frozen=True)
class Trace:
    """Results for one duty over time: the drive (-1 .. 1), the gaps of METHODS (m) and their errors.

    The errors are given also for a current that is read without noise and rounding.
    """

    drive: np.ndarray
    gaps: dict[str, np.ndarray]
    errors: dict[str, GapError]
    ideal: dict[str, GapError]

    @property
    def ratio(self) -> float:
        """Ratio of the demodulator's rms error to the estimator's, including the lag."""
        return self.errors["demodulated"].rms / self.errors["estimated"].rms

    @property
    def ideal_ratio(self) -> float:
        """The same with an ideal reading."""
        return self.ideal["demodulated"].rms / self.ideal["estimated"].rms


@dataclass(frozen=True)
class Demodulation:
    """Results for both duties along one motion of the gap, over whole periods.

    The fields are time (s), gap (m), traces by DUTIES, the demodulator's error (m) in closed form, the amplitude (A) of
    the current at the motion's frequency, and the factor of the path.
    """

    rig: Rig
    sensor: SelfSensor
    frequency: float
    amplitude: float
    duty_swing: float
    seed: int
    time: np.ndarray
    gap: np.ndarray
    traces: dict[str, Trace]
    closed_form: np.ndarray
    current: float
    path_factor: float


def compare(
    rig: Rig, sensor: SelfSensor, frequency: float, amplitude: float, duty_swing: float, seed: int
) -> Demodulation:
    """Simulate the motion gap + amplitude sin(w t), the duty 1/2 and 1/2 + duty_swing cos(w t) (D eq 6.24).

    frequency Hz, amplitude m. An inductive coil turns that duty into a current in phase with the motion. ValueError
    when the motion leaves the estimator's range, or something else keeps the estimate from being trusted.
    """
    check_motion(sensor, frequency, amplitude)
    if not frequency >= _LOWEST:
        raise ValueError(f"--frequency {frequency:g} Hz: use {_LOWEST:g} Hz or more; slower takes too many samples")
    if not 0 < duty_swing <= _LARGEST_SWING:
        raise ValueError(
            f"--duty-swing {duty_swing:g}: the duty varies about one half; use more than 0, up to {_LARGEST_SWING:g}"
        )
    rate = sensor.acquisition.rate
    settling = ceil(SETTLING * rate)
    periods = max(4, ceil(_SHORTEST * frequency))
    n = settling + round(periods * rate / frequency)
    time = (np.arange(n) + 1) / rate
    phase = 2 * pi * frequency * time
    gap = sensor.gap + amplitude * np.sin(phase)
    drives = np.outer([0, 1], 2 * duty_swing * np.cos(phase))
    quiet = replace(sensor, acquisition=replace(sensor.acquisition, bits=0, noise=0.0))
    sensors = [sensor, sensor, quiet, quiet]
    sensed = simulate(sensors, gap, np.tile(drives, (2, 1)), seed=seed)
    refuse_invalid(sensed, sensors, settling)
    kept = slice(settling, None)
    time, gap, drives = time[kept], gap[kept], drives[:, kept]
    gaps = {"demodulated": demodulated_gap(sensed.amplitude[:, kept], sensor), "estimated": sensed.estimate[:, kept]}
    errors = [{m: _errors(gaps[m][lane], sensor.gap, amplitude, frequency, time) for m in METHODS} for lane in range(4)]
    traces = {
        duty: Trace(drives[i], {m: gaps[m][i] for m in METHODS}, errors[i], errors[i + 2])
        for i, duty in enumerate(DUTIES)
    }
    current = 2 * abs(np.mean(sensed.current[1, kept] * np.exp(-2j * pi * frequency * time)))
    closed = demodulation_error(gap, sensor.coil, sensor.supply, drives[1])
    settings = (frequency, amplitude, duty_swing, seed)
    return Demodulation(rig, sensor, *settings, time, gap, traces, closed, float(current), path_factor(sensor))


def check_motion(sensor: SelfSensor, frequency: float, amplitude: float) -> None:
    """Raise ValueError unless a gap that moves with an amplitude (m) at a frequency (Hz) can be sensed."""
    highest = sensor.supply.frequency / 10
    if not (isfinite(frequency) and 0 < frequency <= highest):
        raise ValueError(
            f"--frequency {frequency:g} Hz: use more than 0, up to a tenth of the PWM frequency, {highest:g} Hz: some "
            "PWM periods must see one gap"
        )
    low, high = sensor.estimator.gap_range
    most = min(sensor.gap - low, high - sensor.gap)
    if not 0 < amplitude < most:
        raise ValueError(
            f"--amplitude {amplitude:g} m: the gap must stay within the estimator's {1e6 * low:g} to {1e6 * high:g} µm "
            f"around {1e6 * sensor.gap:g} µm; use up to {most:g} m"
        )


def _errors(found: np.ndarray, rest: float, amplitude: float, frequency: float, time: np.ndarray) -> GapError:
    """Error of a gap (samples,) against rest + amplitude sin(w t), over whole periods."""
    w = 2 * pi * frequency
    motion = np.sin(w * time)
    error = found - rest - amplitude * motion
    delay = -np.angle(1j * np.mean((found - found.mean()) * np.exp(-1j * w * time))) / w
    late = found - rest - amplitude * np.sin(w * (time - delay))
    rms = [sqrt(np.mean(e**2)) for e in (error, late)]
    return GapError(rms[0], float(error.mean()), float(delay), rms[1])
