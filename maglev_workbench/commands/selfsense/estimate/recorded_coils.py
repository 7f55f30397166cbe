"""Coils in recordings: reading their current and switching voltage, and the gap by the rig's estimator."""

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal

import numpy as np

from maglev_env.loop.axes import suffixes
from maglev_env.recordings.campaign import Campaign, RecordingSpec
from maglev_env.recordings.masking import masked_samples
from maglev_env.recordings.recording import read_recording
from maglev_env.rig.rig import Rig
from maglev_env.rig.self_sensor import rig_sensors
from maglev_workbench.commands.selfsense.rig_sensor import other_inductance
from selfsense.recorded import RecordedGap, estimate_recorded, find_pwm_frequency, usual_peak
from selfsense.sensor import SelfSensor

SUFFIXES = ("", *suffixes(2))
_FINEST = 40  # samples per PWM period: gains designed for more differ by a few percent
_OTHER_PWM, _OTHER_VOLTAGE = 0.02, 0.2  # shares by which a recording differs from the rig noticeably
SWITCHING = 1 / 3  # of the rig's PWM frequency, below which a voltage's lines are its drive
_ANOTHER_RIG = 0.5  # share by which the PWM frequency of a wrong rate or rig differs


@dataclass(frozen=True)
class Coil:
    """One coil of a recording: the suffix of its channels, "", "_x" or "_y", and the file."""

    path: Path
    spec: RecordingSpec
    suffix: str

    @property
    def name(self) -> str:
        return f"{self.spec.name}, {self.suffix[1:]}" if self.suffix else self.spec.name


@dataclass(frozen=True)
class Signals:
    """Signals of one coil, (samples,) each: current (A), voltage (V), if it was recorded displacement (m), and where
    they are bridged because nothing was recorded."""

    current: np.ndarray
    voltage: np.ndarray
    displacement: np.ndarray | None
    lost: np.ndarray


@dataclass(frozen=True)
class Comparison:
    """The estimated gap beside rest gap less displacement, over valid samples: rms and mean of the difference (m), and
    the line estimate - rest = gain * (gap - rest) + offset (m)."""

    rms: float
    bias: float
    gain: float
    offset: float


@dataclass(frozen=True)
class SensedCoil:
    """A coil, its signals, the sensor whose estimator was used, its result, and notes on suspicious data."""

    coil: Coil
    signals: Signals
    sensor: SelfSensor
    gap: RecordedGap
    comparison: Comparison | None
    notes: tuple[str, ...]

    @property
    def valid_share(self) -> float:
        return float(self.gap.valid.mean())


def coils_of(campaign: Campaign, spec: RecordingSpec) -> list[Coil]:
    """The coils whose current and voltage a recording names.

    Raises:
        ValueError: Current or voltage of a coil is missing, or there is no coil.
    """
    path = campaign.folder / spec.file
    found = []
    for suffix in SUFFIXES:
        named = [f"{kind}{suffix}" in spec.channels for kind in ("current", "voltage")]
        if all(named):
            found.append(Coil(path, spec, suffix))
        elif any(named):
            missing, there = ("voltage", "current") if named[0] else ("current", "voltage")
            raise ValueError(
                f"{path}: there is a channel {there}{suffix}, but no {missing}{suffix}: the gap needs the coil's "
                "current and its switching voltage; name both under [recording.channels] (`maglev selfsense record` "
                "simulates such a recording)"
            )
    if not found:
        raise ValueError(f"{path}: there are no channels current and voltage: the gap needs both, of one coil")
    return found


def read_coil(campaign: Campaign, coil: Coil) -> Signals:
    """The signals of a coil in SI; errors as `read_recording`, except that a clipped current is marked instead."""
    spec, end = coil.spec, coil.suffix
    current, voltage, displacement = (f"{kind}{end}" for kind in ("current", "voltage", "displacement"))
    # The estimator needs the whole current and voltage, with the bias that a `total` one holds.
    named = {
        name: replace(spec.channels[name], total=False)
        for name in (voltage, "time", displacement, current)
        if name in spec.channels
    }
    spec = replace(spec, channels=named)
    dataset = read_recording(campaign, spec, unjudged=(current,))
    lost = masked_samples(dataset)
    if lost.any() and displacement in dataset:  # a clipped probe hides nothing of the coil
        lost = masked_samples(read_recording(campaign, spec, unjudged=(current, displacement)))
    moved = dataset[displacement].values if displacement in dataset else None
    return Signals(dataset[current].values, dataset[voltage].values, moved, lost)


def sense(coil: Coil, signals: Signals, rig: Rig, voltage_sampling: Literal["mean", "point"]) -> SensedCoil:
    """The gap in a coil's signals by the estimator of its axis of a rig.

    ValueError as `estimate_recorded`, or when the PWM frequencies of recording and rig differ by more than half.
    """
    rate = coil.spec.sample_rate
    sensor = sensor_at(rig, rate)[SUFFIXES[1:].index(coil.suffix) if coil.suffix and rig.axes == 2 else 0]
    own = rig.self_sensing
    current_range = own.current_range if own.adc_bits else np.inf
    frequency = find_pwm_frequency(signals.voltage, rate, sensor.estimator.path, SWITCHING * own.pwm_frequency)
    both = signals.current, signals.voltage
    gap = estimate_recorded(
        *both, rate, sensor.estimator, sensor.gap, current_range, voltage_sampling, frequency, signals.lost
    )
    if abs(gap.pwm_frequency / own.pwm_frequency - 1) > _ANOTHER_RIG:
        raise ValueError(
            f"the voltage switches at {gap.pwm_frequency / 1e3:.4g} kHz if the sample rate is {rate:g} Hz, "
            f"rig {rig.name} at {own.pwm_frequency / 1e3:g} kHz: check the rate, or name the rig that was "
            "recorded with --rig"
        )
    comparison = _compare(gap, signals, sensor)
    return SensedCoil(coil, signals, sensor, gap, comparison, _notes(gap, signals, sensor, comparison, rig))


def sensor_at(rig: Rig, rate: float) -> tuple[SelfSensor, ...]:
    """The self-sensor of each axis of a rig with gains designed for recordings at a rate (Hz).

    The design needs few samples until they meet the PWM in the same way again: it is made for the nearest quarter of a
    sample per PWM period. ValueError as `rig_sensors`, or when the rate is below twice the rig's PWM frequency.
    """
    own = rig.self_sensing
    if rate < 2 * own.pwm_frequency * (1 - 1e-9):
        raise ValueError(
            f"sample_rate = {rate:g} Hz is below twice the PWM frequency of rig {rig.name}, {own.pwm_frequency:g} Hz: "
            "its ripple would fold back; sample faster, or name the rig that was recorded with --rig"
        )
    per_period = min(max(round(4 * rate / own.pwm_frequency) / 4, 2), _FINEST)
    return rig_sensors(replace(rig, self_sensing=replace(own, sample_rate=own.pwm_frequency * per_period)))


def _compare(gap: RecordedGap, signals: Signals, sensor: SelfSensor) -> Comparison | None:
    if signals.displacement is None:
        return None
    moved = -signals.displacement[gap.valid]
    read = gap.gap[gap.valid] - sensor.gap
    error = read - moved
    moves = np.ptp(moved) > 0
    gain, offset = np.polyfit(moved, read, 1) if moves else (np.nan, np.nan)
    return Comparison(float(np.sqrt(np.mean(error**2))), float(error.mean()), float(gain), float(offset))


def _notes(
    gap: RecordedGap, signals: Signals, sensor: SelfSensor, comparison: Comparison | None, rig: Rig
) -> tuple[str, ...]:
    other, supply = other_inductance(rig, sensor), sensor.supply
    notes = [other] if other else []
    if abs(gap.pwm_frequency / supply.frequency - 1) > _OTHER_PWM:
        notes.append(
            f"the voltage switches at {gap.pwm_frequency / 1e3:.4g} kHz, the rig at {supply.frequency / 1e3:g} kHz: "
            "the estimator's gains are made for the rig's; name the rig that was recorded with --rig"
        )
    highest = usual_peak(signals.voltage, sensor.acquisition.rate / gap.pwm_frequency)
    if abs(highest / supply.voltage - 1) > _OTHER_VOLTAGE:
        notes.append(
            f"the voltage reaches {highest:.3g} V, the rig's supply has {supply.voltage:g} V: check the channel's "
            "scale; the gap is wrong by the same share"
        )
    if comparison is not None and comparison.gain < 0:
        notes.append("the gap rises with the displacement: its sign is reversed, or the coil opposite was read")
    return tuple(notes)
