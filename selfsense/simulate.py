"""Simulation of self-sensors at the level of single switching edges, in lanes."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from maglev_lanes.layout import LANES
from selfsense.kernel import CHANNELS, kernel
from selfsense.kernel_pieces import SensorStructure
from selfsense.sensor import SelfSensor, largest_gap, samples_and_periods, sensor_rows, structure_of

CHUNK = 2000  # samples per call of the kernel, so that a block's buffers stay in the cache


@dataclass(frozen=True)
class SensedGap:
    """Readings of n self-sensors.

    Attributes:
        time: (samples,), s.
        estimate: Estimated gap, (n, samples), m.
        amplitude: Amplitude of the ripple behind the forward path, (n, samples), A.
        current: Coil current as read, (n, samples), A.
        switching: Switching voltage over the supply's, as its mean since the sample before, (n, samples), -1 .. 1.
    """

    time: np.ndarray
    estimate: np.ndarray
    amplitude: np.ndarray
    current: np.ndarray
    switching: np.ndarray


def simulate(
    sensors: Sequence[SelfSensor], gap: ArrayLike, drive: ArrayLike = 0.0, every: int = 1, seed: int = 0
) -> SensedGap:
    """Simulate sensors that share acquisition rate and PWM frequency, along a gap and a drive.

    Args:
        sensors: The n sensors.
        gap: Gap at the samples after the first at rest, linear in between, m: (samples,) for every sensor or
            (n, samples).
        drive: Drive (-1 .. 1, see `Supply`): like gap, or one number; it is taken where a PWM period begins.
        every: Samples per sample kept, a divisor of CHUNK.
        seed: Seed of the reading noise.

    Raises:
        ValueError: Shapes do not fit, the sensors do not share their rates, or a gap is not positive or so wide that
            the current decays too much within a sample.
    """
    n, gap = len(sensors), np.atleast_2d(np.asarray(gap, dtype=float))
    samples = gap.shape[1]
    drive = np.atleast_2d(np.asarray(drive, dtype=float))
    _check(sensors, gap, drive, every, seed)
    out = np.empty((len(CHANNELS), n, samples // every))
    groups: dict[SensorStructure, list[int]] = {}
    for i, sensor in enumerate(sensors):
        groups.setdefault(structure_of(sensor, regulated=False), []).append(i)
    seeds = [np.random.SeedSequence((seed, i)).generate_state(1, np.uint64)[0] for i in range(n)]
    for structure, members in groups.items():
        for start in range(0, len(members), LANES):
            own = members[start : start + LANES]
            lanes = np.array(own + own[-1:] * (LANES - len(own)))
            gaps, drives = (_rows_of(a, lanes) for a in (gap, drive))
            block = [sensors[i] for i in lanes]
            out[:, own] = _run_block(structure, block, np.array(seeds)[lanes], gaps, drives, every, samples)[
                :, : len(own)
            ]
    rate = sensors[0].acquisition.rate
    time = (np.arange(samples // every) + 1) * (every / rate)
    return SensedGap(time, out[0], out[1], out[2], out[3] * rate)


def _run_block(
    structure: SensorStructure,
    sensors: Sequence[SelfSensor],
    seeds: np.ndarray,
    gap: np.ndarray,
    drive: np.ndarray,
    every: int,
    samples: int,
) -> np.ndarray:
    """Outputs (channels, LANES, samples // every) of one full block."""
    step = kernel(structure, len(CHANNELS))
    cycle, per_cycle = samples_and_periods(sensors[0])
    rows = np.ascontiguousarray(sensor_rows(sensors))
    out = np.empty((len(CHANNELS), LANES, samples // every))
    for first in range(0, samples, CHUNK):
        n = min(CHUNK, samples - first)
        waves = [np.ascontiguousarray(_part(a, first, n)).reshape(-1) for a in (gap, drive)]
        kept = np.empty((len(CHANNELS), n // every, LANES))
        step(rows.reshape(-1), seeds, first, n, per_cycle, cycle, every, *waves, kept.reshape(-1))
        out[:, :, first // every : (first + n) // every] = kept.transpose(0, 2, 1)
    return out


def _part(wave: np.ndarray, first: int, n: int) -> np.ndarray:
    """(n, LANES) of a waveform (1 or LANES, 1 or samples)."""
    part = wave if wave.shape[1] == 1 else wave[:, first : first + n]
    return np.broadcast_to(part, (LANES, n)).T


def _rows_of(a: np.ndarray, lanes: np.ndarray) -> np.ndarray:
    return a if len(a) == 1 else a[lanes]


def _check(sensors: Sequence[SelfSensor], gap: np.ndarray, drive: np.ndarray, every: int, seed: int) -> None:
    if not sensors:
        raise ValueError("give at least one self-sensor")
    n, samples = len(sensors), gap.shape[1]
    if gap.ndim != 2 or gap.shape[0] not in (1, n) or samples == 0:
        raise ValueError(f"gap has the shape {gap.shape}; give (samples,) or ({n}, samples)")
    if drive.ndim != 2 or drive.shape[0] not in (1, n) or drive.shape[1] not in (1, samples):
        raise ValueError(f"drive has the shape {drive.shape}; give a number, ({samples},) or ({n}, {samples})")
    if not isinstance(every, int | np.integer) or every < 1 or CHUNK % every or samples % every:
        raise ValueError(f"every = {every!r} must be a whole number that divides {CHUNK} and the {samples} samples")
    if not isinstance(seed, int | np.integer) or seed < 0:
        raise ValueError(f"seed = {seed!r} must be a whole number of at least 0")
    if len({(s.acquisition.rate, s.supply.frequency) for s in sensors}) > 1:
        raise ValueError("sensors in one run must share their acquisition rate and PWM frequency")
    for name, values, low in (("gap", gap, 0.0), ("drive", drive, -1.0)):
        bad = ~np.isfinite(values) | (values < low if name == "drive" else values <= low)
        bad |= (values > 1.0) if name == "drive" else False
        if bad.any():
            row, at = np.argwhere(bad)[0]
            limits = "in -1 .. 1" if name == "drive" else "above 0, the contact"
            raise ValueError(f"{name}: sample {at} of row {row} is {values[row, at]:g}; it must be {limits}")
    for i, (sensor, widest) in enumerate(zip(sensors, np.broadcast_to(gap.max(axis=1), n), strict=True)):
        if widest > largest_gap(sensor):
            raise ValueError(
                f"gap: row {i} reaches {widest:g} m, where the current decays too far within one sample; stay below "
                f"{largest_gap(sensor):g} m, or sample faster"
            )
