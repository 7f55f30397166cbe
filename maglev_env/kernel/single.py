"""The step of a lane alone: for a thread of its own on a GPU, or in plain Python.

Its arrays are those of a block (see `advance`), and begin at the lane.
"""

from collections.abc import Callable

import numpy as np

from maglev_env.kernel.advance import CHECKED
from maglev_env.kernel.sample import axis_piece, mix_piece, peak_piece
from maglev_env.kernel.step import move_piece
from maglev_env.kernel.structure import Structure
from maglev_env.loop.mechanics import ALIVE
from maglev_lanes.layout import LANES as W
from maglev_lanes.pieces import piece


def lane_stepper(structure: Structure) -> Callable[..., None]:
    """A piece step(x, seeds, history, slots, first_step, noisy, force, injection, reference, out) of a structure
    without self-sensors, substeps and waves of each lane.

    It advances the lane over the control samples of the waveforms, which are flat, axis after axis; after a touchdown
    it ends early. slots: length of an axis' history; noisy: whether there is noise; out: filled, of which every sample
    has (axes, channels, LANES) numbers.
    """
    axes, channels = structure.axes, len(structure.channels)
    planar, coupled, sample = axes == 2, structure.coupled, axes * channels * W
    read_and_control, move = axis_piece(structure, 1), move_piece(structure, 1)
    mix, peak = mix_piece(structure, 1), peak_piece(1)

    # The axes are written out, without a loop, so that the compiler knows every row and keeps it in a register.
    @piece
    def step(x, seeds, history, slots, first_step, noisy, force, injection, reference, out):
        mask, samples = slots // W - 1, force.size // axes
        for t in range(samples):
            now, o = first_step + t, t * sample
            count = np.uint64(now + 1)
            if coupled:
                mix(x)
            read_and_control(
                x, 0, out, o, reference[t], injection[t], True, noisy, seeds, 1, count, history, slots, mask, now
            )
            if planar:
                wanted, injected = reference[samples + t], injection[samples + t]
                read_and_control(
                    x, 1, out, o, wanted, injected, True, noisy, seeds, 1, count, history, slots, mask, now
                )
                peak(x, out, o, channels * W)
            move(x, force[t], force[samples + t] if planar else 0.0)
            if t % CHECKED == CHECKED - 1 and x[ALIVE] == 0.0:
                return

    return step
