"""Amplitudes of periodic series at spectral lines, for all lanes of a block at once.

A period is divided into columns of every so-many-th sample. Two columns are the real and the imaginary parts of one
complex series, which is transformed by passes of constant geometry (Pease 1968): each reads numbers that are the same
distance apart in every pass, and writes its results one behind the other. Only the lines that are asked for are then
put together from the columns, so that a prime number of samples is slower, but needs no other method.
"""

from collections.abc import Callable
from functools import cache, lru_cache
from threading import Lock

import numpy as np

from maglev_lanes.butterflies import IM, SIZE, five_piece, four_piece
from maglev_lanes.compiled import compiled
from maglev_lanes.layout import FAR
from maglev_lanes.layout import LANES as W
from maglev_lanes.pieces import exact, piece

LONGEST = (
    512  # numbers of a column: two copies of as many, of all lanes, fit into the second cache of common processors
)
RADICES = (5, 4)  # the more there are, the longer the compiler takes; other factors are left to the lines
_MAKING = Lock()  # threads that need a kernel at the same time make it once


class LineSpectra:
    """The transform of periods of a length at lines.

    Args:
        samples: of a period.
        lines: harmonic numbers (n,), from 0 up to half of the samples.

    Attributes:
        length: numbers of a column.
        tables: what the compiled function takes from `radices` to `mirrored`.
    """

    def __init__(self, samples: int, lines: np.ndarray) -> None:
        self._samples, lines, radices = samples, np.asarray(lines, np.int64), _radices(samples)
        self.length = int(np.prod(radices))
        places = _places(self.length, radices)
        at, mirrored = places[lines % self.length], places[-lines % self.length]
        self.tables = radices, _roots(self.length), _roots(samples), lines, at, mirrored

    def __call__(self, series: np.ndarray, channel: int) -> np.ndarray:
        """Amplitudes (peak, cosine convention) of one channel, real and imaginary parts, (n, 2, LANES).

        Args:
            series: (samples, channels, LANES), contiguous.
            channel: number of the channel.
        """
        scratch = np.empty((2, self.length * SIZE))
        found = np.zeros((len(self.tables[3]), 2, W))
        with _MAKING:
            transform = _transform()
        transform(
            series.reshape(-1), channel * W, series.shape[1] * W, self._samples, *self.tables, *scratch,
            found.reshape(-1),
        )  # fmt: skip
        found *= 2 / self._samples
        return found


def _radices(samples: int) -> np.ndarray:
    """Factors of the longest column up to LONGEST, or nearly."""
    found: list[int] = []
    for radix in RADICES:
        while samples % radix == 0 and radix * int(np.prod(found)) <= LONGEST:
            found.append(radix)
            samples //= radix
    return np.array(found, np.int64)


@lru_cache(maxsize=64)
def _roots(n: int) -> np.ndarray:
    """e^(-2 pi j k / n) for all k, real and imaginary parts in turn, (2 n,)."""
    return np.exp(-2j * np.pi * np.arange(n) / n).view(float)


def _places(length: int, radices: np.ndarray) -> np.ndarray:
    """Where the passes leave each frequency: their digits come out in reverse order."""
    rest, places, size = np.arange(length), np.zeros(length, np.int64), length
    for radix in radices:
        size //= int(radix)
        places += rest % radix * size
        rest //= radix
    return places


def pass_piece(lanes: int = W) -> Callable:
    """one(z, to, radix, done, roots): a pass over a column, behind others by radices whose product is `done`."""
    four, five = four_piece(lanes), five_piece(lanes)

    @piece
    def one(z, to, radix, done, roots):
        many = roots.size // 2 // radix
        step = (many * SIZE) & FAR
        for first in range(0, many, done):  # all of `done` numbers are turned alike
            for p in range(first, first + done):
                a, b, turn = (p * SIZE) & FAR, (p * radix * SIZE) & FAR, first
                if radix == 5:
                    five(z, a, step, to, b, roots, turn)
                else:
                    four(z, a, step, to, b, roots, turn)

    return one


@piece
def load(series, first, sample, column, columns, z, lanes):
    """Copy a column and its right neighbour, if there is one, as one complex series."""
    beside = sample if column + 1 < columns else 0
    share = 1.0 if beside > 0 else 0.0
    for n in range(z.size // SIZE):
        at, to = (column + columns * n) * sample + first, n * SIZE
        own, late, re, im = np.uint64(at), np.uint64(at + beside), np.uint64(to), np.uint64(to + IM)
        for i in range(np.uint64(lanes)):
            z[re + i] = series[own + i]
            z[im + i] = share * series[late + i]


# Not of complex numbers: the compiler keeps one product of these for the whole process, with the assumptions of the
# kernel that asked for it first, and the last bits of others would depend on what was compiled before them.
@exact
def product(a, b, c, d):
    """Real and imaginary part of (a + j b) (c + j d)."""
    return a * c - b * d, a * d + b * c


@piece
def gather(z, column, whole, lines, at, mirrored, found, lanes):
    """Add what a transformed pair of columns contributes to the lines.

    With Z of a real and an imaginary series, these have (Z + Z~) / 2 and (Z - Z~) / 2j, where Z~ is the conjugate
    at the mirrored frequency. The second one is a sample later.
    """
    im = np.uint64(IM)
    for n in range(lines.size):
        t, k = column * lines[n] % (whole.size // 2), lines[n]
        c, s, late_c, late_s = whole[2 * t], whole[2 * t + 1], whole[2 * k], whole[2 * k + 1]
        ux, uy = product(c, s, 0.5 + 0.5 * late_s, -0.5 * late_c)
        vx, vy = product(c, s, 0.5 - 0.5 * late_s, 0.5 * late_c)
        p, q, o = np.uint64(at[n] * SIZE), np.uint64(mirrored[n] * SIZE), np.uint64(n * SIZE)
        for i in range(np.uint64(lanes)):
            zx, zy, mx, my = z[p + i], z[p + im + i], z[q + i], z[q + im + i]
            found[o + i] += ux * zx - uy * zy + vx * mx + vy * my
            found[o + im + i] += ux * zy + uy * zx - vx * my + vy * mx


@cache
def _transform() -> Callable[..., None]:
    return compiled(transformer())


def transformer(lanes: int = W) -> Callable[..., None]:
    """The function that is compiled to the transform of a block's lanes, or of 1, whose arrays begin at that lane."""
    sources = 0  # see `compiled`
    one = pass_piece(lanes)

    def transform(series, first, sample, samples, radices, roots, whole, lines, at, mirrored, z, other, found):
        """Amplitudes times half the samples, added to `found`, (lines, 2, LANES).

        Args of the compiled function:
            series: flat; `first`: where the channel begins in each sample; `sample`: values of a sample.
            z, other: scratch for one column each.
        """
        if sources == 0:
            return
        columns = samples // (roots.size // 2)
        for column in range(0, columns, 2):
            load(series, first, sample, column, columns, z, lanes)
            done = np.int64(1)  # typed, because the compiler would make a second pass of a constant
            for j in range(radices.size):
                if j % 2 == 0:
                    one(z, other, radices[j], done, roots)
                else:
                    one(other, z, radices[j], done, roots)
                done *= radices[j]
            if radices.size % 2 == 0:
                gather(z, column, whole, lines, at, mirrored, found, lanes)
            else:
                gather(other, column, whole, lines, at, mirrored, found, lanes)

    return transform
