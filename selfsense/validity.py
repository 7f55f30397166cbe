"""Where an estimated gap can be trusted: the ripple must carry it, the range must hold it, the loop must have settled.

An estimator without ripple stands still, and one at the end of its range is pushed against it. Both show a plausible
number that contains no information on the gap.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from math import ceil, pi, sqrt

import numpy as np
from numpy.typing import ArrayLike

from selfsense.forward_path import BUTTERWORTH, response, unit_circle
from selfsense.sensor import Estimator, SelfSensor
from selfsense.simulate import SensedGap

NO_RIPPLE, AT_END, CLIPPED, CONVERGING = "no ripple", "end of gap_range", "current clipped", "converging"
WRONG_READING, LOST = "current does not follow voltage", "samples lost"
SMALLEST_RIPPLE = 0.1  # of the ripple at half duty, where the loop is ten times slower; a duty of 0.025 or 0.975
SETTLED = 10.0  # time constants of the loop after a fault, in which 1 mm becomes 45 nm
SLIDING = 3.0  # time constants before a fault shows, in which the estimate may be moving towards it
SETTLING = 0.02  # settling time of a simulated sensor, s; one that needs longer is refused


@dataclass(frozen=True)
class Stretch:
    """Samples start .. stop - 1, which carry no gap, and the reason."""

    start: int
    stop: int
    reason: str


@dataclass(frozen=True)
class Validity:
    """Where an estimate can be trusted.

    Attributes:
        valid: Whether a sample can be trusted, (samples,).
        reasons: The stretches that cannot; they may overlap where there are several reasons.
    """

    valid: np.ndarray
    reasons: tuple[Stretch, ...]


def gap_validity(
    estimate: ArrayLike,
    amplitude: ArrayLike,
    rate: float,
    estimator: Estimator,
    voltage: float,
    pwm_frequency: float,
    clipped: ArrayLike = False,
    noise_only: ArrayLike = False,
    wrong: ArrayLike = False,
    lost: ArrayLike = False,
) -> Validity:
    """Which samples of an estimated gap can be trusted.

    Not valid are clipped, wrong and lost samples, samples without ripple, an amplitude below SMALLEST_RIPPLE of that at
    half duty and the estimated gap, an estimate at the end of its range, the SLIDING time constants of the loop before
    such a fault, and the SETTLED ones after it or after the first sample. The loop's pole is at ki S / (1 + kp S) with
    the amplitude per gap S, so the loop settles more slowly where the ripple is smaller.

    Args:
        estimate: Estimated gap, (samples,), m.
        amplitude: Amplitude of its ripple, (samples,), A.
        rate: Rate of these samples, Hz.
        estimator: The estimator.
        voltage: Of the supply, V.
        pwm_frequency: Of the supply, Hz.
        clipped: Where the current was clipped, (samples,).
        noise_only: Where the amplitude is not a ripple, (samples,).
        wrong: Where a reading of current or voltage fits no other, (samples,).
        lost: Where what is read only stands for what was not recorded, (samples,).
    """
    estimate, amplitude = np.asarray(estimate, dtype=float), np.asarray(amplitude, dtype=float)
    coil, (low, high) = estimator.coil, estimator.gap_range
    half_duty = voltage / pwm_frequency / 8 / coil.inductance(estimate)
    touching = 1e-9 * (high - low)
    faults = {
        NO_RIPPLE: ~(amplitude >= SMALLEST_RIPPLE * half_duty) | np.asarray(noise_only),
        AT_END: ~((estimate > low + touching) & (estimate < high - touching)),
        CLIPPED: np.broadcast_to(clipped, estimate.shape),
        WRONG_READING: np.broadcast_to(wrong, estimate.shape),
        LOST: np.broadcast_to(lost, estimate.shape),
    }
    path = 1 / (BUTTERWORTH * 2 * pi * estimator.path.low_pass)
    faults[NO_RIPPLE][: ceil(3 * path * rate)] = False  # the filters fill
    # An amplitude larger than this supply can make is a start-up of the filters and not a faster loop.
    sensitivity = 2 * np.minimum(amplitude, 2 * half_duty) / (coil.core_length + 2 * estimate)
    pull = estimator.ki * sensitivity
    pace = pull / (1 + estimator.kp * sensitivity + path * pull)
    elapsed = np.cumsum(pace) / rate
    any_fault = np.logical_or.reduce(list(faults.values()))
    # Time constants since the last fault: the clock restarts at a fault, and before the first sample it is at 0.
    settling = elapsed - np.maximum.accumulate(np.where(any_fault, elapsed, 0.0)) < SETTLED
    stretches = []
    for reason, fault in faults.items():
        coming = np.minimum.accumulate(np.where(fault, elapsed, np.inf)[::-1])[::-1]
        fault = fault | (coming - elapsed < SLIDING)
        settling &= ~fault
        any_fault = any_fault | fault
        stretches += _stretches(fault, reason)
    stretches += _stretches(settling, CONVERGING)
    return Validity(~(any_fault | settling), tuple(sorted(stretches, key=lambda s: s.start)))


def sensed_validity(sensed: SensedGap, sensors: Sequence[SelfSensor]) -> tuple[Validity, ...]:
    """`gap_validity` for each sensor of a simulation.

    A clipped current shows only in the samples kept; keep all of them where the converter's range may be exceeded.

    Raises:
        ValueError: The numbers of sensors differ.
    """
    if len(sensors) != len(sensed.estimate):
        raise ValueError(f"{len(sensors)} sensors for {len(sensed.estimate)} estimates; give those that were simulated")
    rate, found = 1 / sensed.time[0], []
    for i, s in enumerate(sensors):
        estimate, amplitude = sensed.estimate[i], sensed.amplitude[i]
        adc = s.acquisition
        # The highest count is one below the end of the range, the lowest is at its end.
        clipped = adc.bits > 0 and np.abs(sensed.current[i]) > adc.current_range - 1.5 * adc.resolution
        noise_only = amplitude < 2 * _noise_amplitude(s)
        supply = (s.supply.voltage, s.supply.frequency)
        found.append(gap_validity(estimate, amplitude, rate, s.estimator, *supply, clipped, noise_only))
    return tuple(found)


def refuse_invalid(sensed: SensedGap, sensors: Sequence[SelfSensor], start: int, allowed: str = "") -> None:
    """Refuse a simulation that is not valid from sample `start` on, except for the allowed reason.

    Raises:
        ValueError: `sensed_validity` finds another reason.
    """
    for found in sensed_validity(sensed, sensors):
        bad = [s for s in found.reasons if s.stop > start and s.reason != allowed]
        if bad:
            worst = min(bad, key=lambda s: (s.reason == CONVERGING, s.start))
            raise ValueError(
                f"{worst.reason!r} at sample {max(worst.start, start)} of the simulation; change the gap's or the "
                "drive's swing, or the estimator's gains"
            )


def _noise_amplitude(sensor: SelfSensor) -> float:
    """Mean amplitude (A) behind the forward path that the reading's noise and rounding alone produce."""
    adc, path = sensor.acquisition, sensor.estimator.path
    before, _ = path.sections(adc.rate)
    power = np.mean(np.abs(response(before, unit_circle(1024))) ** 2)
    rms = adc.reading_noise * sqrt(power)
    return float(rms if path.rms else rms * sqrt(2 / pi))


def _stretches(mask: np.ndarray, reason: str) -> list[Stretch]:
    edges = np.flatnonzero(np.diff(np.concatenate([[False], mask, [False]])))
    return [Stretch(int(a), int(b), reason) for a, b in zip(edges[::2], edges[1::2], strict=True)]
