"""A block of lanes while it runs: its state, and the series that the kernel writes."""

from collections.abc import Iterator, Sequence

import numpy as np

from maglev_env.channels import NOISY
from maglev_env.experiment import Experiment
from maglev_env.kernel.advance import kernel
from maglev_env.kernel.blocks import Block
from maglev_env.kernel.layout import AXIS
from maglev_env.loop.amplifier import CURRENT_SQ
from maglev_env.loop.mechanics import ALIVE, STEPS
from maglev_env.loop.self_sensing_pieces import OFF_PEAK, OFF_SQ, OFF_SUM
from maglev_env.loop.sensor import PEAK_SQ
from maglev_lanes.layout import LANES, aligned, row

REGULAR = np.empty(0, np.int64)  # no ticks of their own
TOGETHER = 256  # samples


class State:
    """The mutable arrays of one block while it runs."""

    def __init__(self, block: Block) -> None:
        batch = block.batch
        pad = np.minimum(np.arange(LANES), batch.rows.shape[1] - 1)
        self.axes = batch.structure.axes
        self.rows = aligned((len(batch.rows), LANES))
        self.rows[:] = batch.rows[:, pad]
        self.seeds = np.ascontiguousarray(batch.seeds[..., pad])
        self.history = np.zeros(self.axes * batch.history_length * LANES)
        self.timing = batch.timing
        self.step = 0
        self._per_second = block.experiment.rig.control_rate * block.substeps
        self._sensing = batch.structure.sensed is not None

    def axis_rows(self, offset: int) -> np.ndarray:
        """One row of every axis, (axes, LANES), a view."""
        return self.rows[row(offset) : self.axes * row(AXIS) : row(AXIS)]

    def forget(self) -> None:
        """Reset the values that are accumulated over the kept periods."""
        for gathered in (PEAK_SQ, CURRENT_SQ, OFF_SUM, OFF_SQ, OFF_PEAK):
            self.axis_rows(gathered)[:] = 0.0

    def gap_errors(self, samples: int) -> np.ndarray:
        """Rms, bias and maximum of the sensed displacement's error over a number of samples, (3, LANES), m."""
        if not self._sensing:
            return np.full((3, LANES), np.nan)
        rms, bias = np.sqrt(self.axis_rows(OFF_SQ) / samples), self.axis_rows(OFF_SUM) / samples
        all_three = np.stack([rms, bias, self.axis_rows(OFF_PEAK)])
        return np.take_along_axis(all_three, rms.argmax(axis=0)[None, None], axis=1)[:, 0]

    def alive(self) -> np.ndarray:
        """Which lanes have not touched down."""
        return self.rows[row(ALIVE)] > 0

    def touchdown_time(self) -> np.ndarray:
        """Seconds to touchdown per lane, nan for lanes still alive."""
        return np.where(self.alive(), np.nan, self.rows[row(STEPS)] / self._per_second)


def stretches(
    block: Block,
    state: State,
    schedule: Sequence[Sequence[np.ndarray]],
    oversampled: bool = False,
    silent: int = 0,
    waves: int = 1,
    spans: np.ndarray = REGULAR,
) -> Iterator[np.ndarray]:
    """Output (samples, axes, channels, LANES) of each stretch of a schedule; the buffer is reused. Ends when all have
    touched down.

    Args:
        block: the lanes.
        state: their state, which advances.
        schedule: force, injection and reference of each stretch, flat, wave after wave.
        oversampled: whether every substep is written.
        silent: number of stretches at the beginning whose output is not wanted; they yield nothing.
        waves: number of waves from which the lanes choose.
        spans: integration steps of every control sample of the schedule; by default all have `Block.substeps`.
    """
    axes, structure = state.axes, block.batch.structure
    step, switches = kernel(structure), structure.switches(block.substeps, oversampled, waves)
    of_sample = axes, len(structure.channels), LANES
    longest = max(driven[0].size for driven in schedule[silent:]) // (axes * waves)
    out = aligned((longest * (block.substeps if oversampled else 1), *of_sample))
    unseen = aligned((1, *of_sample))
    kernel_seeds = np.ascontiguousarray(state.seeds[:, NOISY.index("displacement")]).reshape(-1)
    for i, driven in enumerate(schedule):
        samples = driven[0].size // (axes * waves)
        own, to = spans[state.step : state.step + samples], unseen if i < silent else out
        clocks = state.step, state.timing, switches, own
        done = step(state.rows.reshape(-1), kernel_seeds, state.history, *clocks, *driven, to.reshape(-1))
        state.step += done
        if done < samples:
            out[done * (block.substeps if oversampled else 1) :] = 0.0  # where nothing was written may be a nan
        if i >= silent:
            yield out
        if done < samples:
            return


def put_lanes(series: np.ndarray, to: np.ndarray, rows: np.ndarray) -> None:
    """Copy series (samples, axes, channels, lanes) into rows of another array, (n, channels, axes, samples).

    Few samples at a time stay in the fast memory until all lanes have been read.
    """
    for at in range(0, len(series), TOGETHER):
        part = series[at : at + TOGETHER].transpose(3, 2, 1, 0)
        to[rows, ..., at : at + part.shape[-1]] = part


def waves_of(e: Experiment) -> list[np.ndarray]:
    """One period of force, injection and reference, axis after axis, in the kernel's layout."""
    reference = np.atleast_2d(e.waveform("reference"))
    reference[0] += e.offset
    return [np.ravel(e.waveform("force")), np.ravel(e.waveform("current")), reference.reshape(-1)]
