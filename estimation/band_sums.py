"""Compiled sums over the lines of bands, in the lanes of a block at once; for arguments see `band_search`."""

from collections.abc import Callable
from functools import cache

import numpy as np

from estimation.band_search import (
    F_IM,
    F_RE,
    GIVEN,
    GK,
    LINE,
    ONE,
    PF,
    PI,
    PR,
    PY,
    S_FF,
    S_IM,
    S_RE,
    S_YY,
    TWO,
    Y_IM,
    Y_RE,
    C,
    K,
    M,
    W,
    of_line,
)  # fmt: skip
from maglev_lanes.compiled import compiled
from maglev_lanes.layout import rows_after
from maglev_lanes.pieces import piece

# With r the ratio of a line's own to its pooled variance, h = |Y - C v|^2 / S what it tells of k, and g = w^2 h of c:
# sums of h, g, h r, g r, (h r)^2, h g r^2, (g r)^2, h r^2, g r^2, r, r^2; then the derivatives of the half gradient of
# k and of c by s_F^2, s_Y^2, Re s_FY and Im s_FY.
_SUMS = "H G HR GR HR2 HG GR2 HRR GRR R R2 KA KB KR KI CA CB CR CI"
H, G, HR, GR, HR2, HG, GR2, HRR, GRR, R, R2, KA, KB, KR, KI, CA, CB, CR, CI, SUMS = (
    np.uint64(offset) for offset in rows_after(0, _SUMS)
)


@piece
def _gather(data, o, w, begin, end, p, s, out, to):
    """Sums of the lines at K and C, into the rows of out from to on."""
    for at in range(to, to + SUMS):
        out[at] = 0.0
    for i in range(begin, end):
        wi = w[i]
        square = wi * wi
        line = o + i * LINE
        for lane in range(W):
            d, q = line + lane, to + lane
            a, b = s[lane + K] - p[lane + M] * square, wi * s[lane + C]
            _, share, v_re, v_im, c_re, c_im, r_re, r_im = of_line(
                data[d + F_RE], data[d + F_IM], data[d + Y_RE], data[d + Y_IM],
                p[lane + PF], p[lane + PY], p[lane + PR], p[lane + PI], a, b,
            )  # fmt: skip
            z = a * a + b * b
            ratio = (data[d + S_FF] + z * data[d + S_YY] - 2.0 * (a * data[d + S_RE] + b * data[d + S_IM])) * share
            h = (r_re * r_re + r_im * r_im) * share
            g = square * h
            hr, gr = h * ratio, g * ratio
            power = v_re * v_re + v_im * v_im
            e_re, e_im = r_re - (c_re * v_re - c_im * v_im), r_im - (c_re * v_im + c_im * v_re)  # Y - 2 C v
            tk, tc = (v_re * e_re + v_im * e_im) * share, wi * (v_im * e_re - v_re * e_im) * share
            out[q + H] += h
            out[q + G] += g
            out[q + HR] += hr
            out[q + GR] += gr
            out[q + HR2] += hr * hr
            out[q + HG] += hr * gr
            out[q + GR2] += gr * gr
            out[q + HRR] += hr * ratio
            out[q + GRR] += gr * ratio
            out[q + R] += ratio
            out[q + R2] += ratio * ratio
            out[q + KA] += tk
            out[q + KB] += tk * z - a * power
            out[q + KR] += power - 2.0 * a * tk
            out[q + KI] -= 2.0 * b * tk
            out[q + CA] += tc
            out[q + CB] += tc * z - wi * b * power
            out[q + CR] -= 2.0 * a * tc
            out[q + CI] += wi * power - 2.0 * b * tc


@cache
def line_sums() -> Callable[..., None]:
    """Kernel that fills the rows H to CI of each block and band; points: what `search` found."""
    sources = 0  # see `compiled`

    def line_sums(data, w, bands, given, points, p, s, out):
        if sources == 0:
            return
        lines = np.uint64(w.size)
        for at in range(np.uint64(out.size) // SUMS):
            band = TWO * at % np.uint64(bands.size)
            o = TWO * at // np.uint64(bands.size) * lines * LINE
            for i in range(GIVEN):
                p[i] = given[at * GIVEN + i]
            for i in range(GK):
                s[i] = points[at * GK + i]
            _gather(data, o, w, bands[band], bands[band + ONE], p, s, out, at * SUMS)

    return compiled(line_sums)


@cache
def sums_over_bands() -> Callable[..., None]:
    """Kernel that adds up the lines of every band: values (blocks, lines, any), out (blocks, bands, any), all flat."""
    sources = 0

    def sums_over_bands(values, bands, lines, each, out):
        if sources == 0:
            return
        for at in range(np.uint64(out.size) // each):
            band = TWO * at % np.uint64(bands.size)
            o, to = TWO * at // np.uint64(bands.size) * lines, at * each
            for i in range(bands[band], bands[band + ONE]):
                for j in range(each):
                    out[to + j] += values[(o + i) * each + j]

    return compiled(sums_over_bands)
