"""Compiled search behind `estimation.xy.planar`; it treats one band of one lane at a time.

The channels of a line are u = (F_x, F_y, X, Y) with noise covariance N. The error e = A u with A = (I, -Z) has the
covariance S = A N A^H. With v = S^-1 e and C = E[(n_X, n_Y) n_e^H], the displacement corrected for the noise that e
reveals is (X, Y) - C v, and the cost e^H v has the half gradient -Re(v^H Z_j ((X, Y) - C v)). The coefficients are
k_xx, k_xy, k_yx, k_yy, c_xx, c_xy, c_yx, c_yy.
"""

import numba as nb
import numpy as np

from maglev_lanes.piece_compiler import PieceCompiler
from maglev_lanes.pieces import INLINED

# Changes of the cost that count as converged: for the estimate, and while searching for a bound (a bound lies where
# the cost has risen by about 2).
_FINE, _ROUGH = 1e-9, 1e-4
_ITERATIONS = 100
_WALK = 45

_compiled = nb.njit(cache=True, nogil=True, error_model="numpy")
_OWN_ARRAYS = {"_nrt": True}  # which pieces of kernels have not
_inner = nb.njit(nogil=True, error_model="numpy", pipeline_class=PieceCompiler, **INLINED | _OWN_ARRAYS)


@_inner
def _line(u, n, w, m, t):
    """Error e (2), its covariance S and the covariance C of one line with channels u and noise n."""
    z11, z12 = complex(t[0] - m[0] * w * w, w * t[4]), complex(t[1], w * t[5])
    z21, z22 = complex(t[2], w * t[6]), complex(t[3] - m[1] * w * w, w * t[7])
    e1, e2 = u[0] - z11 * u[2] - z12 * u[3], u[1] - z21 * u[2] - z22 * u[3]
    c11 = n[2, 0] - n[2, 2] * np.conj(z11) - n[2, 3] * np.conj(z12)
    c12 = n[2, 1] - n[2, 2] * np.conj(z21) - n[2, 3] * np.conj(z22)
    c21 = n[3, 0] - n[3, 2] * np.conj(z11) - n[3, 3] * np.conj(z12)
    c22 = n[3, 1] - n[3, 2] * np.conj(z21) - n[3, 3] * np.conj(z22)
    s11 = (n[0, 0] - n[0, 2] * np.conj(z11) - n[0, 3] * np.conj(z12) - z11 * c11 - z12 * c21).real
    s12 = n[0, 1] - n[0, 2] * np.conj(z21) - n[0, 3] * np.conj(z22) - z11 * c12 - z12 * c22
    s22 = (n[1, 1] - n[1, 2] * np.conj(z21) - n[1, 3] * np.conj(z22) - z21 * c12 - z22 * c22).real
    return e1, e2, s11, s12, s22, c11, c12, c21, c22


@_inner
def _copy(values, to):
    """Eight numbers one by one: for arrays, whose shapes could differ, the compiler needs seconds."""
    for j in range(8):
        to[j] = values[j]


@_inner
def _solved(s11, s12, s22, a, b):
    """S^-1 (a, b)."""
    scale = 1.0 / (s11 * s22 - s12.real * s12.real - s12.imag * s12.imag)
    return (s22 * a - s12 * b) * scale, (s11 * b - np.conj(s12) * a) * scale


@_inner
def _cost(u, noise, record, w, m, t):
    total = 0.0
    for i in range(w.size):
        e1, e2, s11, s12, s22, _a, _b, _c, _d = _line(u[i], noise[record[i]], w[i], m, t)
        v1, v2 = _solved(s11, s12, s22, e1, e2)
        total += (np.conj(e1) * v1 + np.conj(e2) * v2).real
    return total


@_inner
def _expand(u, noise, record, w, m, t, g, h, scale):
    """Half gradient g (8) and exact half Hessian h (8, 8; lower triangle); scale: positive part of its diagonal."""
    g[:] = 0.0
    h[:] = 0.0
    scale[:] = 0.0
    q = np.empty((8, 4))
    for i in range(w.size):
        n, wi = noise[record[i]], w[i]
        e1, e2, s11, s12, s22, c11, c12, c21, c22 = _line(u[i], n, wi, m, t)
        v1, v2 = _solved(s11, s12, s22, e1, e2)
        y = (u[i, 2] - c11 * v1 - c12 * v2, u[i, 3] - c21 * v1 - c22 * v2)
        v = (v1, v2)
        c = ((np.conj(c11), np.conj(c12)), (np.conj(c21), np.conj(c22)))
        # Inverse of the Cholesky factor of S.
        p11 = 1.0 / np.sqrt(s11)
        l21 = np.conj(s12) * p11
        p22 = 1.0 / np.sqrt(s22 - (l21.real * l21.real + l21.imag * l21.imag))
        p21 = -l21 * (p11 * p22)
        for a in range(2):
            for b in range(2):
                j = 2 * a + b
                turn = np.conj(v[a]) * y[b]
                g[j] -= turn.real
                g[j + 4] += wi * turn.imag
                d1, d2 = v[a] * c[b][0], v[a] * c[b][1]
                k1, k2 = (y[b] - d1, -d2) if a == 0 else (-d1, y[b] - d2)
                r1, r2 = p11 * k1, p21 * k1 + p22 * k2
                q[j, 0], q[j, 1], q[j, 2], q[j, 3] = r1.real, r1.imag, r2.real, r2.imag
                k1, k2 = (y[b] + d1, d2) if a == 0 else (d1, y[b] + d2)
                r1, r2 = wi * p11 * k1, wi * (p21 * k1 + p22 * k2)
                q[j + 4, 0], q[j + 4, 1], q[j + 4, 2], q[j + 4, 3] = -r1.imag, r1.real, -r2.imag, r2.real
        for j in range(8):
            scale[j] += q[j, 0] * q[j, 0] + q[j, 1] * q[j, 1] + q[j, 2] * q[j, 2] + q[j, 3] * q[j, 3]
            for k in range(j + 1):
                h[j, k] += q[j, 0] * q[k, 0] + q[j, 1] * q[k, 1] + q[j, 2] * q[k, 2] + q[j, 3] * q[k, 3]
        # Subtract the amount that displacement noise adds to these terms on average.
        for j in range(4):
            for k in range(4):
                part = np.conj(v[j // 2]) * v[k // 2] * n[2 + j % 2, 2 + k % 2]
                h[j + 4, k] += wi * part.imag
                if k <= j:
                    h[j, k] -= part.real
                    h[j + 4, k + 4] -= wi * wi * part.real


@_inner
def _newton(g, h, scale, damp, held, a, x):
    """x = -(h + damp scale)^-1 g with coefficient `held` fixed (-1: none); returns False if not positive definite."""
    for j in range(8):
        for k in range(j + 1):
            a[j, k] = 0.0 if j == held or k == held else h[j, k]
        a[j, j] += damp * scale[j]
        x[j] = -g[j]
    if held >= 0:
        a[held, held], x[held] = 1.0, 0.0
    for j in range(8):
        for k in range(j):
            total = a[j, k]
            for i in range(k):
                total -= a[j, i] * a[k, i]
            a[j, k] = total / a[k, k]
        total = a[j, j]
        for i in range(j):
            total -= a[j, i] * a[j, i]
        if not total > 1e-14 * a[j, j]:
            return False
        a[j, j] = np.sqrt(total)
    for j in range(8):
        for i in range(j):
            x[j] -= a[j, i] * x[i]
        x[j] /= a[j, j]
    for j in range(7, -1, -1):
        for i in range(j + 1, 8):
            x[j] -= a[i, j] * x[i]
        x[j] /= a[j, j]
    return True


@_inner
def _minimise(u, noise, record, w, m, t, held, tolerance):
    """Damped Newton search from t, which is moved to the minimum; returns the cost there."""
    g, h, scale = np.empty(8), np.empty((8, 8)), np.empty(8)
    a, step = np.empty((8, 8)), np.empty(8)
    cost = _cost(u, noise, record, w, m, t)
    damp, fresh = 1e-6, True
    for _ in range(_ITERATIONS):
        if fresh:
            _expand(u, noise, record, w, m, t, g, h, scale)
        fresh = False
        if _newton(g, h, scale, damp, held, a, step):
            expected = 0.0
            for j in range(8):
                expected -= g[j] * step[j]
                step[j] += t[j]
            trial = _cost(u, noise, record, w, m, step)
            if trial <= cost:
                gain = cost - trial
                _copy(step, t)
                cost, fresh = trial, True
                # Converged when a full step gains as much as the quadratic model predicts.
                if gain <= tolerance or (damp <= 1e-6 and abs(gain - expected) <= tolerance):
                    break
                damp = max(0.1 * damp, 1e-9)
                continue
        damp = max(10.0 * damp, 1e-4)
        if damp > 1e12:
            break
    return cost


@_inner
def _bound(u, noise, record, w, m, best, cost0, j, threshold, start, ridge):
    """Value of coefficient j at which its profile cost has risen by threshold; infinite if it never does.

    The search leaves the minimum in steps that begin with `start`.
    """
    t, trial, last = np.empty(8), np.empty(8), best.copy()
    inside, g_in, outside, g_out = 0.0, -1.0, 0.0, 0.0
    step, before = start, 0.0
    for tries in range(_WALK):
        # The other coefficients start from the cheapest of three points: on the path so far, on the ridge, or at the
        # minimum. Noise gives the profile side valleys, and a search that keeps to its path could stay in one.
        least = np.inf
        for way in range(3):
            for i in range(8):
                if way == 0:
                    trial[i] = best[i] + (last[i] - best[i]) * (step / before if before != 0.0 else 0.0)
                else:
                    trial[i] = best[i] + (ridge[i] * step if way == 1 else 0.0)
            trial[j] = best[j] + step
            cost = _cost(u, noise, record, w, m, trial)
            if cost < least:
                least = cost
                _copy(trial, t)
        cost = _minimise(u, noise, record, w, m, t, j, _ROUGH)
        _copy(t, last)
        before = step
        g = np.sqrt(max(cost - cost0, 0.0) / threshold) - 1.0
        if abs(g) < 1e-3:
            return best[j] + step
        if g > 0.0:
            g_in *= 0.5 if outside != 0.0 else 1.0
            outside, g_out = step, g
        else:
            inside, g_in = step, g
            g_out *= 0.5
        if outside == 0.0:
            step *= 2.0 if tries > 3 or g < -0.5 else 1.01 / (1.0 + g)
        elif abs(outside - inside) < 1e-3 * abs(outside):
            return best[j] + step
        else:
            step = inside - g_in * (outside - inside) / (g_out - g_in)
    return np.inf if start > 0.0 else -np.inf


@_inner
def _spread(u, noise, own, record, w, m, t, inverse, periods, out):
    """Sandwich standard errors and related values of `estimate`, from the inverse half Hessian.

    The pooled covariance weights the lines; the covariances of the single lines say how much noise entered. The pooled
    covariance is itself estimated, and where constant coefficients do not fit the band, other weights move the
    optimum. Writes out[8:32] and out[33:35].
    """
    lines = w.size
    total, square, most = np.zeros(8), np.zeros(8), 0.0
    rest = rest_square = 0.0
    turn = np.zeros((periods.size, 8, 4, 4), np.complex128)
    alike, alike_square = np.zeros(periods.size), np.zeros(periods.size)
    b_of, z, half = np.empty(4, np.complex128), np.empty((2, 2), np.complex128), np.empty((4, 4), np.complex128)
    y, v, a_of = np.empty(2, np.complex128), np.empty(2, np.complex128), np.empty(4, np.complex128)
    for i in range(lines):
        wi, n = w[i], noise[record[i]]
        e1, e2, s11, s12, s22, c11, c12, c21, c22 = _line(u[i], n, wi, m, t)
        _e, _f, o11, o12, o22, _a, _b, _c, _d = _line(u[i], own[i], wi, m, t)
        v[0], v[1] = _solved(s11, s12, s22, e1, e2)
        y[0], y[1] = u[i, 2] - c11 * v[0] - c12 * v[1], u[i, 3] - c21 * v[0] - c22 * v[1]
        for a in range(2):
            for b in range(2):
                z[a, b] = complex(t[2 * a + b] - (m[a] * wi * wi if a == b else 0.0), wi * t[2 * a + b + 4])
        a_of[0], a_of[1] = v[0], v[1]
        for b in range(2):
            a_of[2 + b] = -(np.conj(z[0, b]) * v[0] + np.conj(z[1, b]) * v[1])
        freedom = 2.0 * periods[record[i]]  # the square of a sample variance is P / (P - 1) times the true square
        most += 2.0 * (periods[record[i]] - 1.0)
        share = (_solved(s11, s12, s22, o11 + 0j, np.conj(o12))[0] + _solved(s11, s12, s22, o12, o22 + 0j)[1]).real
        alike[record[i]] += share
        alike_square[record[i]] += share * share / (1.0 + 0.5 / (periods[record[i]] - 1.0))
        for j in range(8):
            # Change of Z along the j-th row of the inverse: applied to the displacement, and its adjoint applied to v.
            d11, d12 = complex(inverse[j, 0], wi * inverse[j, 4]), complex(inverse[j, 1], wi * inverse[j, 5])
            d21, d22 = complex(inverse[j, 2], wi * inverse[j, 6]), complex(inverse[j, 3], wi * inverse[j, 7])
            zy1, zy2 = d11 * y[0] + d12 * y[1], d21 * y[0] + d22 * y[1]
            zv1, zv2 = np.conj(d11) * v[0] + np.conj(d21) * v[1], np.conj(d12) * v[0] + np.conj(d22) * v[1]
            q1, q2 = _solved(s11, s12, s22, zy1, zy2)
            power = abs(q1) ** 2 * o11 + abs(q2) ** 2 * o22 + 2.0 * (np.conj(q1) * o12 * q2).real
            total[j] += power
            square[j] += power * power / freedom
            # Leverage: the same with the j-th unit vector on the left side.
            row, col = (j % 4) // 2, j % 2
            unit = y[col] * (1.0 if j < 4 else 1j * wi)
            r1, r2 = _solved(s11, s12, s22, unit if row == 0 else 0j, unit if row == 1 else 0j)
            share -= 0.5 * (np.conj(r1) * (o11 * q1 + o12 * q2) + np.conj(r2) * (np.conj(o12) * q1 + o22 * q2)).real
            # The half gradient changes by Re(a^H dN b) when the pooled covariance changes by dN.
            back1, back2 = np.conj(c11) * zv1 + np.conj(c21) * zv2, np.conj(c12) * zv1 + np.conj(c22) * zv2
            b_of[0], b_of[1] = _solved(s11, s12, s22, zy1 - back1, zy2 - back2)
            for b in range(2):
                b_of[2 + b] = -(np.conj(z[0, b]) * b_of[0] + np.conj(z[1, b]) * b_of[1])
            b_of[2] += zv1
            b_of[3] += zv2
            for a in range(4):
                for b in range(4):
                    both = 0.5 * b_of[a] * np.conj(a_of[b])
                    turn[record[i], j, a, b] += both
                    turn[record[i], j, b, a] += np.conj(both)
        share = max(share, 0.0)
        rest += share
        rest_square += share * share / (1.0 + 0.5 / (periods[record[i]] - 1.0))
    for j in range(8):
        scatter = 0.0
        for r in range(periods.size):
            # Lines of unequal noise give a pooled covariance with fewer degrees of freedom.
            of_record = 0.0
            for i in range(lines):
                of_record += record[i] == r
            count = min(alike[r] ** 2 / alike_square[r], of_record)
            for a in range(4):
                for b in range(4):
                    half[a, b] = 0j
                    for c in range(4):
                        half[a, b] += turn[r, j, a, c] * noise[r, c, b]
            trace = 0.0
            for a in range(4):
                for b in range(4):
                    trace += (half[a, b] * half[b, a]).real
            scatter += 2.0 * trace / (count * (periods[r] - 1.0))
        out[8 + j] = np.sqrt(0.5 * (total[j] + scatter))
        out[16 + j] = (total[j] + scatter) / inverse[j, j]
        out[24 + j] = min((total[j] + scatter) ** 2 / square[j], most)
    out[33], out[34] = rest, min(4.0 * rest * rest / rest_square, 4.0 * lines - 8.0)


@_compiled
def estimate(u, noise, own, record, w, mass, periods, starts, out, inverses):
    """Estimate the coefficients of every lane.

    Args:
        u: Channels (lanes, n, 4).
        noise: Pooled covariances (lanes, records, 4, 4).
        own: Covariances of the lines (lanes, n, 4, 4).
        record: Record of each line (n,).
        w: Angular frequencies (n,), rad/s.
        mass: Masses (lanes, 2), kg.
        periods: Periods per record.
        starts: Starting points (lanes, 2, 8).
        out: Result (lanes, 35): coefficients [0:8], standard errors [8:16], inflation of the thresholds [16:24],
            degrees of freedom [24:32], cost [32], its expectation for noise alone [33] and its numerator degrees of
            freedom [34].
        inverses: Result (lanes, 8, 8): inverse half Hessian.
    """
    g, h, scale = np.empty(8), np.empty((8, 8)), np.empty(8)
    a, x = np.empty((8, 8)), np.empty(8)
    none = np.int64(-1)  # typed, because a literal would have the search compiled a second time
    for lane in range(u.shape[0]):
        best, t = np.inf, np.full(8, np.nan)
        for s in range(2):
            trial = starts[lane, s].copy()
            cost = _minimise(u[lane], noise[lane], record, w, mass[lane], trial, none, _FINE)
            if cost < best:
                best, t = cost, trial
        o = out[lane]
        _copy(t, o)
        o[32] = best
        # Values for an optimum that ran to infinity: it is unknown, and no interval is bounded.
        for j in range(8):
            o[8 + j], o[16 + j], o[24 + j] = np.inf, 1.0, 1.0
            for k in range(8):
                inverses[lane, j, k] = 0.0
        o[33], o[34] = 2.0 * w.size - 4.0, 4.0 * w.size - 8.0
        _expand(u[lane], noise[lane], record, w, mass[lane], t, g, h, scale)
        regular = True
        for j in range(8):
            for k in range(8):
                g[k] = 0.0
            g[j] = -1.0
            regular = regular and _newton(g, h, scale, 0.0, none, a, x)
            if regular:
                _copy(x, inverses[lane, j])
        if regular:
            _spread(u[lane], noise[lane], own[lane], record, w, mass[lane], t, inverses[lane], periods, o)


@_compiled
def bounds(u, noise, record, w, mass, found, inverses, threshold, out):
    """Profile bounds (lanes, 8, 2) into out; found and inverses as `estimate` left them; threshold (lanes, 8)."""
    for lane in range(u.shape[0]):
        o = found[lane]
        for j in range(8):
            spread = inverses[lane, j, j]
            for side in range(2):
                sign = 2.0 * side - 1.0
                if not (spread > 0.0 and np.isfinite(threshold[lane, j])):
                    out[lane, j, side] = sign * np.inf
                    continue
                start = sign * np.sqrt(threshold[lane, j] * spread)
                out[lane, j, side] = _bound(u[lane], noise[lane], record, w, mass[lane], o[:8], o[32], j,
                                            threshold[lane, j], start, inverses[lane, j] / spread)  # fmt: skip
