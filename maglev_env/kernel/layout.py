"""Layout of a block of the lane kernel.

First come the rows of each axis, as the blocks of the loop declare them, and those of the waves that drive it; then
each axis' linear controller; then, for each substep and axis, the rows that differ between substeps.
"""

import numpy as np

from maglev_env.loop import self_sensing_pieces
from maglev_env.loop.amplifier import NEXT, NODES
from maglev_env.loop.controller import ARRIVED, ERROR_STATE, HEAD, INPUT_STATE
from maglev_env.loop.eddy import BRANCHES, EDDY_COMMANDS
from maglev_env.loop.sensor import BEND, CROSS_BEND, FURTHER_BEND, FURTHER_CROSS, MOUNT_BEND, MOUNT_CROSS
from maglev_lanes.layout import LANES, rows_after

# WAVE: which of several waves drives a lane (in the first axis); PUSHED, INJECTED, WANTED: its force (N), injection (A)
# and reference (m) of a sample; LOADED: constant force, N. They are used where lanes have waves of their own.
# AXIS: size of an axis, which is the offset between the axes of a lane.
WAVE, PUSHED, INJECTED, WANTED, LOADED, AXIS = rows_after(self_sensing_pieces.END, "WAVE PUSHED INJECTED WANTED LOADED")


def filter_size(order: int, of_error: bool) -> int:
    """Size of an axis' linear controller of an order, see `filter_constants` for its rows; 0 for order 0.

    The rows of one power of 1 / z, behind the last one, stay zero, so that the update of every state can read a
    following one.
    """
    head, power = (1, ERROR_STATE) if of_error else (HEAD, INPUT_STATE)
    return (head + (order + 1) * power) * LANES if order else 0


def of_substep(flexible: bool) -> np.ndarray:
    """Offsets of the rows that depend on when the command changes within a substep: the coefficients of commands."""
    maps = [(NEXT, 2), (NODES, 3), (BEND, 2), (CROSS_BEND, 2)]
    if flexible:
        maps += [(first, 2) for first in (MOUNT_BEND, MOUNT_CROSS, FURTHER_BEND, FURTHER_CROSS)]
    carried = [first + (4 * j + c) * LANES for first, count in maps for j in range(count) for c in (2, 3)]
    branches = [EDDY_COMMANDS + j * LANES for j in range(2 * BRANCHES if flexible else 0)]
    return np.array([ARRIVED, *carried, *branches])
