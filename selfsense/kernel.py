"""The self-sensing kernel: one compiled loop that steps LANES coils with their supplies and estimators together."""

from collections.abc import Callable
from functools import cache

import numpy as np

from maglev_lanes.compiled import compiled
from selfsense.kernel_pieces import SensorStructure, sensor_pieces
from maglev_lanes.layout import LANES
from selfsense.kernel_rows import ESTIMATE, FORWARD, GAP, READING, VOLT_SECONDS

W = LANES
# Channels per sample: estimated gap (m), amplitude of the ripple after the forward path (A), current reading (A),
# integral of the switching voltage's level since the previous sample (s).
CHANNELS = ("estimate", "amplitude", "current", "volt_seconds")


@cache
def kernel(structure: SensorStructure, outputs: int) -> Callable[..., None]:
    """The compiled stepper for a structure that writes the first `outputs` of CHANNELS.

    Called as step(block, seeds, first_sample, samples, per_cycle, cycle, every, gap, drive, out), all arrays flat.

    Args of the stepper:
        per_cycle, cycle: `per_cycle` PWM periods last as long as `cycle` samples.
        gap: (samples, LANES), m.
        drive: (samples, LANES), used at the samples at which a PWM period begins: -1 .. 1, or with a regulator the
            current (A) at that period's end.
        out: filled, (outputs, samples // every, LANES): one of `every` samples, counted from sample 0.
    """
    return _make(structure, outputs)


def _make(structure, outputs):
    sources, drifting = 0, structure.drifting  # see `compiled`
    switch, advance, advance_across, read, _ = sensor_pieces(structure)

    def step(x, seeds, first_sample, samples, per_cycle, cycle, every, gap, drive, out):
        if sources == 0:
            return
        written = np.int64(0)
        kept = samples // every
        share = per_cycle / cycle
        for n in range(samples):
            at = np.int64((first_sample + n) * per_cycle % cycle)
            start = at / cycle
            r = n * W
            if at == 0:
                for i in range(W):
                    switch(x, i, drive[r + i], x[GAP + i])
            count = np.uint64(np.int64(first_sample + n + 1))
            # The loops are as large as possible, because the compiler unrolls small ones and does not vectorise them.
            if drifting and at + per_cycle > cycle:
                for i in range(W):
                    advance_across(x, i, start, share, gap[r + i], drive[r + i])
                    read(x, i, seeds[i], count)
            else:
                for i in range(W):
                    advance(x, i, start, share, gap[r + i])
                    read(x, i, seeds[i], count)
            if (first_sample + n + 1) % every == 0:
                o = written * W
                for i in range(W):
                    out[o + i] = x[ESTIMATE + i]
                if outputs > 1:
                    for i in range(W):
                        out[kept * W + o + i] = x[FORWARD + i]
                if outputs > 2:
                    for i in range(W):
                        out[2 * kept * W + o + i] = x[READING + i]
                if outputs > 3:
                    for i in range(W):
                        out[3 * kept * W + o + i] = x[VOLT_SECONDS + i]
                written += 1

    return compiled(step)
