"""Gap errors over converter bits and current noise, at the rig's rate and at the dissertation's."""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from maglev_env.rig.rig import Rig
from maglev_workbench.commands.selfsense.rig_sensor import DISSERTATION_RATE
from selfsense.bound import NoisePoint, forward_path_cost, noise_bandwidth, noise_sweep, ripple_sensitivity
from selfsense.linear import stable
from selfsense.sensor import SelfSensor
from selfsense.simulate import simulate

BITS = (4, 6, 8, 10, 12, 16)
NOISES = (0.0, 1e-3, 3e-3, 1e-2, 3e-2, 1e-1)  # A rms
FREQUENCY, REACH = 100.0, 1 / 7  # of the moving gap, Hz, and its amplitude over the rest gap


@dataclass(frozen=True)
class Record:
    """A period of the moving gap at the rig's own noise and bits: time (s), and estimated less true gap (m) with and
    without noise and converter, each (n,)."""

    time: np.ndarray
    error: np.ndarray
    quiet: np.ndarray


@dataclass(frozen=True)
class NoiseStudy:
    """points: bits (0: ideal) by noises (A), at the rig's rate; at_dissertation: at DISSERTATION_RATE without noise, by
    bits, none where the gains are not stable there or the rig has that rate. ripple (A): peak to peak at half duty.
    cost: of the forward path; bandwidth (Hz): of the noise."""

    rig: Rig
    sensor: SelfSensor
    seed: int
    points: tuple[NoisePoint, ...]
    at_dissertation: tuple[NoisePoint, ...]
    ripple: float
    cost: float
    bandwidth: float
    record: Record

    def at(self, bits: int, noise: float) -> NoisePoint | None:
        """The point of these bits and this noise (A), None for an ideal reading."""
        return next((p for p in self.points if (p.bits, p.noise) == (bits, noise)), None)

    @property
    def own(self) -> NoisePoint | None:
        """The point of the rig's own bits and noise, None for an ideal reading."""
        return self.at(self.sensor.acquisition.bits, self.sensor.acquisition.noise)

    @property
    def bits(self) -> list[int]:
        """Bits of the points, the ideal converter last."""
        return sorted({p.bits for p in self.points}, key=lambda b: (b == 0, b))

    @property
    def noises(self) -> list[float]:
        """Noises (A) of the points, rising."""
        return sorted({p.noise for p in self.points})


def plan(sensor: SelfSensor) -> list[tuple[SelfSensor, int, tuple[float, ...]]]:
    """Sweeps: a sensor at one rate, bits and noises (A)."""
    a = sensor.acquisition
    noises = tuple(sorted({*NOISES, a.noise}))
    sweeps = [(sensor, bits, noises) for bits in sorted({*BITS, a.bits} - {0})]
    sweeps.append((sensor, 0, tuple(n for n in noises if n)))
    other = _at_dissertation_rate(sensor)
    return sweeps + ([(other, bits, (0.0,)) for bits in BITS] if other else [])


def study(rig: Rig, sensor: SelfSensor, seed: int, progress: Callable[[], None] = lambda: None) -> NoiseStudy:
    """Run `plan`. ValueError when the estimator is unstable."""
    found: dict[bool, list[NoisePoint]] = {True: [], False: []}
    for one, bits, noises in plan(sensor):
        motion = {"amplitude": REACH * sensor.gap, "frequency": FREQUENCY}
        found[one is sensor] += noise_sweep(one, [bits], noises, **motion, seed=seed)
        progress()
    return NoiseStudy(
        rig,
        sensor,
        seed,
        tuple(found[True]),
        tuple(found[False]),
        ripple=float(np.ptp(ripple_sensitivity(sensor))) * (sensor.gap + sensor.coil.core_length / 2),
        cost=forward_path_cost(sensor),
        bandwidth=noise_bandwidth(sensor),
        record=_record(sensor, seed),
    )


def _at_dissertation_rate(sensor: SelfSensor) -> SelfSensor | None:
    """The sensor at DISSERTATION_RATE; None where it has that rate, is not stable there or cannot be sampled so."""
    if sensor.acquisition.rate == DISSERTATION_RATE:
        return None
    try:
        other = replace(sensor, acquisition=replace(sensor.acquisition, rate=DISSERTATION_RATE))
        return other if stable(other) else None
    except ValueError:
        return None


def _record(sensor: SelfSensor, seed: int) -> Record:
    period = round(sensor.acquisition.rate / FREQUENCY)
    phase = 2 * np.pi * np.arange(1, 2 * period + 1) / period
    gap = sensor.gap * (1 + REACH * np.sin(phase))
    ideal = replace(sensor, acquisition=replace(sensor.acquisition, bits=0, noise=0.0))
    sensed = simulate([sensor, ideal], gap, seed=seed)
    error, quiet = (sensed.estimate - gap)[:, period:]
    return Record(sensed.time[:period], error, quiet)
