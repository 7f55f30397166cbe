"""The step of a lane alone: for a thread of its own on a GPU, or in plain Python.

Its arrays are those of a block (see `advance`), and begin at the lane.
"""

from collections.abc import Callable

import numpy as np

from maglev_env.kernel.advance import CHECKED
from maglev_env.kernel.layout import AXIS, filter_size
from maglev_env.kernel.sample import delay_piece, draw, mix_piece, peak_piece, read_pieces
from maglev_env.kernel.step import move_piece
from maglev_env.kernel.structure import Structure
from maglev_env.loop.further.command_path import try_luck
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
    mix, peak, move = mix_piece(structure, 1), peak_piece(1), move_piece(structure, 1)
    read_and_control = _axis_piece(structure)

    # The axes are written out, without a loop, so that the compiler knows every row and keeps it in a register.
    @piece
    def step(x, seeds, history, slots, first_step, noisy, force, injection, reference, out):
        mask, samples = slots // W - 1, force.size // axes
        for t in range(samples):
            now, o = first_step + t, t * sample
            if coupled:
                mix(x)
            read_and_control(x, 0, seeds, noisy, history, slots, mask, now, out, o, reference[t], injection[t])
            if planar:
                wanted, injected = reference[samples + t], injection[samples + t]
                read_and_control(x, 1, seeds, noisy, history, slots, mask, now, out, o, wanted, injected)
                peak(x, out, o, channels * W)
            move(x, force[t], force[samples + t] if planar else 0.0)
            if t % CHECKED == CHECKED - 1 and x[ALIVE] == 0.0:
                return

    return step


def _axis_piece(s: Structure) -> Callable:
    """A piece of all that axis `a` does at a control sample before the rotor moves, in the order of `advance`."""
    read, control, late = read_pieces(s, 1)
    delay, delayed, further, controlled = delay_piece(s, 1), s.delayed, s.further, s.magnets != "none"
    filters, per_filter = s.axes * AXIS, filter_size(s.controller_order, s.of_error)
    channels = len(s.channels)

    @piece
    def read_and_control(x, a, seeds, noisy, history, slots, mask, now, out, o, reference, injection):
        b, p, count = a * AXIS, o + a * channels * W, np.uint64(now + 1)
        if noisy:
            draw(x, b, seeds, a * W, 1, count)
        if controlled:
            control(x, b, out, p, reference, injection, filters + a * per_filter)
        else:
            read(x, b, out, p, 1.0)
        if further:
            try_luck(x, b, seeds, a * W, 1, count)
        if delayed:
            delay(x, b, history, a * slots, mask, now)
        late(x, b, out, p)

    return read_and_control
