"""Statistics over periods of many blocks on a GPU; only amplitudes at lines and their statistics leave it."""

from collections.abc import Callable, Iterator, Sequence

import numpy as np

from maglev_env.channels import NOISY, SPECTRAL
from maglev_env.kernel.gpu_pieces import statistics_kernel, step_kernel, transform_kernel
from maglev_env.kernel.blocks import Block
from maglev_env.kernel.fine_steps import FAST_EFFECTS
from maglev_env.kernel.simulate import Gathered, line_amplitudes
from maglev_env.kernel.state import State, waves_of
from maglev_env.rig.excitation import lines_at
from maglev_lanes.gpu import free_memory, require_gpu
from maglev_lanes.layout import LANES
from maglev_lanes.line_spectra import LineSpectra
from maglev_lanes.period_statistics import PeriodStatistics

SHARE = 0.8  # of the free memory that is used
MOST = 1024  # blocks at a time: more are hardly faster, and their statistics take memory here


def refuse_on_gpu(blocks: Sequence[Block]) -> None:
    """Raise ValueError for what is simulated on a processor only."""
    for block in blocks:
        if block.batch.structure.sensed:
            raise ValueError("--device cuda: self-sensing is not simulated on a GPU; use --device cpu, or a probe")
        if block.substeps > 1:
            effects = ", ".join(sorted(FAST_EFFECTS & block.experiment.effects.keys())) or "substeps"
            raise ValueError(
                f"--device cuda: {effects}: what needs more than one integration step per control sample is not "
                "simulated on a GPU; use --device cpu"
            )
        if block.batch.structure.own_waves:
            raise ValueError("--device cuda: waves of each lane are not simulated on a GPU")


def gathered_on_gpu(
    blocks: Sequence[Block], most: int | None = None, empty: Callable[[tuple[int, ...]], np.ndarray] = np.empty
) -> Iterator[Gathered]:
    """Simulate blocks of one schedule; results do not depend on how many are simulated together.

    Args:
        blocks: see `simulate.own_lanes`.
        most: blocks at a time; by default as many as the GPU's memory allows, up to MOST.
        empty: makes the arrays that results are written into.

    Raises:
        ValueError: There is no GPU, or too little memory on it, or it cannot simulate these experiments.
    """
    require_gpu()
    refuse_on_gpu(blocks)
    groups: dict[tuple, list[Block]] = {}
    for block in blocks:
        key = block.batch.structure, block.batch.history_length, block.batch.timing.tobytes()
        groups.setdefault(key, []).append(block)
    for group in groups.values():
        size = min(most or MOST, _fitting(group[0]))
        for start in range(0, len(group), size):
            yield from list(Lanes(group[start : start + size]).gathered(empty))  # its memory is then free for the next


def _fitting(block: Block) -> int:
    """Blocks that fit into the GPU's memory.

    Raises:
        ValueError: None does.
    """
    structure, n = block.batch.structure, block.experiment.samples_per_period
    axes, lines = structure.axes, lines_at(block.experiment.excitations)
    column = LineSpectra(n, lines).length
    numbers = n * axes * len(structure.channels) * LANES + 2 * axes * 2 * column * 2 * LANES
    numbers += (2 * 4 * axes + (3 * axes) ** 2) * len(lines) * 2 * LANES
    numbers += (len(block.batch.rows) + axes * (2 + block.batch.history_length) + 1) * LANES
    free = free_memory()
    if (count := int(SHARE * free / (8 * numbers))) < 1:
        raise ValueError(
            f"--device cuda: {free / 1e6:.0f} MB are free on the GPU; a block of {LANES} lanes takes "
            f"{8 * numbers / SHARE / 1e6:.0f} MB for a period of {n} samples: free some, or use --device cpu"
        )
    return count


class Lanes:
    """Blocks of one structure on the GPU.

    Args:
        blocks: of one structure and schedule.
    """

    def __init__(self, blocks: Sequence[Block]) -> None:
        from numba import cuda

        first, e = blocks[0].batch, blocks[0].experiment
        self.blocks, self.experiment, self.axes = blocks, e, first.structure.axes
        self.states = [State(block) for block in blocks]
        self._step = step_kernel(first.structure.compiled)
        self._transform = transform_kernel(self.axes, len(first.structure.channels))
        self._add = statistics_kernel(self.axes)
        n, count, lines = e.samples_per_period, len(blocks), lines_at(e.excitations)
        self._samples, self._slots = n, first.history_length * LANES
        self._per_block = n * self.axes * len(first.structure.channels) * LANES
        spectra = LineSpectra(n, lines)
        of_lines = len(lines) * 2 * LANES
        self._per_found, self._many = 4 * self.axes * of_lines, len(lines)
        seeds = np.stack([state.seeds for state in self.states])
        noise = np.stack([block.force_noise for block in blocks]) * np.sqrt(2 / n)

        def sent(values: np.ndarray) -> object:
            return cuda.to_device(np.ascontiguousarray(values).reshape(-1))

        self._rows = sent(np.stack([state.rows[self._step.rows] for state in self.states]))
        self._read_seeds, self._force_seeds = (
            sent(seeds[:, :, NOISY.index(name)]) for name in ("displacement", "force")
        )
        self._history = sent(np.zeros(count * self.axes * self._slots))
        self._noisy = first.structure.noise
        self._waves = [sent(wave) for wave in waves_of(e)]
        self._tables = [sent(table) for table in spectra.tables]
        self._noise = sent(noise)
        applied = [line_amplitudes(e, place, lines) for place in ("force", "current")]
        self._applied = [sent(np.stack([a.real, a.imag], axis=-1)) for a in applied]
        self._series = cuda.device_array(count * self._per_block)
        self._scratch = cuda.device_array(count * 2 * self.axes * 2 * spectra.length * 2 * LANES + LANES)
        self._found = cuda.device_array(count * self._per_found)
        self._mean = cuda.device_array(count * self._per_found)
        self._second = cuda.device_array(count * (3 * self.axes) ** 2 * of_lines)
        self._synchronised = cuda.synchronize

    def advance(self, period: int, fresh: bool) -> None:
        """Simulate a period; fresh: whether peaks and sums begin with it."""
        lanes = len(self.blocks) * LANES
        self._step.launch(
            self._rows, self._read_seeds, self._history, self._slots, period * self._samples, fresh,
            self._noisy, *self._waves, self._series, self._per_block, lanes,
        )  # fmt: skip

    def transform(self) -> None:
        """Amplitudes of the period's displacements and commands."""
        threads = len(self.blocks) * 2 * self.axes * LANES
        self._transform(
            self._series, self._per_block, self._samples, *self._tables, self._scratch, self._found, self._per_found,
            threads,
        )  # fmt: skip

    def add(self, period: int, count: int) -> None:
        """Add the period's amplitudes to the statistics, as the count-th."""
        threads, lines = len(self.blocks) * self._many * LANES, self._tables[3]
        self._add(
            self._found, self._mean, self._second, lines, *self._applied, self._force_seeds, self._noise,
            period * (self._samples + 2), count, threads,
        )  # fmt: skip

    def synchronise(self) -> None:
        """Wait until the GPU has done all of this."""
        self._synchronised()

    def gathered(self, empty: Callable[[tuple[int, ...]], np.ndarray] = np.empty) -> Iterator[Gathered]:
        """Simulate all periods and fetch the results, into arrays that `empty` makes."""
        e = self.experiment
        for period in range(e.transient_periods + e.periods):
            self.advance(period, fresh=period == e.transient_periods)
            if period >= e.transient_periods:
                self.transform()
                self.add(period, period - e.transient_periods + 1)
        yield from self.fetched(e.periods, empty)

    def fetched(self, periods: int, empty: Callable[[tuple[int, ...]], np.ndarray] = np.empty) -> Iterator[Gathered]:
        """What lies on the GPU after a number of kept periods, in arrays that `empty` makes."""
        count, noisy = len(self.blocks), 3 * self.axes
        rows = self._rows.copy_to_host().reshape(count, -1, LANES)
        mean = empty((count, len(SPECTRAL) * self.axes, self._many, 2, LANES))
        second = empty((count, noisy, noisy, self._many, 2, LANES))
        self._mean.copy_to_host(mean.reshape(-1))
        self._second.copy_to_host(second.reshape(-1))
        whole = empty((count, *self.states[0].rows.shape))
        for i, (block, state) in enumerate(zip(self.blocks, self.states, strict=True)):
            whole[i] = state.rows
            state.rows = whole[i]
            state.rows[self._step.rows] = rows[i]
            yield Gathered(block, state, PeriodStatistics.of(periods, range(noisy), mean[i], second[i]))
