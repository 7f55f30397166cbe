"""Compiled sums over the lines of a band, in the lanes of a block at once; for arguments see `band_search`."""

import numpy as np

from estimation.band_search import (
    CC,
    F_IM,
    F_RE,
    KC,
    KK,
    LAST,
    LINE,
    PF,
    PI,
    PR,
    PY,
    S_FF,
    S_IM,
    S_RE,
    S_YY,
    Y_IM,
    Y_RE,
    C,
    K,
    M,
    W,
)  # fmt: skip
from maglev_lanes.layout import rows_after
from maglev_lanes.pieces import called

# Of the band's data: power of the displacement, the same times w^2, Re F Y* + m w^2 |Y|^2 and w Im F Y*; sums of w and
# w^2; then the best point of several searches. COVARIANCE: the pooled ones, as PF to PI of what is given.
# Of the lines at that point: powers of the shares of the variances of k and c, leverages, ratios of own to pooled
# variance; KA to CI: derivatives of the half gradient by s_F^2, s_Y^2, Re s_FY and Im s_FY.
_ROWS = (
    "POWER FAST ALONG ACROSS W1 W2 STARTED BEST_K BEST_C BEST BEST_KK BEST_KC BEST_CC COVARIANCE[4] "
    "SUM_K SUM_C SQUARE_K SQUARE_C HATS BY_HAT HAT_SQUARE CROSS ALIKE ALIKE_SQUARE KA KB KR KI CA CB CR CI IK IX IC"
)
(
    POWER, FAST, ALONG, ACROSS, W1, W2, STARTED, BEST_K, BEST_C, BEST, BEST_KK, BEST_KC, BEST_CC, COVARIANCE, SUM_K,
    SUM_C, SQUARE_K, SQUARE_C, HATS, BY_HAT, HAT_SQUARE, CROSS, ALIKE, ALIKE_SQUARE, KA, KB, KR, KI, CA, CB, CR, CI, IK,
    IX, IC, END,
) = (np.uint64(offset) for offset in rows_after(int(LAST), _ROWS))  # fmt: skip


@called
def pool(data, o, w, begin, end, p, s):
    """Sums of the band's data, and the covariances pooled over it (rows PF to PI)."""
    for lane in range(W):
        for at in range(lane + POWER, lane + STARTED, W):
            s[at] = 0.0
        for at in range(lane + PF, lane + PI + W, W):
            p[at] = 0.0
    share = 1.0 / float(end - begin)
    for i in range(begin, end):
        wi = w[i]
        square = wi * wi
        line = o + i * LINE
        for lane in range(W):
            d = line + lane
            fr, fi = data[d + F_RE], data[d + F_IM]
            y_re, y_im = data[d + Y_RE], data[d + Y_IM]
            power = y_re * y_re + y_im * y_im
            p[lane + PF] += share * data[d + S_FF]
            p[lane + PY] += share * data[d + S_YY]
            p[lane + PR] += share * data[d + S_RE]
            p[lane + PI] += share * data[d + S_IM]
            s[lane + POWER] += power
            s[lane + FAST] += square * power
            s[lane + ALONG] += fr * y_re + fi * y_im + p[lane + M] * square * power
            s[lane + ACROSS] += wi * (fi * y_re - fr * y_im)
            s[lane + W1] += wi
            s[lane + W2] += square


@called
def gather(data, o, w, begin, end, p, s):
    """Sums of the lines at K and C, whose half Hessian is that of KK to CC."""
    for lane in range(W):
        for at in range(lane + SUM_K, lane + IK, W):
            s[at] = 0.0
        det = s[lane + KK] * s[lane + CC] - s[lane + KC] * s[lane + KC]
        s[lane + IK], s[lane + IX], s[lane + IC] = s[lane + CC] / det, -s[lane + KC] / det, s[lane + KK] / det
    for i in range(begin, end):
        wi = w[i]
        square = wi * wi
        line = o + i * LINE
        for lane in range(W):
            d = line + lane
            y_re, y_im = data[d + Y_RE], data[d + Y_IM]
            pr, pi, py = p[lane + PR], p[lane + PI], p[lane + PY]
            ik, ix, ic = s[lane + IK], s[lane + IX], s[lane + IC]
            a, b = s[lane + K] - p[lane + M] * square, wi * s[lane + C]
            z = a * a + b * b
            var = p[lane + PF] + z * py - 2.0 * (a * pr + b * pi)
            share = 1.0 / var
            v_re = (data[d + F_RE] - (a * y_re - b * y_im)) * share
            v_im = (data[d + F_IM] - (a * y_im + b * y_re)) * share
            c_re, c_im = pr - a * py, b * py - pi
            t_re, t_im = c_re * v_re - c_im * v_im, c_re * v_im + c_im * v_re
            r_re, r_im = y_re - t_re, y_im - t_im
            e_re, e_im = r_re - t_re, r_im - t_im  # Y - 2 C v
            ratio = (data[d + S_FF] + z * data[d + S_YY] - 2.0 * (a * data[d + S_RE] + b * data[d + S_IM])) * share
            signal = (r_re * r_re + r_im * r_im) * share
            kk = (ik * ik + square * ix * ix) * signal * ratio
            cc = (ix * ix + square * ic * ic) * signal * ratio
            hat = (ik + square * ic) * signal
            of_hat = hat * ratio
            power = v_re * v_re + v_im * v_im
            tk, tc = (v_re * e_re + v_im * e_im) * share, wi * (v_im * e_re - v_re * e_im) * share
            s[lane + SUM_K] += kk
            s[lane + SQUARE_K] += kk * kk
            s[lane + SUM_C] += cc
            s[lane + SQUARE_C] += cc * cc
            s[lane + HATS] += hat
            s[lane + BY_HAT] += of_hat
            s[lane + HAT_SQUARE] += of_hat * of_hat
            s[lane + CROSS] += of_hat * ratio
            s[lane + ALIKE] += ratio
            s[lane + ALIKE_SQUARE] += ratio * ratio
            s[lane + KA] += tk
            s[lane + KB] += tk * z - a * power
            s[lane + KR] += power - 2.0 * a * tk
            s[lane + KI] -= 2.0 * b * tk
            s[lane + CA] += tc
            s[lane + CB] += tc * z - wi * b * power
            s[lane + CR] -= 2.0 * a * tc
            s[lane + CI] += wi * power - 2.0 * b * tc
