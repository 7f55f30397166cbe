"""The run-up: a rotor at a series of speeds, how far it moves, its coil currents, and whether it touches down."""

from collections.abc import Sequence
from dataclasses import dataclass, fields
from math import ceil

import numpy as np
from numpy.typing import ArrayLike

from maglev_env.rotor.lanes import Run
from maglev_env.rotor.rotor import Rotor
from maglev_env.rotor.simulate import Spun, alike, reduced, shared_rate

SPEEDS = np.arange(0.0, 14_001.0, 500.0)  # rpm, as in the dissertation (D 3.5)
SETTLE, MEASURE = 0.36, 0.24  # s; the measured time holds whole turns at every multiple of 250 rpm
LONGEST = 6.0  # s, of a turn that is waited for where it takes longer than MEASURE
DECAYS = 6.0  # time constants of the force rejection that are waited for in addition

# One seed for all rotors, or a list with one for each: integers from 0 on, or tuples of them.
Seed = int | tuple[int, ...]
Seeds = Seed | list[Seed]


@dataclass(frozen=True)
class RunUp:
    """n rotors at s speeds.

    Attributes:
        speed_rpm: (s,), rpm.
        peak: Largest radial reading at the probe planes from the centre, as in ISO 14839-2, (n, s, 2), m; at least the
            clearance after a touchdown.
        once: Amplitude at the rotation frequency of the probes in x at a and b and of an axial probe, (n, s, 3), m; at
            standstill, and where a turn takes longer than LONGEST, the square root of twice the variance.
        coil_rms: About the mean, (n, s, 4), A.
        coil_once: Amplitude of the coil currents at the rotation frequency, (n, s, 4), A; at standstill as `once`.
        copper_loss: With the bias, (n, s), W.
        contact: As `simulate.PLACES`, (n, s, 3), N.
        first_contact: As `simulate.PLACES`, (n, s, 3), s; nan without contact.
        coil_whole_rms: Of the coil currents with their mean, which carries the weight, (n, s, 4), A.
        gap_error: Rms, mean and largest error of the self-sensed displacements, of the coil with the largest rms,
            (n, s, 3), m; nan on the probes.
    """

    speed_rpm: np.ndarray
    peak: np.ndarray
    once: np.ndarray
    coil_rms: np.ndarray
    coil_once: np.ndarray
    copper_loss: np.ndarray
    contact: np.ndarray
    first_contact: np.ndarray
    coil_whole_rms: np.ndarray
    gap_error: np.ndarray

    @property
    def touched_down(self) -> np.ndarray:
        """Whether there was any contact, (n, s)."""
        return np.isfinite(self.first_contact).any(axis=-1)


def seeds_of(seed: Seeds, n: int) -> list[tuple[int, ...]]:
    """A seed for each of n rotors.

    Raises:
        ValueError: Their number is not n.
    """
    seeds = list(seed) if isinstance(seed, list) else [seed] * n
    if len(seeds) != n:
        raise ValueError(f"seed: {len(seeds)} seeds for {n} rotors; give one for all, or a list of one for each")
    return [one if isinstance(one, tuple) else (int(one),) for one in seeds]


def checked_speeds(name: str, values: ArrayLike) -> np.ndarray:
    """Speeds (s,) rpm.

    Raises:
        ValueError: They are not one or more finite numbers.
    """
    found = np.atleast_1d(np.asarray(values, float))
    if found.ndim != 1 or not found.size or not np.isfinite(found).all():
        raise ValueError(f"{name}: give one or more finite numbers, rpm")
    return found


def run_up(rotors: Sequence[Rotor], speeds: np.ndarray = SPEEDS, seed: Seeds = 0, threads: int | None = None) -> RunUp:
    """Simulate each rotor at each speed separately, from rest in the centre, under its own gains.

    A rotor that touches down is reported, and its simulation continues.

    Args:
        rotors: The rotors.
        speeds: rpm.
        seed: One for all, or one for each; the order of the rotors does not matter.
        threads: Number of threads.

    Raises:
        ValueError: No rotors, rotors of other control rates, speeds that are not finite numbers, or wrong seeds.
    """
    seeds = seeds_of(seed, len(rotors))
    speeds, rate = checked_speeds("speeds", speeds), shared_rate(rotors)
    runs = [Run(r, float(v), (*s, j)) for r, s in zip(rotors, seeds, strict=True) for j, v in enumerate(speeds)]
    times = [(round((SETTLE + waiting(run.rotor)) * rate), ceil(_measured_time(run) * rate - 1e-6)) for run in runs]
    groups, parts = alike(times), []
    for some in groups:
        settle, samples = times[some[0]]
        parts += reduced([runs[i] for i in some], samples, _measured, settle, threads=threads)
    order = np.argsort(np.concatenate(groups))
    columns = [np.concatenate([getattr(p, f.name) for p in parts])[order] for f in fields(RunUp)[1:]]
    shape = len(rotors), speeds.size
    return RunUp(speeds, *(c.reshape(*shape, *c.shape[1:]) for c in columns))


def waiting(rotor: Rotor) -> float:
    """Time (s) in which a rotor's force rejection finds the unbalance; 0 without one."""
    return DECAYS / rotor.rejection.rate if rotor.rejection else 0.0


def _measured_time(run: Run) -> float:
    """Time (s) that is measured: a turn at least, unless that takes longer than LONGEST."""
    turn = 60 / abs(run.speed_rpm) if run.speed_rpm else 0.0
    return max(MEASURE, turn) if turn <= LONGEST else MEASURE


def _measured(spun: Spun, runs: Sequence[Run]) -> RunUp:
    channels = spun.channels
    mean = channels.mean(axis=-1, keepdims=True)
    moving = channels - mean
    radial = np.hypot(channels[:, 0:4:2], channels[:, 1:4:2]).max(axis=-1)
    rotors = [run.rotor for run in runs]
    touched = np.isfinite(spun.first_contact[:, :2]).any(axis=1)  # it reached the bearing and may still lie there
    clearance = np.array([rotor.axis.clearance for rotor in rotors])
    radial = np.where(touched[:, None], np.maximum(radial, clearance[:, None]), radial)
    apart = np.array([np.diff(rotor.planes.probes)[0] for rotor in rotors])
    reach = np.array([rotor.axial.probe_radius for rotor in rotors])
    axial = moving[:, 8] + (reach / apart)[:, None] * (moving[:, 2] - moving[:, 0])
    t = np.arange(channels.shape[-1]) / rotors[0].axis.control_rate
    once = np.empty((len(runs), 7))
    for i, run in enumerate(runs):
        watched = np.stack([moving[i, 0], moving[i, 2], axial[i], *moving[i, 4:8]])
        if abs(run.speed_rpm) * LONGEST < 60:
            once[i] = np.sqrt(2) * watched.std(axis=-1)
            continue
        # The time need not hold whole turns: mean, cosine and sine are fitted together.
        turning = np.stack([np.ones(t.size), np.cos(run.speed * t), np.sin(run.speed * t)])
        once[i] = np.hypot(*np.linalg.solve(turning @ turning.T, turning @ watched.T)[1:])
    rms = moving[:, 4:8].std(axis=-1)
    # Opposite coils carry the bias plus and minus the control current, whose mean carries the weight.
    bias = np.array([rotor.axis.bias_current for rotor in rotors])
    resistance = np.array([rotor.axis.coil_resistance for rotor in rotors])
    squares = (channels[:, 4:8] ** 2).mean(axis=-1)
    loss = resistance * (8 * bias**2 + 2 * squares.sum(axis=-1))
    contact = spun.contact, spun.first_contact
    return RunUp(np.empty(0), radial, once[:, :3], rms, once[:, 3:], loss, *contact, np.sqrt(squares), _gap_error(spun))


def _gap_error(spun: Spun) -> np.ndarray:
    """As `RunUp.gap_error`, (n, 3)."""
    error = spun.gap_error
    if error is None:
        return np.full((len(spun.channels), 3), np.nan)
    rms = np.sqrt((error**2).mean(axis=-1))
    every = np.stack([rms, error.mean(axis=-1), abs(error).max(axis=-1)], axis=-1)
    return np.take_along_axis(every, rms.argmax(axis=-1)[:, None, None], axis=1)[:, 0]
