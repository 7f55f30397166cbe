"""The decay of what lags exponentially, as pieces of kernels need it."""

from maglev_lanes.pieces import piece


@piece
def faded(q):
    """e^-q of q at least 0, to 1e-8: a series to the 16th power."""
    a = min(q, 64.0) * (1.0 / 16.0)
    s = 1.0 + a * (1.0 + a * (1.0 / 2.0 + a * (1.0 / 6.0 + a * (1.0 / 24.0 + a * (1.0 / 120.0 + a / 720.0)))))
    s = s * s
    s = s * s
    s = s * s
    return 1.0 / (s * s)
