"""Logarithm and exponential for pulls with any exponent of the gap, approximated for kernels.

The compiler makes vector instructions of these formulas, and none of the exact functions.
"""

from maglev_lanes.elementary import root
from maglev_lanes.pieces import piece


@piece
def logarithm(r):
    """ln r with an absolute error below 1e-12 for r = 0.2 .. 2.

    Down to 1e-3 the error is below 1e-5; smaller r count as 1e-3.
    """
    q = root(root(root(max(r, 1e-3))))
    t = (q - 1.0) / (q + 1.0)
    s = t * t
    return 16.0 * t * (1.0 + s * (1.0 / 3.0 + s * (1.0 / 5.0 + s * (1.0 / 7.0 + s * (1.0 / 9.0 + s / 11.0)))))


@piece
def exponential(z):
    """e^z with a relative error below 2e-12 for |z| <= 8.

    Up to 20 the error is below 1e-8, up to 64 below 5e-4; larger |z| count as 64.
    """
    a = min(max(z, -64.0), 64.0) * (1.0 / 64.0)
    s = 1.0 / 720.0 + a * (1.0 / 5040.0 + a / 40320.0)
    s = 1.0 + a * (1.0 + a * (1.0 / 2.0 + a * (1.0 / 6.0 + a * (1.0 / 24.0 + a * (1.0 / 120.0 + a * s)))))
    s = s * s
    s = s * s
    s = s * s
    s = s * s
    s = s * s
    return s * s
