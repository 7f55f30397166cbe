"""Butterflies of a fast Fourier transform: sums of 4 or 5 complex numbers of every lane, turned for the next pass.

A complex number of all lanes has 2 LANES consecutive values: the real parts, then the imaginary ones. Each piece reads
`radix` of them from `a` on, `step` values apart, and writes the results one behind the other into `to` from `b` on.
Result k is multiplied by root^k; `roots` holds the real and the imaginary parts of all roots in turn, `turn` is the
number of the one to take. A piece is made for `lanes`: all of a block, or 1, at which its arrays then begin.
"""

from collections.abc import Callable

import numpy as np

from maglev_lanes.layout import LANES as W
from maglev_lanes.pieces import piece

IM, SIZE = W, 2 * W  # where the imaginary parts begin, and the values of a complex number of all lanes
C1, C2 = float(np.cos(2 * np.pi / 5)), float(np.cos(4 * np.pi / 5))
S1, S2 = float(np.sin(2 * np.pi / 5)), float(np.sin(4 * np.pi / 5))


@piece
def put(to, at, re, im, c, s):
    """Store a complex number turned by the root c + j s."""
    to[at], to[at + IM] = c * re - s * im, c * im + s * re


def four_piece(lanes: int = W) -> Callable:
    @piece
    def four(z, a, step, to, b, roots, turn):
        c1, s1, c2, s2 = roots[2 * turn], roots[2 * turn + 1], roots[4 * turn], roots[4 * turn + 1]
        c3, s3 = roots[6 * turn], roots[6 * turn + 1]
        for i in range(lanes):
            k, o = a + i, b + i
            x0, y0, x1, y1 = z[k], z[k + IM], z[k + step], z[k + step + IM]
            x2, y2, x3, y3 = z[k + 2 * step], z[k + 2 * step + IM], z[k + 3 * step], z[k + 3 * step + IM]
            even_x, even_y, less_x, less_y = x0 + x2, y0 + y2, x0 - x2, y0 - y2
            odd_x, odd_y, off_x, off_y = x1 + x3, y1 + y3, x1 - x3, y1 - y3
            to[o], to[o + IM] = even_x + odd_x, even_y + odd_y
            put(to, o + SIZE, less_x + off_y, less_y - off_x, c1, s1)
            put(to, o + 2 * SIZE, even_x - odd_x, even_y - odd_y, c2, s2)
            put(to, o + 3 * SIZE, less_x - off_y, less_y + off_x, c3, s3)

    return four


def five_piece(lanes: int = W) -> Callable:
    @piece
    def five(z, a, step, to, b, roots, turn):
        c1, s1, c2, s2 = roots[2 * turn], roots[2 * turn + 1], roots[4 * turn], roots[4 * turn + 1]
        c3, s3, c4, s4 = roots[6 * turn], roots[6 * turn + 1], roots[8 * turn], roots[8 * turn + 1]
        for i in range(lanes):
            k, o = a + i, b + i
            x0, y0, x1, y1 = z[k], z[k + IM], z[k + step], z[k + step + IM]
            x2, y2, x3, y3 = z[k + 2 * step], z[k + 2 * step + IM], z[k + 3 * step], z[k + 3 * step + IM]
            x4, y4 = z[k + 4 * step], z[k + 4 * step + IM]
            # Sums and differences of the numbers that lie symmetrically: cosines multiply sums, sines differences.
            near_x, near_y, off_x, off_y = x1 + x4, y1 + y4, x1 - x4, y1 - y4
            far_x, far_y, beyond_x, beyond_y = x2 + x3, y2 + y3, x2 - x3, y2 - y3
            even_x, even_y = x0 + C1 * near_x + C2 * far_x, y0 + C1 * near_y + C2 * far_y
            odd_x, odd_y = S1 * off_x + S2 * beyond_x, S1 * off_y + S2 * beyond_y
            to[o], to[o + IM] = x0 + near_x + far_x, y0 + near_y + far_y
            put(to, o + SIZE, even_x + odd_y, even_y - odd_x, c1, s1)
            put(to, o + 4 * SIZE, even_x - odd_y, even_y + odd_x, c4, s4)
            even_x, even_y = x0 + C2 * near_x + C1 * far_x, y0 + C2 * near_y + C1 * far_y
            odd_x, odd_y = S2 * off_x - S1 * beyond_x, S2 * off_y - S1 * beyond_y
            put(to, o + 2 * SIZE, even_x + odd_y, even_y - odd_x, c2, s2)
            put(to, o + 3 * SIZE, even_x - odd_y, even_y + odd_x, c3, s3)

    return five
