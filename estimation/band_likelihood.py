"""Kernels behind `estimation.max_likelihood`: the search in every band of every lane, and the bounds of intervals.

The search and its notation are in `band_search`; what follows from the sums that it leaves is in `band_errors`.
"""

from collections.abc import Callable
from functools import cache
from threading import Lock

import numpy as np

from estimation.band_bounds import BOUNDED, FOUND_AT, ROOM, find_bounds
from estimation.band_errors import Found
from estimation.band_search import COST, GIVEN, GK, LEFT, LINE, NEITHER, PF, PI, PR, PY, C, K, M, W, minimise
from estimation.band_sums import (
    ACROSS,
    ALONG,
    BEST,
    BEST_C,
    BEST_K,
    COVARIANCE,
    END,
    FAST,
    POWER,
    STARTED,
    W1,
    W2,
    gather,
    pool,
)  # fmt: skip
from maglev_lanes.compiled import compiled
from maglev_lanes.layout import LANES, aligned
from maglev_lanes.pieces import called

_FINE = 1e-8  # change of the cost that counts as converged
_INFINITE = 1e300
_MAKING = Lock()  # threads that need a kernel at the same time make it once
ZERO, ONE, TWO = (np.uint64(i) for i in range(3))


@called
def _band(data, o, w, begin, end, p, s):
    """Search one band in all lanes; what is found is left in rows POWER to END."""
    pool(data, o, w, begin, end, p, s)
    for lane in range(W):
        s[lane + BEST_K] = s[lane + BEST_C] = 0.0
        s[lane + BEST] = _INFINITE
    for at in range(PF, GIVEN):
        s[COVARIANCE - PF + at] = p[at]
    # Two starting points: the moment estimator corrected for noise, and the dissertation's least squares.
    for start in range(2):
        part = 1.0 - start
        n = part * float(end - begin)
        for lane in range(W):
            power, fast = s[lane + POWER] - n * p[lane + PY], part * s[lane + W2] * p[lane + PY]
            s[lane + K] = (s[lane + ALONG] - n * p[lane + PR] - p[lane + M] * fast) / power
            fast = s[lane + FAST] - fast
            s[lane + C] = (s[lane + ACROSS] - part * s[lane + W1] * p[lane + PI]) / fast
            s[lane + LEFT] = s[lane + STARTED] = 1.0 if (power > 0.0) & (fast > 0.0) else 0.0
        minimise(data, o, w, begin, end, p, s, NEITHER, _FINE)
        for lane in range(W):
            s[lane + STARTED] = 1.0 if (s[lane + STARTED] > 0.0) & (s[lane + COST] < s[lane + BEST]) else 0.0
        for at in range(K, GK, W):
            for lane in range(W):
                s[at + lane + BEST_K] = s[at + lane] if s[lane + STARTED] > 0.0 else s[at + lane + BEST_K]
    for at in range(K, GK):
        s[at] = s[at + BEST_K]
    gather(data, o, w, begin, end, p, s)


# A kernel calls the search by way of another part: directly, it would be compiled once more for each of them.
@cache
def _estimate() -> Callable[..., None]:
    sources = 0  # see `compiled`

    def estimate(data, w, mass, slices, p, s, out):
        if sources == 0:
            return
        to, lines = ZERO, np.uint64(w.size)
        for start in range(ZERO, np.uint64(mass.size), W):
            for lane in range(W):
                p[lane + M] = mass[start + lane]
            for band in range(ZERO, np.uint64(slices.size), TWO):
                _band(data, start // W * lines * LINE, w, slices[band], slices[band + ONE], p, s)
                for at in range(POWER, END):
                    out[to] = s[at]
                    to += ONE

    return compiled(estimate)


@cache
def _bounds() -> Callable[..., None]:
    sources = 0

    def bounds(data, w, slices, known, p, s, out):
        if sources == 0:
            return
        blocks, lines = np.uint64(out.size) // (TWO * TWO * W * np.uint64(slices.size // 2)), np.uint64(w.size)
        at, to = ZERO, ZERO
        for block in range(blocks):
            for band in range(ZERO, np.uint64(slices.size), TWO):
                for i in range(BOUNDED):
                    p[i] = known[at + i]
                at += BOUNDED
                for of in range(TWO):
                    for _ in range(2):
                        find_bounds(data, block * lines * LINE, w, slices[band], slices[band + ONE], p, s, of * C)
                        for lane in range(W):
                            out[to] = s[lane + FOUND_AT]
                            to += ONE

    return compiled(bounds)


def in_blocks(force: np.ndarray, disp: np.ndarray, sff: np.ndarray, syy: np.ndarray, sfy: np.ndarray) -> np.ndarray:
    """The data of the kernels, (blocks, n, channels, LANES), whose last lanes are zero where there are no more.

    Args:
        force, disp: amplitudes (lanes, n).
        sff, syy, sfy: covariances of their noise (lanes, n).
    """
    lanes, n = force.shape
    whole, rest = divmod(lanes, LANES)
    parts = (force.real, force.imag, disp.real, disp.imag, sff, syy, sfy.real, sfy.imag)
    data = aligned((whole + (rest > 0), n, len(parts), LANES))
    data[whole:] = 0.0
    for channel, values in enumerate(parts):
        data[:whole, :, channel] = values[: whole * LANES].reshape(whole, LANES, n).transpose(0, 2, 1)
        if rest:
            data[whole, :, channel, :rest] = values[whole * LANES :].T
    return data


def estimate(data: np.ndarray, w: np.ndarray, mass: np.ndarray, slices: np.ndarray, periods: int) -> Found:
    """Estimate every band of every lane.

    Args:
        data: see `in_blocks`.
        w: angular frequencies (n,), rad/s.
        mass: (lanes,), kg.
        slices: first line and the one behind the last of every band (bands, 2).
        periods: number of periods.
    """
    masses = np.ones(len(data) * LANES)
    masses[: len(mass)] = mass
    scratch = aligned((int(GIVEN),)), aligned((int(END),))
    left = np.empty((len(data), len(slices), int(END - POWER) // LANES, LANES))
    with _MAKING:
        kernel = _estimate()
    kernel(data.reshape(-1), w, masses, slices.astype(np.uint64).reshape(-1), *scratch, left.reshape(-1))
    return Found.of(left, len(mass), np.diff(slices, axis=1)[:, 0], periods)


def bounds(
    data: np.ndarray, w: np.ndarray, mass: np.ndarray, slices: np.ndarray, found: Found, threshold: np.ndarray
) -> np.ndarray:
    """Profile-likelihood bounds (k low, k high, c low, c high) of every band of every lane, (lanes, bands, 4).

    Args:
        data, w, mass, slices: as for `estimate`.
        found: what it returned.
        threshold: rise of the cost that defines a bound of k and of c, (2, lanes, bands).
    """
    steps = np.sqrt(2 * threshold / found.ratio) * found.se
    # Cost of an infinitely stiff or damped support, for which all measured displacement would be noise.
    with np.errstate(divide="ignore", invalid="ignore"):
        far = np.where(found.pooled[1] > 0, found.power / found.pooled[1] - found.cost, np.inf)
    steps = np.where(np.isfinite(found.se) & (far > threshold), -steps, np.nan)
    masses = np.broadcast_to(mass[:, None], found.cost.shape)
    known = np.stack([masses, *found.pooled, *found.at, found.cost, *threshold, *steps, *found.slope])
    rows, lanes, bands = known.shape
    padded = np.full((rows, len(data) * LANES, bands), np.nan)
    padded[:, :lanes] = known
    known = padded.reshape(rows, len(data), LANES, bands).transpose(1, 3, 0, 2).reshape(-1)
    ends = np.empty((len(data), bands, 4, LANES))
    with _MAKING:
        kernel = _bounds()
    scratch = aligned((int(BOUNDED),)), aligned((int(ROOM),))
    kernel(data.reshape(-1), w, slices.astype(np.uint64).reshape(-1), known, *scratch, ends.reshape(-1))
    ends = ends.transpose(0, 3, 1, 2).reshape(-1, bands, 4)[:lanes]
    # A search that leaves the minimum nowhere has no bound.
    unbounded = np.where(np.isfinite(found.at[0])[..., None], np.array([-np.inf, np.inf] * 2), np.nan)
    return np.where(np.isnan(ends), unbounded, ends)
