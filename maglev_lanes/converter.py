"""A converter between numbers and voltages, as a piece of kernels."""

import numpy as np

from maglev_lanes.pieces import piece


@piece
def quantised(counts, low, high, rounds):
    """Counts that a converter gives, within low .. high; rounds: 1, or 0 for an ideal one."""
    whole = np.rint(counts) if rounds > 0.0 else counts
    return min(max(whole, low), high)
