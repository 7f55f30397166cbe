"""Functions of one number that the compiler for GPUs knows by other names (see `maglev_lanes.gpu`), as pieces."""

import numpy as np

from maglev_lanes.pieces import piece


@piece
def nearest(a):
    """The nearest whole number; of two, the even one."""
    return np.rint(a)


@piece
def root(a):
    """The square root."""
    return np.sqrt(a)
