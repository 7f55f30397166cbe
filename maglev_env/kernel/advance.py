"""The lane kernel: one compiled loop that steps LANES simulations of the loop together, in one axis or x-y.

A block is flat arrays with LANES consecutive values per variable (see `maglev_env.kernel.layout`). Blocks are always
full, so a lane's bits do not depend on how many others run beside it.
"""

from collections.abc import Callable
from functools import cache
from threading import Lock

import numpy as np

from maglev_env.kernel.layout import AXIS, filter_size
from maglev_env.kernel.sample import (
    delay_piece,
    draw,
    mix_piece,
    peak_piece,
    read_pieces,
    same_wave,
    substep_piece,
    waves_piece,
)
from maglev_env.kernel.sensing import sensing_pieces
from maglev_env.kernel.step import move_piece
from maglev_env.kernel.structure import Structure
from maglev_env.loop.further.command_path import try_luck
from maglev_env.loop.mechanics import ALIVE
from maglev_lanes.compiled import compiled
from maglev_lanes.layout import FAR, LANES

W = LANES
CHECKED = 8  # samples after which the stepper looks whether a lane is still alive
_MAKING = Lock()  # threads that need a new kernel at the same time make it once


def kernel(structure: Structure) -> Callable[..., int]:
    """The compiled stepper of a structure, shared by all structures that differ only in what is read at run time.

    Called as step(block, seeds, history, first_step, timing, switches, spans, force, injection, reference, out), all
    arrays flat, axis after axis. It advances the block over the control samples of the waveforms.

    Args of the stepper:
        timing: of self-sensors, (4,): timing[0] current samples last as long as timing[1] substeps, and timing[2] of
            them as long as timing[3] PWM periods.
        switches: see `Structure.switches`: whether there is noise; substeps per control sample; whether a sample is
            written for every substep; number of waves.
        spans: substeps of every control sample, of a controller whose ticks jitter; empty: all have the same number.
        force, injection, reference: N, A, m at every control sample, wave after wave.
        out: filled, (samples, axes, channels, LANES); with room for one sample only, each overwrites the one before.

    Returns of the stepper:
        The control samples done: fewer when every lane has touched down.
    """
    with _MAKING:
        return _kernel(structure.compiled)


@cache
def _kernel(structure: Structure) -> Callable[..., int]:
    sources = 0  # see `compiled`
    axes, channels, delayed = structure.axes, len(structure.channels), structure.delayed
    planar, coupled, sensing = axes == 2, structure.coupled, structure.sensed is not None
    sample = axes * channels * W
    filters, per_filter = axes * AXIS, filter_size(structure.controller_order, structure.of_error)
    of_substeps = filters + axes * per_filter
    controlled = structure.magnets != "none"
    read, control, note_late = read_pieces(structure)
    mix, load_substep, move = mix_piece(structure), substep_piece(structure), move_piece(structure)
    delay, further, peak = delay_piece(structure), structure.further, peak_piece()
    own_waves, load_waves = structure.own_waves, waves_piece(structure)
    sensors_begin, sensors_follow = sensing_pieces(structure)

    def step(x, seeds, history, first_step, timing, switches, spans, force, injection, reference, out):
        if sources == 0:
            return 0
        noisy, substeps, oversampled = switches[0] != 0, switches[1], switches[2] != 0
        lanes = seeds.size // axes
        slots = history.size // axes
        mask = np.int64(slots // W - 1)
        samples = force.size // (axes * switches[3])
        kept = out.size > sample
        same = own_waves and same_wave(x)
        for t in range(samples):
            now = np.int64(first_step + t)
            if own_waves:
                load_waves(x, force, injection, reference, samples, t, same)
            last = spans[t] if spans.size > 0 else substeps
            for s in range(last):
                n = t * substeps + s if oversampled else t
                # The mask tells the compiler that no index is negative.
                o = (n * sample) & FAR if kept else 0
                reading = s == 0 or oversampled
                # Readings between control samples take noise from counts 2^40 apart, so that the noise at control
                # samples is the same at every recorded rate.
                count = np.uint64(now + 1 + (np.int64(s) << 40))
                if delayed and substeps > 1:
                    load_substep(x, of_substeps, min(s, substeps - 1))
                if coupled and reading:
                    mix(x)
                for a in range(axes if reading else 0):
                    b, p = a * AXIS, o + a * channels * W
                    if noisy:
                        draw(x, b, seeds, a * W, lanes, count)
                    wanted, injected = reference[a * samples + t], injection[a * samples + t]
                    if not controlled or s > 0:
                        read(x, b, out, p, 1.0 if s == 0 else 0.0)
                    else:
                        control(x, b, out, p, wanted, injected, filters + a * per_filter)
                    if further and s == 0:
                        try_luck(x, b, seeds, a * W, lanes, count)
                    if delayed and s == 0:
                        delay(x, b, history, a * slots, mask, now)
                    note_late(x, b, out, p)
                if planar and reading:
                    peak(x, out, o, channels * W)
                if sensing:
                    sensors_begin(x)
                move(x, force[t], force[samples + t] if planar else 0.0)
                if sensing:
                    sensors_follow(x, seeds, now * substeps + s, timing)
            if t % CHECKED == CHECKED - 1:
                living = 0.0
                for i in range(W):
                    living += x[ALIVE + i]
                if living == 0.0:
                    return t + 1
        return samples

    return compiled(step)
