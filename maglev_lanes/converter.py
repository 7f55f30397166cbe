"""Quantisation and limits of a converter between numbers and voltages, as a piece for kernels."""

from maglev_lanes.elementary import nearest
from maglev_lanes.pieces import piece


@piece
def quantised(counts, low, high, rounds):
    """Output counts of a converter with the limits low .. high; rounds: 1, or 0 for an ideal converter."""
    whole = nearest(counts) if rounds > 0.0 else counts
    return min(max(whole, low), high)
