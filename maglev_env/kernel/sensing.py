"""Self-sensors in a step of the lane kernel: their coils are simulated from switching edge to switching edge."""

from collections.abc import Callable
from dataclasses import fields

import numpy as np

from maglev_env.kernel.layout import AXIS
from maglev_env.kernel.structure import Structure
from maglev_env.loop.self_sensing_pieces import COIL_GAP, SELF, carried_current, gap, show, step_begun, wanted_current
from maglev_lanes.layout import LANES as W
from maglev_lanes.pieces import piece
from selfsense.kernel_pieces import SensorStructure, sensor_pieces


def sensing_pieces(s: Structure) -> tuple[Callable, Callable]:
    """Functions for all lanes and axes: begin(x) before the rotor's step, follow(x, seeds, tick, timing) after it.

    tick is the number of the step since the start; timing is that of `advance.kernel`.
    """
    structure = s.sensed or SensorStructure(*[False] * len(fields(SensorStructure)))
    planar, drifting = s.axes == 2, structure.drifting
    switch, advance, across, read, _ = sensor_pieces(structure)
    current = carried_current(s.actuator_poles, s.delayed, s.flexible)
    begun, target = step_begun(current), wanted_current(current)

    @piece
    def begin(x):
        for i in range(W):
            begun(x, i)
            if planar:
                begun(x, i + AXIS)

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
                for i in range(W):
                    switch(x, i + SELF, target(x, i, ahead), x[i + COIL_GAP])
                    if planar:
                        k = i + AXIS
                        switch(x, k + SELF, target(x, k, ahead), x[k + COIL_GAP])
            if drifting and at + per_cycle > cycle:
                later = ahead + period * per_tick
                for i in range(W):
                    across(x, i + SELF, start, share, gap(x, i, here), target(x, i, later))
                    read(x, i + SELF, seeds[i], count)
                    if planar:
                        k = i + AXIS
                        across(x, k + SELF, start, share, gap(x, k, here), target(x, k, later))
                        read(x, k + SELF, seeds[W + i], count)
            else:
                for i in range(W):
                    advance(x, i + SELF, start, share, gap(x, i, here))
                    read(x, i + SELF, seeds[i], count)
                    if planar:
                        k = i + AXIS
                        advance(x, k + SELF, start, share, gap(x, k, here))
                        read(x, k + SELF, seeds[W + i], count)
        for i in range(W):
            show(x, i)
            if planar:
                show(x, i + AXIS)

    return begin, follow
