"""Run experiments in lanes: to line statistics, one period in memory at a time, or to full recordings."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import scipy
from numpy.typing import NDArray

from estimation.lines.periods import LineStatistics
from maglev_env.rig.excitation import lines_at
from maglev_env.channels import NOISY, SPECTRAL
from maglev_env.experiment import Experiment, recorded_channels, sampling, spectral_channels
from maglev_env.kernel.blocks import Block, blocks_of, common
from maglev_env.kernel.state import State, put_lanes, stretches, waves_of
from maglev_env.loop.amplifier import CURRENT_SQ
from maglev_env.loop.sensor import PEAK_SQ
from maglev_lanes.layout import LANES
from maglev_lanes.line_spectra import LineSpectra
from maglev_lanes.noise import line_noise, series_noise
from maglev_lanes.period_statistics import PeriodStatistics
from maglev_lanes.threads import over_threads


@dataclass(frozen=True)
class SimulatedStatistics:
    """Results of n experiments that share excitations and periods, as the estimators need them.

    Args:
        experiment: one of them.
        gathered: the blocks behind their experiments.
        touchdown_time: (n,), s; nan without a touchdown.
        peak_displacement: (n,), m, over the kept periods; radial on an x-y rig.
        current_rms: (n,), A, over the kept periods; of the axis with the larger one.
        gap_error: error of self-sensing over the kept periods; of the axis with the larger rms.
    """

    experiment: Experiment
    gathered: "Sequence[Gathered]"
    touchdown_time: np.ndarray
    peak_displacement: np.ndarray
    current_rms: np.ndarray
    gap_error: "GapError"

    @cached_property
    def statistics(self) -> LineStatistics:
        """At all excited lines; first axis: experiments; nan after a touchdown."""
        every = np.ones(len(self.touchdown_time), bool)
        return self.at_lines(lines_at(self.experiment.excitations), spectral_channels(self.experiment), every)

    def at_lines(self, lines: np.ndarray, channels: Sequence[str], keep: np.ndarray) -> LineStatistics:
        """The statistics of some experiments (n,), at some of the excited lines and of some channels."""
        first, row_of = self.experiment, np.cumsum(keep) - 1
        names, excited = spectral_channels(first), lines_at(first.excitations)
        places, at = [names.index(name) for name in channels], np.searchsorted(excited, lines)
        count, n = int(keep.sum()), len(places)
        mean = np.full((count, n, len(lines)), np.nan, complex)
        covariance = np.full((count, n, n, len(lines)), np.nan, complex)
        for done in self.gathered:
            members = done.block.members
            lanes = np.flatnonzero(done.state.alive()[: len(members)] & keep[members])
            if not lanes.size:
                continue
            rows = row_of[members[lanes]]
            if rows[-1] - rows[0] == len(rows) - 1:
                of = slice(rows[0], rows[-1] + 1)
                done.statistics.write(mean[of], covariance[of], lanes, places, at)
                continue
            own = mean[rows], covariance[rows]
            done.statistics.write(*own, lanes, places, at)
            mean[rows], covariance[rows] = own
        return LineStatistics(lines * first.fundamental, lines, tuple(channels), mean, covariance, first.periods)


@dataclass(frozen=True)
class GapError:
    """Errors of the sensed displacement (n,), m: rms about zero, mean, largest; nan with a probe."""

    rms: np.ndarray
    bias: np.ndarray
    worst: np.ndarray


@dataclass(frozen=True)
class Gathered:
    """A block behind its experiment: its state at the end, and the statistics over the kept periods."""

    block: Block
    state: State
    statistics: PeriodStatistics


def simulate_statistics(
    experiments: Sequence[Experiment],
    substeps: int = 1,
    threads: int | None = None,
    blocks: Sequence[Block] | None = None,
    gathered: Sequence[Gathered] | None = None,
) -> SimulatedStatistics:
    """Statistics at the excited lines of experiments that share excitations and schedule.

    Args:
        experiments: gains, effects, rig and seed may differ.
        substeps: least number of integration steps per control sample; effects may need more (see `fine_steps`).
        threads: default: all cores; it does not change the results.
        blocks: the lanes of these experiments, see `own_lanes`; None: they are made here.
        gathered: what was simulated of them elsewhere, see `kernel.gpu`; None: they are simulated here.

    Raises:
        ValueError: Experiments differ in excitations, periods, offset or control rate, or keep fewer than two periods.
    """
    first = common(experiments)
    if first.periods < 2:
        raise ValueError("experiment: statistics over periods need at least two kept periods")
    lines = lines_at(first.excitations)
    n, channels, finished = len(experiments), spectral_channels(first), []
    touchdown, peak, rms = np.full(n, np.nan), np.full(n, np.nan), np.full(n, np.nan)
    errors = np.full((3, n), np.nan)
    applied = {place: line_amplitudes(first, place, lines) for place in ("force", "current")}

    def run(block: Block) -> None:
        state = State(block)
        noisy = [i for i, name in enumerate(channels) if not name.startswith("injection")]
        statistics = PeriodStatistics(len(channels), noisy, len(lines))
        for spectra in _block_spectra(block, state, lines, applied):
            statistics.add(spectra)
        take(Gathered(block, state, statistics))

    def take(done: Gathered) -> None:
        block, state = done.block, done.state
        alive = state.alive()[: len(block.members)]
        members, kept = block.members[alive], np.flatnonzero(alive)
        finished.append(done)
        samples = first.periods * first.samples_per_period
        peak[members] = np.sqrt(state.axis_rows(PEAK_SQ)[0, kept])
        rms[members] = np.sqrt(state.axis_rows(CURRENT_SQ)[:, kept].max(axis=0) / samples)
        errors[:, members] = state.gap_errors(samples)[:, kept]
        touchdown[block.members[~alive]] = state.touchdown_time()[: len(block.members)][~alive]

    if gathered is None:
        for _ in over_threads(run, blocks or blocks_of(experiments, substeps), threads):
            pass
    else:
        for done in gathered:
            take(done)
    return SimulatedStatistics(first, finished, touchdown, peak, rms, GapError(*errors))


def simulate_records(experiments: Sequence[Experiment], substeps: int = 1, threads: int | None = None) -> np.ndarray:
    """Time series of experiments at the recorded rate, including the transient periods.

    A recorded rate above the control rate needs as many substeps.

    Args:
        experiments: as for `simulate_statistics`.
        substeps: as for `simulate_statistics`.
        threads: as for `simulate_statistics`.

    Returns:
        (n, channels, samples) of `recorded_channels`; nan after a touchdown.

    Raises:
        ValueError: As `simulate_statistics`, or the period is not a whole number of recorded samples.
    """
    first = common(experiments)
    multiple, every = sampling(first.recorded_rate, first.rig.control_rate)
    periods, axes = first.periods + first.transient_periods, first.rig.axes
    n = first.recorded_per_period
    names = recorded_channels(first)
    records = np.full((len(experiments), len(names), axes, periods * n), np.nan)
    force = np.repeat(np.atleast_2d(first.waveform("force")), multiple, axis=1)[:, ::every]

    def run(block: Block) -> None:
        state = State(block)
        written = block.batch.structure.channels
        kept = block.substeps // multiple if multiple > 1 else every  # steps or samples for each one of the recording
        for i, out in enumerate(stretches(block, state, [waves_of(first)] * periods, multiple > 1)):
            span = slice(i * n, (i + 1) * n)
            put_lanes(out[::kept, ..., : len(block.members)], records[:, : len(written), :, span], block.members)
            for lane, member in enumerate(block.members):
                noise = experiments[member].rig.noise
                records[member, names.index("force"), :, span] = force
                for name, rms in (("current", noise.current), ("force", noise.force)):
                    for axis in range(axes if rms else 0):
                        seed = state.seeds[axis, NOISY.index(name), lane]
                        records[member, names.index(name), axis, span] += series_noise(seed, rms, i, n)
        for lane, time in zip(block.members, state.touchdown_time(), strict=False):
            if not np.isnan(time):
                records[lane, ..., int(np.ceil(time * first.recorded_rate - 1e-6)) :] = np.nan

    blocks = blocks_of(experiments, 1 if multiple > 1 else substeps, every=multiple)
    for _ in over_threads(run, blocks, threads):
        pass
    return records.reshape(len(experiments), len(names) * axes, -1)


def block_periods(experiments: Sequence[Experiment]) -> Iterator[Iterator[np.ndarray]]:
    """The simulator without statistics: for each block an iterator over periods, see `stretches`."""
    first = common(experiments)
    for block in blocks_of(experiments, 1):
        yield stretches(block, State(block), [waves_of(first)] * (first.transient_periods + first.periods))


def line_amplitudes(e: Experiment, place: str, lines: np.ndarray) -> np.ndarray:
    """Complex amplitudes (axes, lines) of the experiment's excitation at a place."""
    return scipy.fft.rfft(np.atleast_2d(e.waveform(place)), axis=-1)[:, lines] * (2 / e.samples_per_period)


def _block_spectra(
    block: Block, state: State, lines: np.ndarray, applied: Mapping[str, np.ndarray]
) -> Iterator[np.ndarray]:
    """Spectra (channels, lines, 2, LANES) of each kept period, real and imaginary parts; channels as
    `spectral_channels`."""
    e, axes, n = block.experiment, state.axes, block.experiment.samples_per_period
    sensed = block.batch.structure.sensed is not None
    at_lines, written = LineSpectra(n, lines), len(block.batch.structure.channels)
    places = (0, 1, 4)[: 2 + sensed]  # of displacement, command and position among the spectral channels
    for period, out in enumerate(stretches(block, state, [waves_of(e)] * (e.transient_periods + e.periods))):
        if period < e.transient_periods:
            state.forget()
            continue
        series = out.reshape(n, -1, LANES)
        spectra = np.empty((len(SPECTRAL) + sensed, axes, len(lines), 2, LANES))
        for axis in range(axes):
            for channel, place in enumerate(places):
                spectra[place, axis] = at_lines(series, axis * written + channel)
            seeds = state.seeds[axis, NOISY.index("force")]
            noise = line_noise(seeds, block.force_noise, period, n, lines)
            spectra[2, axis] = _of_every_lane(applied["force"][axis]) + noise
            spectra[3, axis] = _of_every_lane(applied["current"][axis])
        yield spectra.reshape(-1, len(lines), 2, LANES)


def _of_every_lane(amplitudes: NDArray[np.complex128]) -> np.ndarray:
    """Complex amplitudes (lines,) that all lanes have, as real and imaginary parts, (lines, 2, 1)."""
    return np.stack([amplitudes.real, amplitudes.imag], axis=-1)[..., None]
