"""The kernels of a GPU: the step of a structure, the transform of a period, and its statistics; a thread has one lane.

They are made of the same functions as those for a processor, and take flat arrays.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache

import numpy as np

from maglev_env.kernel.layout import AXIS
from maglev_env.kernel.single import lane_stepper
from maglev_env.kernel.structure import Structure
from maglev_env.kernel.touched import touched_rows
from maglev_env.loop.amplifier import CURRENT_SQ
from maglev_env.loop.sensor import PEAK_SQ
from maglev_lanes.butterflies import IM, SIZE
from maglev_lanes.gpu import for_each, gpu_kernel, of_lane, own_rows, thread_number
from maglev_lanes.layout import LANES as W
from maglev_lanes.line_spectra import transformer
from maglev_lanes.noise import drawn
from maglev_lanes.period_statistics import approach, covary
from maglev_lanes.pieces import piece


@dataclass(frozen=True)
class GpuStep:
    """The stepper of a structure.

    Args:
        rows: numbers of the rows that it uses; a lane has no others on the GPU.
        launch: called as launch(rows, seeds, history, slots, first_step, fresh, noisy, force, injection, reference,
            out, per_block, lanes); slots: length of an axis' history, per_block: of a block's output; fresh: whether
            peaks and sums begin anew; others as `single.lane_stepper`.
    """

    rows: np.ndarray
    launch: Callable


@cache
def step_kernel(structure: Structure) -> GpuStep:
    """The stepper of a structure without self-sensors; see `Structure.compiled`."""
    thread = thread_number()
    used, written = touched_rows(structure)
    step, axes, kept = lane_stepper(structure), structure.axes, len(used)
    index_of = {int(r): i for i, r in enumerate(used)}
    stored = [index_of[int(r)] for r in written]
    sums = [a * AXIS + first for a in range(axes) for first in (PEAK_SQ, CURRENT_SQ)]
    own = own_rows((int(used.max()) + 1) * W)

    @piece
    def load_row(x, rows, at, number, index):
        x[number * W] = rows[at + index * W]

    load = for_each(load_row, used)
    store = _chosen(written, stored)
    forget = for_each(_forget, sums)

    def run(rows, seeds, history, slots, first_step, fresh, noisy, force, injection, reference, out, per_block, lanes):
        i = thread()
        if i >= lanes:
            return
        block, lane = i // W, i % W
        at, of_history = block * kept * W + lane, block * axes * slots + lane
        x = own()
        load(x, rows, at)
        if fresh:
            forget(x, rows, at)
        step(
            x, seeds[block * axes * W + lane :], history[of_history:], slots, first_step, noisy, force, injection,
            reference, out[block * per_block + lane :],
        )  # fmt: skip
        store(x, rows, at)

    return GpuStep(used, gpu_kernel(run))


@piece
def _forget(x, rows, at, number, index):
    x[number] = 0.0


def _chosen(written: Sequence[int], places: Sequence[int]) -> Callable:
    """A piece that stores the written rows of a lane at their places among those that a lane has on the GPU."""
    both = [int(row) << 16 | int(place) for row, place in zip(written, places, strict=True)]

    @piece
    def store_row(x, rows, at, number, index):
        rows[at + (number & 0xFFFF) * W] = x[(number >> 16) * W]

    return for_each(store_row, both)


@cache
def transform_kernel(axes: int, written: int) -> Callable:
    """The transform of one period of the displacement and the command of every lane and axis, one a thread.

    Called as launch(series, per_block, samples, radices, roots, whole, lines, at, mirrored, scratch, found, per_found,
    threads), see `line_spectra`; found: filled, (blocks, channels, lines, 2, LANES), of which the first channels are
    displacement and command, axis after axis; scratch: (threads / LANES, 2, numbers of a column, 2, LANES), and LANES
    more.

    Args:
        axes: 1 or 2.
        written: channels of an axis in the series.
    """
    thread, transform = thread_number(), of_lane(transformer(lanes=1))
    jobs, sample = 2 * axes, axes * written * W

    def run(series, per_block, samples, radices, roots, whole, lines, at, mirrored, scratch, found, per_found, threads):
        i = thread()
        if i >= threads:
            return
        lane, task = i % W, i // W
        block, job = task // jobs, task % jobs
        channel, axis = job // axes, job % axes
        column, of_lines = roots.size // 2 * SIZE, lines.size * SIZE
        first = block * per_found + job * of_lines + lane
        out = found[first : first + of_lines - lane]
        for n in range(lines.size):
            out[n * SIZE] = 0.0
            out[n * SIZE + IM] = 0.0
        own = task * 2 * column + lane
        transform(
            series[block * per_block + lane : (block + 1) * per_block], (axis * written + channel) * W, sample,
            samples, radices, roots, whole, lines, at, mirrored, scratch[own : own + column],
            scratch[own + column : own + 2 * column], out,
        )  # fmt: skip
        for n in range(lines.size):
            out[n * SIZE] *= 2.0 / samples
            out[n * SIZE + IM] *= 2.0 / samples

    return gpu_kernel(run)


@cache
def statistics_kernel(axes: int) -> Callable:
    """Adds a period to the statistics of every lane and line, one a thread.

    Called as launch(z, mean, second, lines, force, injection, seeds, rms, first, count, threads).

    Args of the kernel:
        z: (blocks, 4 axes, lines, 2, LANES), the period's displacement and command; the force with its noise and the
            injection are added.
        mean, second: as z, and (blocks, 3 axes, 3 axes, lines, 2, LANES), see `PeriodStatistics.of`.
        force, injection: amplitudes, (axes, lines, 2).
        seeds: of the force's noise, (blocks, axes, LANES); rms: of a part of its amplitudes, (blocks, LANES).
        first: number of the period's first random number.
        count: of the periods up to this one.
    """
    thread, channels, noisy = thread_number(), 4 * axes, 3 * axes

    def run(z, mean, second, lines, force, injection, seeds, rms, first, count, threads):
        i = thread()
        if i >= threads:
            return
        many = lines.size
        lane, n, block = i % W, i // W % many, i // (W * many)
        base, apart = (block * channels * many + n) * SIZE + lane, many * SIZE
        for axis in range(axes):
            seed = seeds[(block * axes + axis) * W + lane]
            for part in range(2):
                number = np.uint64(first) + np.uint64(2) * np.uint64(lines[n]) + np.uint64(1 + part)
                k, given = base + part * W, (axis * many + n) * 2 + part
                z[k + (2 * axes + axis) * apart] = force[given] + drawn(seed, number) * rms[block * W + lane]
                z[k + (3 * axes + axis) * apart] = injection[given]
        pairs = (block * noisy * noisy * many + n) * SIZE + lane
        if count == 1:
            for c in range(channels):
                k = base + c * apart
                mean[k], mean[k + IM] = z[k], z[k + IM]
            for c in range(noisy * noisy):
                k = pairs + c * apart
                second[k], second[k + IM] = 0.0, 0.0
            return
        for c in range(noisy):
            k = base + c * apart
            approach(z, mean, k, count)
            approach(z, mean, k + IM, count)
        share = (count - 1.0) / count
        for a in range(noisy):
            for b in range(a + 1):
                covary(z, second, base + a * apart, base + b * apart, pairs + (a * noisy + b) * apart, share)

    return gpu_kernel(run)
