"""Simulation of free rotors in lanes: as recordings, or reduced block by block."""

from collections.abc import Callable, Hashable, Iterator, Sequence
from dataclasses import dataclass, fields
from itertools import pairwise
from typing import TypeVar

import numpy as np

from maglev_env.kernel.sensing_lanes import NO_SENSORS, sensor_timing
from maglev_env.rotor import rows as r
from maglev_env.rotor.kernel import TILE, kernel
from maglev_env.rotor.lanes import Run, block, enough_substeps
from maglev_env.rotor.rotor import Rotor
from maglev_env.rotor.rows import CHANNELS
from maglev_lanes.layout import LANES, row
from maglev_lanes.threads import over_threads
from selfsense.sensor import SelfSensor, structure_of

STATES = row(r.CONTACT)  # rows of the states, which come first
PLACES = ("bearing a", "bearing b", "axial stop")
Reduced = TypeVar("Reduced")


@dataclass(frozen=True)
class Spun:
    """n simulated runs.

    Attributes:
        channels: As `rows.CHANNELS`, (n, 9, samples), m and A; on self-sensing followed by `rows.SENSED`, 17 in all.
        state: q and its rates at the end, (n, 10), m and rad.
        contact: Greatest contact force since the start, as `PLACES`, (n, 3), N.
        first_contact: Time of the first contact, (n, 3), s; nan without one.
        rubbed: Energy lost to friction, (n,), J.
        end: All states at the end, with the turn, coils and controllers, (n, 36); another recording can continue from
            them.
    """

    channels: np.ndarray
    state: np.ndarray
    contact: np.ndarray
    first_contact: np.ndarray
    rubbed: np.ndarray
    end: np.ndarray

    @property
    def readings(self) -> np.ndarray:
        """What the controllers read, ordered as `linear.AXES`, (n, 4, samples), m."""
        return self.channels[:, :4] if self.gap_error is None else self.channels[:, r.READINGS]

    @property
    def gap_error(self) -> np.ndarray | None:
        """Error of the self-sensed displacements, (n, 4, samples), m; None on the probes."""
        if self.channels.shape[1] == len(CHANNELS):
            return None
        return self.channels[:, r.READINGS] - self.channels[:, r.DISPLACEMENTS]


def spin(
    runs: Sequence[Run],
    samples: int,
    settle: int = 0,
    injection: np.ndarray | None = None,
    force: np.ndarray | None = None,
    substeps: int = 1,
    start: np.ndarray | None = None,
    threads: int | None = None,
) -> Spun:
    """Record runs, after a time to settle, from rest in the centre or from a given state.

    Args:
        runs: The runs.
        samples: Control samples recorded.
        settle: Control samples before them.
        injection: Currents added to the commands, ordered as `linear.AXES`, (4, n), A, repeated from the start on.
        force: Generalised forces along q, (5, n), N and N m, repeated from the start on.
        substeps: Least number of integration steps per control sample; see `lanes.enough_substeps`.
        start: q and rates (10,) of all runs, or `Spun.end` (n, 36) of as many runs. Runs that continue need other
            seeds, or their noise repeats.
        threads: Number of threads.

    Raises:
        ValueError: As `reduced`, or some runs are on the probes and others on self-sensing.
    """
    if len({run.rotor.sensor == "probe" for run in runs}) > 1:
        raise ValueError("runs on the probes and on self-sensing have other channels; record them apart")
    parts = reduced(runs, samples, lambda spun, _: spun, settle, injection, force, substeps, start, threads)
    found = list(zip(*([getattr(p, f.name) for f in fields(Spun)] for p in parts), strict=True))
    return Spun(*(np.concatenate(field) for field in found))


def reduced(
    runs: Sequence[Run],
    samples: int,
    reduce: Callable[[Spun, Sequence[Run]], Reduced],
    settle: int = 0,
    injection: np.ndarray | None = None,
    force: np.ndarray | None = None,
    substeps: int = 1,
    start: np.ndarray | None = None,
    threads: int | None = None,
) -> Iterator[Reduced]:
    """Results of `reduce` for each block of runs, in order, so that many recordings need not exist at once.

    Raises:
        ValueError: Runs differ in control rate, a waveform or start has the wrong shape, or a rotor on self-sensing is
            given a start.
    """
    shared_rate([run.rotor for run in runs])
    waves = [
        _repeated(wave, rows, settle + samples, name)
        for wave, rows, name in ((force, 5, "force"), (injection, 4, "injection"))
    ]
    if start is not None:
        if any(run.rotor.sensor != "probe" for run in runs):
            raise ValueError("start: a rotor on self-sensing starts at rest in the centre, with its estimators")
        start = np.asarray(start, float)
        if start.shape not in ((10,), (len(runs), STATES)):
            raise ValueError(f"start: {start.shape}; give q and rates (10,), or the end ({len(runs)}, {STATES})")
        start = np.broadcast_to(start, (len(runs), start.shape[-1]))
    enough = {id(rotor): enough_substeps(rotor) for rotor in {id(run.rotor): run.rotor for run in runs}.values()}
    kinds = [(max(substeps, enough[id(run.rotor)]), run.rotor.self_sensor) for run in runs]
    ends = [0, *(i + 1 for i, (one, other) in enumerate(pairwise(kinds)) if one != other), len(runs)]
    blocks = [(kinds[a], slice(i, min(i + LANES, b))) for a, b in pairwise(ends) for i in range(a, b, LANES)]

    def work(part: tuple[tuple[int, SelfSensor | None], slice]) -> Reduced:
        own, some = part
        begun = None if start is None else start[some]
        return reduce(_spun(runs[some], samples, settle, waves, own, begun), runs[some])

    yield from over_threads(work, blocks, threads)


def shared_rate(rotors: Sequence[Rotor]) -> float:
    """The control rate of all rotors of a batch, Hz.

    Raises:
        ValueError: There are none, or they differ in it.
    """
    rates = {rotor.axis.control_rate for rotor in rotors}
    if len(rates) != 1:
        raise ValueError("rotors in one batch must share their control rate" if rates else "give at least one run")
    return rates.pop()


def alike(values: Sequence[Hashable]) -> list[list[int]]:
    """Positions of equal values together: what differs among runs that are otherwise one batch is done in turn."""
    found: dict[Hashable, list[int]] = {}
    for i, value in enumerate(values):
        found.setdefault(value, []).append(i)
    return list(found.values())


def _repeated(wave: np.ndarray | None, rows: int, samples: int, name: str) -> np.ndarray:
    """One wave (rows, samples)."""
    if wave is None:
        return np.zeros((rows, samples))
    wave = np.asarray(wave, float)
    if wave.ndim != 2 or len(wave) != rows or not wave.size or not np.isfinite(wave).all():
        raise ValueError(f"{name}: {np.shape(wave)}; give finite numbers of the shape ({rows}, samples)")
    return np.tile(wave, -(-samples // wave.shape[1]))[:, :samples]


def _spun(
    runs: Sequence[Run],
    samples: int,
    settle: int,
    waves: list[np.ndarray],
    kind: tuple[int, SelfSensor | None],
    start: np.ndarray | None,
) -> Spun:
    substeps, sensor = kind
    rows, seeds = block(runs, substeps)
    if start is not None:
        rows[: start.shape[1], : len(runs)] = start.T  # q, rates and the other states are the first rows
    rejecting = any(run.rotor.rejection is not None for run in runs)
    rate = runs[0].rotor.axis.control_rate
    structure = None if sensor is None else structure_of(sensor, regulated=True)
    timing = np.array(NO_SENSORS if sensor is None else sensor_timing(sensor, rate, substeps))
    step, h = kernel(substeps, rejecting, structure), 1 / (rate * substeps)
    channels = len(CHANNELS) + (0 if sensor is None else len(r.SENSED))
    tile, out = np.empty(TILE * channels * LANES), np.empty(0)
    for first, count in ((0, settle), (settle, samples)):
        out = np.empty((channels, LANES, count))
        own = [np.ascontiguousarray(wave[:, first : first + count]).ravel() for wave in waves]
        if count:
            step(rows.reshape(-1), seeds.reshape(-1), first, h, timing, *own, tile, out.reshape(-1))
    n = len(runs)
    found = rows[row(r.FIRST) : row(r.FIRST) + 3, :n].T * h
    return Spun(
        out[:, :n].transpose(1, 0, 2),
        rows[row(r.Q) : row(r.Q) + 10, :n].T.copy(),
        rows[row(r.CONTACT) : row(r.CONTACT) + 3, :n].T.copy(),
        np.where(np.isfinite(found), found, np.nan),
        rows[row(r.RUBBED), :n].copy(),
        rows[:STATES, :n].T.copy(),
    )
