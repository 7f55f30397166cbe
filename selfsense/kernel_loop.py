"""Pieces of a self-sensor in a levitation loop: what its coil sees of motion and amplifier, its clock and its reading.

They take the block x and the index k of the lane in the sensor's rows. Times are in steps of the integration, from the
start of the present one.
"""

from collections.abc import Callable

import numpy as np

from maglev_lanes.layout import LANES as W
from maglev_lanes.pieces import piece
from selfsense.kernel_pieces import SensorStructure, sensor_pieces
from selfsense.kernel_rows import (
    BEGUN_CURRENT, BEGUN_V, BEGUN_Y, ESTIMATE, GAP, OFF_PEAK, OFF_SQ, OFF_SUM, REST_CURRENT, REST_GAP, SCALE, SHIFT,
)  # fmt: skip


@piece
def begin_step(x, k, y, v, current):
    """Store the displacement (m), its change in a whole step at this rate (m), and the control current (A)."""
    x[k + BEGUN_Y], x[k + BEGUN_V], x[k + BEGUN_CURRENT] = y, v, current
    return 0.0


@piece
def moved_gap(x, k, rest, offset, y, v, here):
    """The coil's gap (m) at a fraction of the step, by the cubic through the motion at both its ends.

    rest: gap at rest; offset: displacement of the magnetic centre; y, v: as of `begin_step`, at the step's end.
    """
    left = 1.0 - here
    ends = x[k + BEGUN_Y] * (left * left * (1.0 + 2.0 * here)) + y * (here * here * (3.0 - 2.0 * here))
    bend = x[k + BEGUN_V] * left - v * here
    return rest - (ends + offset) - bend * (here * left)


@piece
def wanted_current(x, k, current, ahead):
    """The wanted mean coil current (A) at a time `ahead`: the change of the control current is carried on linearly."""
    begun = x[k + BEGUN_CURRENT]
    return x[k + REST_CURRENT] + begun + (current - begun) * ahead


@piece
def displacement(x, k):
    """The displacement (m) that corresponds to the estimated gap."""
    return x[k + SCALE] * (x[k + REST_GAP] - x[k + ESTIMATE]) + x[k + SHIFT]


@piece
def note_error(x, k, off):
    """Accumulate sum, sum of squares and peak of the reading's error (m)."""
    x[k + OFF_SUM] += off
    x[k + OFF_SQ] += off * off
    x[k + OFF_PEAK] = max(x[k + OFF_PEAK], abs(off))
    return 0.0


def follow_piece(
    structure: SensorStructure, sites: int, places: tuple[int, int, int], gap: Callable, target: Callable
) -> Callable:
    """follow(x, seeds, tick, timing): switches, currents and readings of all sensors in the step that has been taken.

    tick is the number of the step since the start. timing[0] current samples last as long as timing[1] steps, and
    timing[2] of them as long as timing[3] PWM periods.

    Args:
        structure: Of all sensors.
        sites: Number of sensors in a lane.
        places: Offset of the first sensor's rows, distance of the following ones, and offset of the first one's seed.
        gap: gap(x, i, p, here): of sensor p in lane i at a fraction of the step, m.
        target: target(x, i, p, ahead): its wanted mean current, A.
    """
    first, stride, own_seeds = places
    drifting = structure.drifting
    switch, advance, across, read, _ = sensor_pieces(structure)

    # Each loop over lanes is as large as possible, because the compiler unrolls small ones and does not vectorise them.
    @piece
    def follow(x, seeds, tick, timing):
        ticks, cycle, per_cycle = timing[1], timing[2], timing[3]
        share, period = per_cycle / cycle, cycle / per_cycle
        for m in range(tick * timing[0] // ticks, (tick + 1) * timing[0] // ticks):
            at, count = m * per_cycle % cycle, np.uint64(m + 1)
            start, per_tick = at / cycle, ticks / timing[0]
            here = (m + 1) * per_tick - tick
            ahead = (m - start * period + period) * per_tick - tick
            if at == 0:
                for p in range(sites):
                    for i in range(W):
                        k = i + first + p * stride
                        switch(x, k, target(x, i, p, ahead), x[k + GAP])
            if drifting and at + per_cycle > cycle:
                later = ahead + period * per_tick
                for p in range(sites):
                    for i in range(W):
                        k = i + first + p * stride
                        across(x, k, start, share, gap(x, i, p, here), target(x, i, p, later))
                        read(x, k, seeds[own_seeds + p * W + i], count)
            else:
                for p in range(sites):
                    for i in range(W):
                        k = i + first + p * stride
                        advance(x, k, start, share, gap(x, i, p, here))
                        read(x, k, seeds[own_seeds + p * W + i], count)

    return follow
