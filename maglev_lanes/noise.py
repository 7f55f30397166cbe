"""White noise by address: any sample or spectral line of any seed is computed without the ones before it."""

from collections.abc import Callable
from functools import cache

import numpy as np

from maglev_lanes.compiled import compiled
from maglev_lanes.pieces import piece

_GOLDEN = np.uint64(0x9E3779B97F4A7C15)
# The sum of four 16-bit uniform numbers, and an odd polynomial that gives it the 2nd, 4th and 6th moments of a normal
# distribution.
_UNIFORM_MEAN = 131070.0
_PER_UNIFORM_STD = float(1.0 / np.sqrt(4 * (65536.0**2 - 1) / 12))
_G1, _G3, _G5 = 9.71507118e-01, 8.82926499e-04, 2.33126057e-03


@piece
def drawn(seed, count):
    """The count-th standard normal of a 64-bit seed (SplitMix64, within 4.57 standard deviations)."""
    z = seed + count * _GOLDEN
    z = (z ^ (z >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    z = (z ^ (z >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    z = z ^ (z >> np.uint64(31))
    low = np.uint64(0xFFFF)
    s = (z & low) + ((z >> np.uint64(16)) & low) + ((z >> np.uint64(32)) & low) + (z >> np.uint64(48))
    w = (np.float64(np.int64(s)) - _UNIFORM_MEAN) * _PER_UNIFORM_STD
    w2 = w * w
    return w * (_G1 + w2 * (_G3 + w2 * _G5))


@cache
def _pairs() -> Callable[..., None]:
    sources = 0  # see `compiled`

    def pairs(seeds, first, lines, out):
        if sources == 0:
            return
        lanes = np.uint64(seeds.size)  # unsigned: see `maglev_env.kernel.sample.draw`
        for j in range(2 * lines.size):
            count = first + np.uint64(2) * np.uint64(lines[j // 2]) + np.uint64(1 + j % 2)
            at = np.uint64(j) * lanes
            for i in range(lanes):
                out[at + i] = drawn(seeds[i], count)

    return compiled(pairs)


def line_noise(seeds: np.ndarray, rms: np.ndarray, period: int, samples: int, lines: np.ndarray) -> np.ndarray:
    """Amplitudes of white noise at lines of one period, real and imaginary parts, (lines, 2, n).

    Noise that is white in time is white over the lines of a period, so a few lines need only a few random numbers.

    Args:
        seeds: (n,) uint64.
        rms: (n,).
        period: Number of the period.
        samples: Samples per period.
        lines: Lines.
    """
    out = np.empty((len(lines), 2, len(seeds)))
    first = np.uint64(period) * np.uint64(samples + 2)
    _pairs()(np.ascontiguousarray(seeds), first, np.asarray(lines, np.int64), out.reshape(-1))
    out *= np.asarray(rms) * np.sqrt(2 / samples)
    return out


@cache
def _run() -> Callable[..., None]:
    sources = 0

    def run(seed, first, out):
        if sources == 0:
            return
        for j in range(np.uint64(out.size)):
            out[j] = drawn(seed, first + j)

    return compiled(run)


def series_noise(seed: np.uint64, rms: float, period: int, samples: int) -> np.ndarray:
    """The same noise in time: one period (samples,) whose lines are those of `line_noise`."""
    parts = np.empty(2 * (samples // 2 + 1))  # the numbers of all lines follow each other
    _run()(np.uint64(seed), np.uint64(period) * np.uint64(samples + 2) + np.uint64(1), parts)
    spectrum = parts.view(complex) * (rms * np.sqrt(2 / samples) * (samples / 2))
    for real in (0, samples // 2) if samples % 2 == 0 else (0,):
        spectrum[real] = spectrum[real].real * np.sqrt(2)
    return np.fft.irfft(spectrum, samples)
