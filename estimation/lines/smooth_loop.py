"""Smooth curves through measured responses of many loops, each with a noise and a smoothness of its own.

`curves.smooth_response` is for responses that share one noise, by an eigendecomposition. Here that of every loop
differs, and the banded form of Reinsch (Green and Silverman, Nonparametric Regression and Generalized Linear Models,
1994, chapter 2) takes a time proportional to the number of lines.
"""

from collections.abc import Callable
from functools import cache
from threading import Lock

import numpy as np
from numpy.typing import NDArray

from estimation.lines.frequency_response import LOCAL, distorted_variance
from maglev_lanes.compiled import compiled

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]

WIDTHS = 40  # smoothing widths that are told apart, evenly in their logarithm
COARSE = 4  # every so many of them are compared; then those between the best one and its neighbours
NARROWEST, WIDEST = 0.3, 3.0  # of the smallest distance between lines, and of the whole range of the lines
FLOOR = 1e-6  # of a response's largest variance, so that a line without noise does not dominate
CLEAR = 3.0  # standard deviations within which a line's own reading tells how large it is
_MAKING = Lock()  # threads that need the kernel at the same time make it once


def smooth_closed_loop(
    frequency: Array, response: Complex, variance: Array, receptance: bool = False
) -> tuple[Complex, Array]:
    """Sensitivities or receptances of closed loops whose inverses are smooth, and their variances.

    The largest |S| of noisy lines is that of the line which noise raised most, and a gain margin that of the first
    crossing which noise makes where the loop gain is small. A smooth curve has neither. 1 / S = 1 + L is smoothed, or
    the dynamic stiffness, which have no sharp peak where the loop has its own; |d(1/S)| = |dS| / |S|^2. What repeats
    with the period but scatters between lines, as the distortion of a magnet does, widens the variance; it is not
    smoothed away, because it looks like a loop that bends between its lines.

    Args:
        frequency: Increasing, (f,), Hz, f >= 4.
        response: (n, f).
        variance: Of its noise, E|noise|^2, (n, f). Where a loop has none at all, it is returned unchanged.
        receptance: Whether the responses are receptances.
    """
    inverse = 1 / response
    # A line that noise made small weighs too little at first: its size is that of the first curve. That curve misses
    # lines that are far smaller than others, because their noise is raised to FLOOR; what a clear line shows bounds it.
    first, _ = smooth_responses(frequency, inverse, variance * np.abs(inverse) ** 4)
    size, doubt = np.abs(response), CLEAR * np.sqrt(variance)
    noise = variance / np.clip(1 / np.abs(first), size - doubt, size + doubt) ** 4
    curve, spread = smooth_responses(frequency, inverse, noise)
    if frequency.size >= LOCAL:
        # Of a disturbance in proportion to the excitation, d: dS = (1 - S) d, or that share of a receptance.
        inside = np.abs(curve * (1 if receptance else curve - 1)) ** 2
        total = distorted_variance(frequency, inverse, noise, inside)
        spread = spread * np.divide(total, noise, out=np.ones_like(noise), where=noise > 0)
    return 1 / curve, spread / np.abs(curve) ** 4


def smooth_responses(frequency: Array, response: Complex, variance: Array) -> tuple[Complex, Array]:
    """Natural cubic smoothing splines of responses over log frequency at their own frequencies, and their variances.

    Mallows' Cp chooses the smoothness of each. The variance is that of a Gaussian process whose mean is the spline
    (Wahba 1983), which also allows for what smoothing takes away.

    Args:
        frequency: Increasing, (f,), Hz, f >= 4.
        response: (n, f).
        variance: Of its noise, E|noise|^2, (n, f). A response without any noise is returned unchanged,
            and so is one that is not finite, whose variance is then nan.
    """
    noise = np.ascontiguousarray(np.maximum(variance, FLOOR * variance.max(axis=1, keepdims=True)))
    curve, share = np.array(response, complex, order="C"), np.ones(noise.shape)  # written in place, as flat arrays
    with _MAKING:
        kernel = _kernel()
    kernel(np.log(frequency), curve.reshape(-1), noise.reshape(-1), share.reshape(-1))
    return curve, share * variance


@cache
def _kernel() -> Callable[..., None]:
    sources = 0  # see `maglev_lanes.compiled`

    def smooth(x, response, noise, share):
        """Replace every response by its curve, and every share by the curve's variance over that of the noise."""
        if sources == 0:
            return
        n = x.size
        m = n - 2  # inner lines, at which second differences a, b, c of the curve are penalised
        h = x[1:] - x[:-1]
        a, b, c = 1.0 / h[:-1], -1.0 / h[:-1] - 1.0 / h[1:], 1.0 / h[1:]
        narrow, wide = np.log(NARROWEST * h.min()), np.log(WIDEST * (x[-1] - x[0]))
        pivot, l1, l2, bent = np.zeros(m), np.zeros(m), np.zeros(m), np.zeros(m, np.complex128)
        i0, i1, i2 = np.zeros(m + 2), np.zeros(m + 2), np.zeros(m + 2)  # bands of the inverse
        taken, left = np.zeros(n, np.complex128), np.zeros(n)
        best_curve, best_share = np.zeros(n, np.complex128), np.zeros(n)
        for lane in range(response.size // n):
            y, v = response[lane * n : (lane + 1) * n], noise[lane * n : (lane + 1) * n]
            if not v.min() > 0.0:
                continue
            per_penalty = np.median(v) * np.median(h)
            least = np.inf
            best, hop, step, after = 0, COARSE, 0, False
            while hop > 0:
                # A spline that smooths over a width has about its fourth power as penalty, per weight of the lines.
                width = np.exp(narrow + (wide - narrow) * step / (WIDTHS - 1))
                p = width**4 / per_penalty
                for i in range(m):  # L D L' of the penalised matrix of two off-diagonals, and the forward solution
                    d = (h[i] + h[i + 1]) / 3
                    d += p * (a[i] * a[i] * v[i] + b[i] * b[i] * v[i + 1] + c[i] * c[i] * v[i + 2])
                    right = a[i] * y[i] + b[i] * y[i + 1] + c[i] * y[i + 2]
                    between = 0.0
                    if i > 0:
                        d -= l1[i - 1] * l1[i - 1] * pivot[i - 1]
                        right -= l1[i - 1] * bent[i - 1]
                        between = l1[i - 1] * l2[i - 1] * pivot[i - 1]
                    if i > 1:
                        d -= l2[i - 2] * l2[i - 2] * pivot[i - 2]
                        right -= l2[i - 2] * bent[i - 2]
                    pivot[i], bent[i] = d, right
                    l1[i] = l2[i] = 0.0
                    if i < m - 1:
                        off = h[i + 1] / 6 + p * (b[i] * a[i + 1] * v[i + 1] + c[i] * b[i + 1] * v[i + 2])
                        l1[i] = (off - between) / d
                    if i < m - 2:
                        l2[i] = p * c[i] * a[i + 2] * v[i + 2] / d
                for i in range(n):
                    taken[i], left[i] = 0.0, 0.0
                for k in range(m):  # backward: the solution, and three bands of the inverse (Hutchinson, de Hoog 1985)
                    i = m - 1 - k
                    bent[i] /= pivot[i]
                    if i < m - 1:
                        bent[i] -= l1[i] * bent[i + 1]
                    if i < m - 2:
                        bent[i] -= l2[i] * bent[i + 2]
                    i2[i] = -l1[i] * i1[i + 1] - l2[i] * i0[i + 2] if i < m - 2 else 0.0
                    i1[i] = -l1[i] * i0[i + 1] - l2[i] * i1[i + 1] if i < m - 1 else 0.0
                    i0[i] = 1.0 / pivot[i] - l1[i] * i1[i] - l2[i] * i2[i]
                    taken[i] += a[i] * bent[i]
                    taken[i + 1] += b[i] * bent[i]
                    taken[i + 2] += c[i] * bent[i]
                    left[i] += a[i] * a[i] * i0[i]
                    left[i + 1] += b[i] * b[i] * i0[i]
                    left[i + 2] += c[i] * c[i] * i0[i]
                    if i < m - 1:
                        left[i + 1] += 2.0 * b[i] * a[i + 1] * i1[i]
                        left[i + 2] += 2.0 * c[i] * b[i + 1] * i1[i]
                    if i < m - 2:
                        left[i + 2] += 2.0 * c[i] * a[i + 2] * i2[i]
                risk = 0.0
                for i in range(n):
                    t = taken[i]
                    risk += p * p * v[i] * (t.real * t.real + t.imag * t.imag) + 2.0 * (1.0 - p * v[i] * left[i])
                if risk < least:
                    least, best = risk, step
                    for i in range(n):
                        best_curve[i], best_share[i] = y[i] - p * v[i] * taken[i], 1.0 - p * v[i] * left[i]
                if hop == COARSE and step + hop < WIDTHS:
                    step += hop
                elif hop == COARSE or after:
                    hop //= 2
                    after, step = False, max(0, best - hop)
                else:
                    after, step = True, min(WIDTHS - 1, best + hop)
            if least < np.inf:
                for i in range(n):
                    y[i], share[lane * n + i] = best_curve[i], best_share[i]
            else:
                share[lane * n : (lane + 1) * n] = np.nan

    return compiled(smooth, fast=False)
