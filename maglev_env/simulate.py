"""Run experiments in lanes: to line statistics, one period in memory at a time, or to full recordings."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import chain, islice

import numpy as np
import scipy.fft

from estimation.periods import LineStatistics, line_statistics
from maglev_env import kernel as k
from maglev_env.excitation import lines_at
from maglev_env.experiment import Experiment
from maglev_env.lanes import SEEDED, LaneBatch, lane_batch, structure_of
from maglev_env.noise import line_noise, series_noise
from maglev_env.threads import over_threads

CHANNELS = ("displacement", "command", "current", "force")
# Channels whose spectra the estimators use; the injection is digital and known exactly.
SPECTRAL = ("displacement", "command", "force", "injection")


@dataclass(frozen=True)
class SimulatedStatistics:
    """n experiments that share excitations and periods, as the estimators need them.

    statistics: lane axis first; lanes that touched down hold nan. touchdown_time (n,) s, nan when the rotor never
    reached the clearance. peak_displacement (n,) m and current_rms (n,) A over the kept periods.
    """

    statistics: LineStatistics
    touchdown_time: np.ndarray
    peak_displacement: np.ndarray
    current_rms: np.ndarray


@dataclass(frozen=True)
class _Block:
    batch: LaneBatch
    members: np.ndarray
    force_noise: np.ndarray
    experiment: Experiment
    substeps: int


def simulate_statistics(
    experiments: Sequence[Experiment], substeps: int = 1, threads: int | None = None
) -> SimulatedStatistics:
    """Line statistics of experiments that share excitations and schedule; gains, effects, rig and seed may differ.

    The lines are the excited ones. threads: default all cores; it never changes a result. ValueError when experiments
    do not share excitations, periods, offset and control rate, or keep fewer than two periods.
    """
    first = _common(experiments)
    if first.periods < 2:
        raise ValueError("experiment: statistics over periods need at least two kept periods")
    lines = lines_at(first.excitations)
    n, channels = len(experiments), SPECTRAL
    mean = np.full((n, len(channels), len(lines)), np.nan, complex)
    covariance = np.full((n, len(channels), len(channels), len(lines)), np.nan, complex)
    touchdown, peak, rms = np.full(n, np.nan), np.full(n, np.nan), np.full(n, np.nan)
    injection = first.waveform("current")
    injected = scipy.fft.rfft(injection)[lines] * (2 / injection.size)

    def run(block: _Block) -> None:
        state = _State(block)
        spectra = _block_spectra(block, state, lines, injected)
        begun = list(islice(spectra, 2))
        if len(begun) < 2:  # every lane has touched down
            touchdown[block.members] = state.touchdown_time()[: len(block.members)]
            return
        result = line_statistics(chain(begun, spectra), first.fundamental, lines, channels)
        alive = state.rows[k.ALIVE, : len(block.members)] > 0
        members, kept = block.members[alive], np.flatnonzero(alive)
        mean[members], covariance[members] = result.mean[kept], result.covariance[kept]
        samples = first.periods * first.samples_per_period
        peak[members] = state.rows[k.PEAK, kept]
        rms[members] = np.sqrt(state.rows[k.CURRENT_SQ, kept] / samples)
        touchdown[block.members[~alive]] = state.touchdown_time()[: len(block.members)][~alive]

    for _ in over_threads(run, _blocks(experiments, substeps), threads):
        pass
    statistics = LineStatistics(lines * first.fundamental, lines, channels, mean, covariance, first.periods)
    return SimulatedStatistics(statistics, touchdown, peak, rms)


def simulate_records(experiments: Sequence[Experiment], substeps: int = 1, threads: int | None = None) -> np.ndarray:
    """Time series (n, channels, samples) of `CHANNELS`, transient periods included.

    Samples after a touchdown are nan. ValueError as `simulate_statistics`.
    """
    first = _common(experiments)
    periods, n = first.periods + first.transient_periods, first.samples_per_period
    records = np.full((len(experiments), len(CHANNELS), periods * n), np.nan)
    force = first.waveform("force")

    def run(block: _Block) -> None:
        state = _State(block)
        for i, out in enumerate(_periods(block, state, periods, len(k.CHANNELS))):
            span = slice(i * n, (i + 1) * n)
            records[block.members, : len(k.CHANNELS), span] = out[:, : len(block.members)].transpose(1, 0, 2)
            for lane, member in enumerate(block.members):
                noise, seeds = experiments[member].rig.noise, dict(zip(SEEDED, state.seeds[:, lane], strict=True))
                records[member, CHANNELS.index("force"), span] = force
                for name, rms in (("current", noise.current), ("force", noise.force)):
                    if rms:
                        records[member, CHANNELS.index(name), span] += series_noise(seeds[name], rms, i, n)
        for lane, time in zip(block.members, state.touchdown_time(), strict=False):
            if not np.isnan(time):
                records[lane, :, round(time * first.rig.control_rate) :] = np.nan

    for _ in over_threads(run, _blocks(experiments, substeps), threads):
        pass
    return records


def block_periods(experiments: Sequence[Experiment], outputs: int = 2) -> Iterator[Iterator[np.ndarray]]:
    """The simulator alone: per block an iterator over periods of the first `outputs` kernel channels."""
    first = _common(experiments)
    for block in _blocks(experiments, 1):
        yield _periods(block, _State(block), first.transient_periods + first.periods, outputs)


class _State:
    """The mutable arrays of one block while it runs."""

    def __init__(self, block: _Block) -> None:
        batch = block.batch
        pad = np.minimum(np.arange(k.LANES), batch.rows.shape[1] - 1)
        self.rows = _aligned((len(batch.rows), k.LANES))
        self.rows[:] = batch.rows[:, pad]
        self.seeds = np.ascontiguousarray(batch.seeds[:, pad])
        self.history = np.zeros(batch.history_length * k.LANES)
        self.step = 0
        self._per_second = block.experiment.rig.control_rate * block.substeps

    def touchdown_time(self) -> np.ndarray:
        """Seconds to touchdown per lane, nan for lanes still alive."""
        return np.where(self.rows[k.ALIVE] > 0, np.nan, self.rows[k.STEPS] / self._per_second)


def _aligned(shape: tuple[int, ...]) -> np.ndarray:
    """Uninitialised doubles on a cache line's boundary: a vector load across two lines costs twice."""
    count = int(np.prod(shape))
    raw = np.empty(count + 8)
    start = (-raw.ctypes.data % 64) // 8
    return raw[start : start + count].reshape(shape)


def _common(experiments: Sequence[Experiment]) -> Experiment:
    if not experiments:
        raise ValueError("give at least one experiment")
    first = experiments[0]

    def schedule(e: Experiment) -> tuple:
        return e.excitations, e.periods, e.transient_periods, e.offset, e.rig.control_rate

    if any(schedule(e) != schedule(first) for e in experiments):
        raise ValueError("experiments in one batch must share excitations, periods, offset and control_rate")
    return first


def _blocks(experiments: Sequence[Experiment], substeps: int) -> list[_Block]:
    """Blocks of up to LANES experiments of one structure each, so that a lane never depends on its neighbours."""
    groups: dict[k.Structure, list[int]] = {}
    for i, e in enumerate(experiments):
        groups.setdefault(structure_of(e), []).append(i)
    blocks = []
    for members in groups.values():
        batch = lane_batch([experiments[i] for i in members], substeps)
        for start in range(0, len(members), k.LANES):
            s = slice(start, start + k.LANES)
            part = LaneBatch(batch.structure, batch.rows[:, s], batch.seeds[:, s], batch.history_length)
            noise = [experiments[i].rig.noise.force for i in members[s]]
            noise += noise[-1:] * (k.LANES - len(noise))
            blocks.append(_Block(part, np.array(members[s]), np.array(noise), experiments[members[0]], substeps))
    return blocks


def _periods(block: _Block, state: _State, periods: int, outputs: int) -> Iterator[np.ndarray]:
    """Output (outputs, LANES, samples) of each period; the buffer is reused. Ends when every lane has touched down."""
    e = block.experiment
    step = k.kernel(block.batch.structure, outputs, block.substeps)
    force, injection = e.waveform("force"), e.waveform("current")
    reference = e.waveform("reference") + e.offset
    out = _aligned((outputs, k.LANES, e.samples_per_period))
    tile = _aligned((k.TILE * outputs * k.LANES,))
    for _ in range(periods):
        done = step(
            state.rows.reshape(-1),
            state.seeds.reshape(-1),
            state.history,
            state.step,
            force,
            injection,
            reference,
            tile,
            out.reshape(-1),
        )
        state.step += done
        yield out
        if done < e.samples_per_period:
            return


def _block_spectra(block: _Block, state: _State, lines: np.ndarray, injected: np.ndarray) -> Iterator[np.ndarray]:
    """Per-period spectra (LANES, channels, lines) of the kept periods."""
    e, n = block.experiment, block.experiment.samples_per_period
    driven = scipy.fft.rfft(e.waveform("force"))[lines] * (2 / n)
    seeds = state.seeds[SEEDED.index("force")]
    for period, out in enumerate(_periods(block, state, e.transient_periods + e.periods, 2)):
        if period < e.transient_periods:
            state.rows[[k.PEAK, k.CURRENT_SQ]] = 0.0
            continue
        spectra = np.empty((k.LANES, len(SPECTRAL), len(lines)), complex)
        spectra[:, :2] = scipy.fft.rfft(out, axis=-1)[..., lines].transpose(1, 0, 2) * (2 / n)
        spectra[:, 2] = driven + line_noise(seeds, block.force_noise, period, n, lines)
        spectra[:, 3] = injected
        yield spectra
