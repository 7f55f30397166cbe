"""Compiled search for the bounds of intervals of one band, in all lanes of a block at once; see `band_search`.

A bound lies where the profile of the cost, its minimum over the other coefficient, has risen by a threshold.
"""

from math import inf, isfinite, nan, sqrt

import numpy as np

from estimation.band_search import COST, GIVEN, LAST, LEFT, C, K, W, expand, minimise
from maglev_lanes.layout import rows_after
from maglev_lanes.pieces import called

# Further rows of what is given: the minimum and its cost; of k and of c: the rise of the cost that defines a bound, the
# first step to it (nan: there is none), and the slope of the other coefficient along the ridge of the cost.
_GIVEN = "AT[2] LEAST RISE[2] STEP[2] SLOPE[2]"
AT, LEAST, RISE, STEP, SLOPE, BOUNDED = (np.uint64(offset) for offset in rows_after(int(GIVEN), _GIVEN))
# The distance that is tried; the point that was found before, and the best of several; the bracket of the bound, with
# how far the cost is beyond the threshold at its ends; what is sought; evaluations that are left; and the bound.
_ROOM = "TRIED_AT BEFORE[2] NEAREST NEAREST_AT[2] INSIDE OUTSIDE G_IN G_OUT PHASE REMAINING FOUND_AT"
(
    TRIED_AT, BEFORE, NEAREST, NEAREST_AT, INSIDE, OUTSIDE, G_IN, G_OUT, PHASE, REMAINING, FOUND_AT, ROOM,
) = (np.uint64(offset) for offset in rows_after(int(LAST), _ROOM))  # fmt: skip
_LEAVING, _CLOSING, _FOUND = 0.0, 1.0, 2.0  # phases: until the bound is passed; between two points; the end
_ROUGH = 1e-4  # change of the cost that counts as converged; a bound lies where the cost has risen by about 2
_DOUBLINGS, _CLOSER = 40, 30


@called
def _profile(data, o, w, begin, end, p, s, held, other):
    """Lowest cost of every lane with one coefficient held at its distance TRIED_AT from the minimum.

    The other coefficient starts from the cheapest of three points: where it was last, along the ridge, or at the
    minimum. Noise gives the profile side valleys, and a search that keeps to the last point could stay in one.
    """
    for lane in range(W):
        s[lane + NEAREST] = inf
        s[lane + held + NEAREST_AT], s[lane + other + NEAREST_AT] = p[lane + held + AT], p[lane + other + AT]
    for start in range(3):
        for lane in range(W):
            along = p[lane + SLOPE + held] * s[lane + TRIED_AT] if start == 1 else 0.0
            from_here = s[lane + BEFORE + other] if start == 0 else p[lane + AT + other]
            s[lane + held], s[lane + other] = p[lane + AT + held] + s[lane + TRIED_AT], from_here + along
        expand(data, o, w, begin, end, p, s, K)
        for lane in range(W):
            nearer = s[lane + COST] < s[lane + NEAREST]
            s[lane + NEAREST] = s[lane + COST] if nearer else s[lane + NEAREST]
            for at in range(lane + K, lane + COST, W):
                s[at + NEAREST_AT] = s[at] if nearer else s[at + NEAREST_AT]
    for lane in range(W):
        s[lane + LEFT] = 1.0 if s[lane + PHASE] < _FOUND else 0.0
        for at in range(lane + K, lane + COST, W):
            s[at] = s[at + NEAREST_AT]
    minimise(data, o, w, begin, end, p, s, held, _ROUGH)
    for lane in range(W):
        for at in range(lane + K, lane + COST, W):
            s[at + BEFORE] = s[at]


@called
def _narrow(s, lane, g):
    """Take the point that was tried, where the cost is g beyond the threshold, into the bracket; choose the next."""
    step = s[lane + TRIED_AT]
    s[lane + REMAINING] -= 1.0
    if s[lane + PHASE] == _LEAVING:
        if not g >= 0.0:
            s[lane + INSIDE], s[lane + G_IN], s[lane + TRIED_AT] = step, g, step * 1.5
            if s[lane + REMAINING] == 0.0:
                s[lane + PHASE], s[lane + TRIED_AT] = _FOUND, inf if step > 0.0 else -inf
            return
        s[lane + OUTSIDE], s[lane + G_OUT] = step, g
        s[lane + PHASE], s[lane + REMAINING] = _CLOSING, _CLOSER
    elif abs(g) < 1e-3 or s[lane + REMAINING] == 0.0:
        s[lane + PHASE] = _FOUND
        return
    elif g > 0.0:
        s[lane + OUTSIDE], s[lane + G_OUT], s[lane + G_IN] = step, g, s[lane + G_IN] * 0.5
    else:
        s[lane + INSIDE], s[lane + G_IN], s[lane + G_OUT] = step, g, s[lane + G_OUT] * 0.5
    inside, outside, g_in = s[lane + INSIDE], s[lane + OUTSIDE], s[lane + G_IN]
    s[lane + TRIED_AT] = inside - g_in * (outside - inside) / (s[lane + G_OUT] - g_in)
    if abs(outside - inside) < 1e-3 * abs(outside):
        s[lane + PHASE] = _FOUND


@called
def find_bounds(data, o, w, begin, end, p, s, held):
    """The bound (row FOUND_AT) of one coefficient of every lane in the direction of STEP, which is then turned round.

    Infinite, with the sign of STEP, if the cost never rises that far; nan without a STEP.
    """
    other = C - held
    for lane in range(W):
        step = p[lane + STEP + held]
        p[lane + STEP + held] = -step
        s[lane + TRIED_AT], s[lane + PHASE] = step, _LEAVING if isfinite(step) else _FOUND
        s[lane + REMAINING], s[lane + INSIDE], s[lane + G_IN] = _DOUBLINGS, 0.0, -1.0
        for at in range(lane + K, lane + COST, W):
            s[at + BEFORE] = p[at + AT]
    for _ in range(_DOUBLINGS + _CLOSER):
        sought = 0.0
        for lane in range(W):
            sought += _FOUND - s[lane + PHASE]
        if sought == 0.0:
            break
        _profile(data, o, w, begin, end, p, s, held, other)
        for lane in range(W):
            if s[lane + PHASE] < _FOUND:
                rise = s[lane + COST] - p[lane + LEAST]
                # How far beyond the threshold, as a share of the distance at which it is reached.
                _narrow(s, lane, sqrt((0.0 if rise < 0.0 else rise) / p[lane + RISE + held]) - 1.0)
    for lane in range(W):
        step = s[lane + TRIED_AT]
        s[lane + FOUND_AT] = p[lane + AT + held] + step if isfinite(p[lane + STEP + held]) else nan
