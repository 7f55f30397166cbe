"""Exponential decay and a logarithm, approximated for kernels."""

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


@piece
def log_beyond(z):
    """ln(1 + z) for z of 0 .. 1 with an error below 1e-7: the series of 2 artanh(w), w = z / (2 + z)."""
    w = z / (2.0 + z)
    s = w * w
    return 2.0 * w * (1.0 + s * (1.0 / 3.0 + s * (0.2 + s * (1.0 / 7.0 + s * (1.0 / 9.0 + s * (1.0 / 11.0))))))
