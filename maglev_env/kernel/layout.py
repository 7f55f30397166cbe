"""A block of the lane kernel: the rows of an axis as the blocks of the loop declare them, of every axis in turn; then
each axis' linear controller; then, per substep and axis, the rows that every substep has for itself."""

import numpy as np

from maglev_env.loop import self_sensing_pieces
from maglev_env.loop.amplifier import NEXT, NODES
from maglev_env.loop.controller import ARRIVED
from maglev_env.loop.eddy import BRANCHES, EDDY_COMMANDS
from maglev_env.loop.sensor import BEND, CROSS_BEND, MOUNT_BEND, MOUNT_CROSS
from maglev_lanes.layout import LANES

AXIS = self_sensing_pieces.END  # size of an axis: by how much the index of a lane in the second one is larger


def filter_size(order: int) -> int:
    """Size of an axis' linear controller of an order, 0 without: b0, then (b, a, state) for each power of 1 / z.

    Three rows behind the last state stay zero, so that every state has a next one.
    """
    return (3 * order + 4) * LANES if order else 0


def of_substep(flexible: bool) -> np.ndarray:
    """Offsets of the rows that depend on when in a substep the command changes: what the commands themselves carry."""
    maps = [(NEXT, 2), (NODES, 3), (BEND, 2), (CROSS_BEND, 2)]
    if flexible:
        maps += [(MOUNT_BEND, 2), (MOUNT_CROSS, 2)]
    carried = [first + (4 * j + c) * LANES for first, count in maps for j in range(count) for c in (2, 3)]
    branches = [EDDY_COMMANDS + j * LANES for j in range(2 * BRANCHES if flexible else 0)]
    return np.array([ARRIVED, *carried, *branches])


def block_size(axes: int, order: int, substeps: int, delayed: bool, flexible: bool) -> int:
    """Numbers in a block."""
    kept = substeps * len(of_substep(flexible)) * LANES if delayed and substeps > 1 else 0
    return axes * (AXIS + filter_size(order) + kept)
