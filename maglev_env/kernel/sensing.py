"""Self-sensors in a step of the lane kernel: their coils are simulated from switching edge to switching edge."""

from collections.abc import Callable
from dataclasses import fields

from maglev_env.kernel.layout import AXIS
from maglev_env.kernel.structure import Structure
from maglev_env.loop.self_sensing_pieces import SELF, carried_current, gap_of, show, step_begun, target_of
from maglev_lanes.layout import LANES as W
from maglev_lanes.pieces import piece
from selfsense.kernel_pieces import SensorStructure
from selfsense.kernel_loop import follow_piece


def sensing_pieces(s: Structure) -> tuple[Callable, Callable]:
    """Functions for all lanes and axes: begin(x) before the rotor's step, follow(x, seeds, tick, timing) after it.

    tick is the number of the step since the start; timing is that of `advance.kernel`.
    """
    structure = s.sensed or SensorStructure(*[False] * len(fields(SensorStructure)))
    axes = s.axes
    current = carried_current(s.actuator_poles, s.delayed, s.flexible)
    begun = step_begun(current)
    sense = follow_piece(structure, axes, (SELF, AXIS, 0), gap_of(AXIS), target_of(current, AXIS))

    @piece
    def begin(x):
        for p in range(axes):
            for i in range(W):
                begun(x, i + p * AXIS)

    @piece
    def follow(x, seeds, tick, timing):
        sense(x, seeds, tick, timing)
        for p in range(axes):
            for i in range(W):
                show(x, i + p * AXIS)

    return begin, follow
