"""Exponential decay, approximated for kernels."""

from maglev_lanes.pieces import piece


@piece
def faded(q):
    """e^-q for q >= 0 with an error below 1e-8: one over the 16th power of a Taylor series of e^(q / 16)."""
    a = min(q, 64.0) * (1.0 / 16.0)
    s = 1.0 + a * (1.0 + a * (1.0 / 2.0 + a * (1.0 / 6.0 + a * (1.0 / 24.0 + a * (1.0 / 120.0 + a / 720.0)))))
    s = s * s
    s = s * s
    s = s * s
    return 1.0 / (s * s)
