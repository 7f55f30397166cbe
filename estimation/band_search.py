"""Compiled search for stiffness and damping of one band, in all lanes of a block at once.

Notation for one line: e = F - Z Y is the equation error, S its variance, n_Y the noise of the displacement and
C = E[n_Y e*] its covariance with e. With v = e / S, the displacement corrected for the noise that e reveals is
Y - C v. The cost |e|^2 / S then has the half gradient -Re(v* Z_j (Y - C v)), where Z_j is 1 for the stiffness and
j w for the damping.

Lanes are searched in step, because a loop over them turns into vector instructions; each keeps what it found once it
has converged, so that its result depends on no other lane. All numbers are real, and arrays flat with unsigned indices,
because all else takes the compiler longer. Arguments of all functions:

- data: blocks of (lines, channels, LANES); o: where the block begins in it.
- w: angular frequencies of the lines; begin, end: those of the band.
- p: what the band takes for granted, rows M to PI; s: the state of the search, rows K to EXPECTED.
- held: K or C, the coefficient that is not changed; NEITHER: both are.
"""

from collections.abc import Callable
from functools import cache
from math import inf

import numpy as np

from maglev_lanes.compiled import compiled
from maglev_lanes.layout import LANES, rows_after
from maglev_lanes.pieces import piece

# Force and displacement, and the covariances of their noise.
_CHANNELS = "F_RE F_IM Y_RE Y_IM S_FF S_YY S_RE S_IM"
F_RE, F_IM, Y_RE, Y_IM, S_FF, S_YY, S_RE, S_IM, LINE = (np.uint64(offset) for offset in rows_after(0, _CHANNELS))
W = np.uint64(LANES)
# Mass, and the covariances pooled over the band.
M, PF, PY, PR, PI, GIVEN = (np.uint64(offset) for offset in rows_after(0, "M PF PY PR PI"))
# The point, and what `expand` leaves of it: cost, half gradient, exact half Hessian, and the positive part of its
# diagonal, without the terms that the noise subtracts, which are last.
_POINT = "K C COST KK KC CC GK GC PKK PCC NK NC"
K, C, COST, KK, KC, CC, GK, GC, PKK, PCC, NK, NC, TRIAL = (np.uint64(offset) for offset in rows_after(0, _POINT))
NEITHER = TRIAL
# Behind a second such point: the damping of Newton's step, whether the lane is still searched, has a trial point, and
# keeps it; the gain of cost that is expected of it; and the least cost of several starts.
_STATE = "DAMP LEFT TRIED BETTER EXPECTED LEAST"
DAMP, LEFT, TRIED, BETTER, EXPECTED, LEAST, LAST = (np.uint64(o) for o in rows_after(2 * int(TRIAL), _STATE))
_ITERATIONS = 60
ZERO, ONE, TWO, TWO_ROWS = (np.uint64(i) for i in (0, 1, 2, 2 * LANES))


@piece
def of_line(f_re, f_im, y_re, y_im, pf, py, pr, pi, a, b):
    """S, 1 / S, v, C and Y - C v (see above) of one line with the impedance Z = a + j b."""
    var = pf + (a * a + b * b) * py - 2.0 * (a * pr + b * pi)
    share = 1.0 / var
    v_re, v_im = (f_re - (a * y_re - b * y_im)) * share, (f_im - (a * y_im + b * y_re)) * share
    c_re, c_im = pr - a * py, b * py - pi
    r_re, r_im = y_re - (c_re * v_re - c_im * v_im), y_im - (c_re * v_im + c_im * v_re)
    return var, share, v_re, v_im, c_re, c_im, r_re, r_im


@piece
def expand(data, o, w, begin, end, p, s, at):
    """Fill the rows from COST on of the point at `at` (0 or TRIAL) from its K and C.

    All rows that it changes stand at fixed distances from each other: of others the compiler would not know that they
    do not overlap, and the loop over lanes would fall back to single numbers.
    """
    for g in range(at + COST, at + TRIAL):
        s[g] = 0.0
    for i in range(begin, end):
        wi = w[i]
        square = wi * wi
        line = o + i * LINE
        for lane in range(W):
            g, d = at + lane, line + lane
            py = p[lane + PY]
            var, share, v_re, v_im, c_re, c_im, r_re, r_im = of_line(
                data[d + F_RE], data[d + F_IM], data[d + Y_RE], data[d + Y_IM],
                p[lane + PF], py, p[lane + PR], p[lane + PI],
                s[g + K] - p[lane + M] * square, wi * s[g + C],
            )  # fmt: skip
            t_re, t_im = v_re * c_re + v_im * c_im, v_im * c_re - v_re * c_im
            k_re, k_im = r_re - t_re, r_im - t_im
            d_re, d_im = r_re + t_re, r_im + t_im
            power = v_re * v_re + v_im * v_im
            noise = power * py
            s[g + COST] += power * var
            s[g + GK] -= v_re * r_re + v_im * r_im
            s[g + GC] += wi * (v_re * r_im - v_im * r_re)
            s[g + PKK] += share * (k_re * k_re + k_im * k_im)
            s[g + PCC] += square * share * (d_re * d_re + d_im * d_im)
            s[g + KC] += wi * share * (k_im * d_re - k_re * d_im)
            # Subtracted below: the amount that displacement noise adds to these terms on average.
            s[g + NK] += noise
            s[g + NC] += square * noise
    for g in range(at, at + W):
        s[g + KK], s[g + CC] = s[g + PKK] - s[g + NK], s[g + PCC] - s[g + NC]


@piece
def _step(s, held):
    """Take the damped Newton step of every lane that has one as its trial point, with the gain expected of it."""
    for lane in range(W):
        damp, gk, gc = s[lane + DAMP], s[lane + GK], s[lane + GC]
        akk, acc, akc = s[lane + KK] + damp * s[lane + PKK], s[lane + CC] + damp * s[lane + PCC], s[lane + KC]
        if held == K:
            akk, akc, gk = 1.0, 0.0, 0.0
        elif held == C:
            acc, akc, gc = 1.0, 0.0, 0.0
        det = akk * acc - akc * akc
        tried = (s[lane + LEFT] > 0.0) & (akk > 0.0) & (det > 1e-14 * akk * acc)
        share = 1.0 / (det if tried else 1.0)
        sk, sc = (akc * gc - acc * gk) * share, (akc * gk - akk * gc) * share
        s[lane + TRIAL + K] = s[lane + K] + (sk if tried else 0.0)
        s[lane + TRIAL + C] = s[lane + C] + (sc if tried else 0.0)
        s[lane + EXPECTED], s[lane + TRIED] = -(sk * gk + sc * gc), 1.0 if tried else 0.0


@piece
def _judge(s, tolerance):
    """Keep or refuse the lanes' trial points, change their damping, and let those rest that have converged."""
    for lane in range(W):
        damp, gain = s[lane + DAMP], s[lane + COST] - s[lane + TRIAL + COST]
        better = (s[lane + LEFT] > 0.0) & (s[lane + TRIED] > 0.0) & (gain >= 0.0)
        # Converged when a full step gains as much as the quadratic model predicts.
        done = (gain <= tolerance) | ((damp <= 1e-6) & (abs(gain - s[lane + EXPECTED]) <= tolerance))
        less, more = damp * 0.1, damp * 10.0
        less, more = 1e-9 if less < 1e-9 else less, 1e-4 if more < 1e-4 else more
        s[lane + DAMP], s[lane + BETTER] = less if better else more, 1.0 if better else 0.0
        s[lane + LEFT] = 0.0 if (better & done) | (more > 1e12) else s[lane + LEFT]
    for at in range(K, TRIAL, W):
        for lane in range(at, at + W):
            s[lane] = s[lane + TRIAL] if s[lane - at + BETTER] > 0.0 else s[lane]


@piece
def _minimise(data, o, w, begin, end, p, s, held, tolerance):
    """Damped Newton search from the point of the lanes whose LEFT is positive."""
    for lane in range(W):
        s[lane + DAMP] = 1e-6
    for _ in range(_ITERATIONS):
        left = 0.0
        for lane in range(W):
            left += s[lane + LEFT]
        if left == 0.0:
            return
        _step(s, held)
        expand(data, o, w, begin, end, p, s, TRIAL)
        _judge(s, tolerance)


@piece
def _of_band(data, o, w, begin, end, p, s, starts, first, count, held, tolerance):
    """Search from the cheapest of the starts, whose K and C stand from `first` on, nan in lanes that have none."""
    for lane in range(W):
        s[lane + LEAST] = inf
        s[lane + TRIAL + K] = s[lane + TRIAL + C] = inf
    for _ in range(count):
        for lane in range(W):
            s[lane + K], s[lane + C] = starts[first + lane + K], starts[first + lane + C]
        first += TWO_ROWS
        expand(data, o, w, begin, end, p, s, K)
        for lane in range(W):
            better = s[lane + COST] < s[lane + LEAST]
            s[lane + LEAST] = s[lane + COST] if better else s[lane + LEAST]
            s[lane + TRIAL + K] = s[lane + K] if better else s[lane + TRIAL + K]
            s[lane + TRIAL + C] = s[lane + C] if better else s[lane + TRIAL + C]
    for lane in range(W):
        s[lane + LEFT] = 1.0 if s[lane + LEAST] < inf else 0.0
        s[lane + K], s[lane + C] = s[lane + TRIAL + K], s[lane + TRIAL + C]
    if count > ONE:
        expand(data, o, w, begin, end, p, s, K)
    _minimise(data, o, w, begin, end, p, s, held, tolerance)


@cache
def search() -> Callable[..., None]:
    """Kernel that searches every band of every block, from the cheapest of several starts.

    Its arguments: data, w, bands (2 for each: begin and end), given (M to PI of each block and band), starts (of each
    block and band as many pairs of K and C as go into it), held, tolerance, room for p and s, and what it fills: the
    rows K to CC of each block and band.
    """
    sources = 0  # see `compiled`

    def search(data, w, bands, given, starts, held, tolerance, p, s, out):
        if sources == 0:
            return
        lines, many, first, to = np.uint64(w.size), np.uint64(out.size) // GK, ZERO, ZERO
        count = np.uint64(starts.size) // (TWO_ROWS * many)
        for at in range(many):
            band = TWO * at % np.uint64(bands.size)
            o = TWO * at // np.uint64(bands.size) * lines * LINE
            for i in range(GIVEN):
                p[i] = given[at * GIVEN + i]
            _of_band(data, o, w, bands[band], bands[band + ONE], p, s, starts, first, count, held, tolerance)
            first += count * TWO_ROWS
            for i in range(GK):
                out[to + i] = s[i]
            to += GK

    return compiled(search)
