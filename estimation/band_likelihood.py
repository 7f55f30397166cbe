"""Compiled search behind `estimation.max_likelihood`; it treats one band of one lane at a time.

Notation for one line: e = F - Z Y is the equation error, S its variance, n_Y the noise of the displacement and
C = E[n_Y e*] its covariance with e. With v = e / S, the displacement corrected for the noise that e reveals is
Y - C v. The cost |e|^2 / S then has the half gradient -Re(v* Z_j (Y - C v)), where Z_j is 1 for the stiffness and
j w for the damping.
"""

import numba as nb
import numpy as np

# Changes of the cost that count as converged: for the estimate, and while searching for a bound (a bound lies where
# the cost has risen by about 2).
_FINE, _ROUGH = 1e-8, 1e-4
_ITERATIONS = 60
_DOUBLINGS = 40
_INFINITE = 1e300


@nb.njit(cache=True, nogil=True, error_model="numpy", inline="always")
def _line(f, y, sff, syy, sfy, a, b):
    """Return v, S, C and Y - C v (see the module docstring) of one line with the impedance Z = a + j b."""
    s = sff + (a * a + b * b) * syy - 2.0 * (a * sfy.real + b * sfy.imag)
    v = (f - complex(a, b) * y) * (1.0 / s)
    cov = np.conj(sfy) - complex(a, -b) * syy
    return v, s, cov, y - cov * v


@nb.njit(cache=True, nogil=True, error_model="numpy")
def _cost(f, y, sff, syy, sfy, w, m, k, c):
    total = 0.0
    for i in range(f.size):
        a, b = k - m * w[i] * w[i], w[i] * c
        var = sff + (a * a + b * b) * syy - 2.0 * (a * sfy.real + b * sfy.imag)
        e = f[i] - complex(a, b) * y[i]
        total += (e.real * e.real + e.imag * e.imag) / var
    return total


@nb.njit(cache=True, nogil=True, error_model="numpy")
def _expand(f, y, sff, syy, sfy, w, m, k, c):
    """Return the cost, its half gradient (k, c), its exact half Hessian (kk, kc, cc) and that Hessian's positive part.

    The positive part is the Hessian's diagonal (kk, cc) without the terms that the noise subtracts.
    """
    cost = gk = gc = pkk = hkc = pcc = nk = nc = 0.0
    for i in range(f.size):
        wi = w[i]
        v, s, cov, rest = _line(f[i], y[i], sff, syy, sfy, k - m * wi * wi, wi * c)
        power, share = v.real * v.real + v.imag * v.imag, 1.0 / s
        cost += power * s
        gk -= v.real * rest.real + v.imag * rest.imag
        gc += wi * (v.real * rest.imag - v.imag * rest.real)
        turn = v * np.conj(cov)
        dk, dc = rest - turn, rest + turn
        pkk += share * (dk.real * dk.real + dk.imag * dk.imag)
        pcc += wi * wi * share * (dc.real * dc.real + dc.imag * dc.imag)
        hkc += wi * share * (dk.imag * dc.real - dk.real * dc.imag)
        # Subtracted below: the amount that displacement noise adds to these terms on average.
        nk += power * syy
        nc += wi * wi * power * syy
    return cost, gk, gc, pkk - nk, hkc, pcc - nc, pkk, pcc


@nb.njit(cache=True, nogil=True, error_model="numpy")
def _minimise(f, y, sff, syy, sfy, w, m, k, c, free_k, free_c, tolerance):
    """Damped Newton search over k and c, or over one of them; returns k, c, the cost and its half Hessian."""
    cost, gk, gc, hkk, hkc, hcc, pkk, pcc = _expand(f, y, sff, syy, sfy, w, m, k, c)
    damp = 1e-6
    for _ in range(_ITERATIONS):
        akk, acc, akc = hkk + damp * pkk, hcc + damp * pcc, hkc
        if not free_k:
            akk, akc, gk = 1.0, 0.0, 0.0
        elif not free_c:
            acc, akc, gc = 1.0, 0.0, 0.0
        det = akk * acc - akc * akc
        if akk > 0.0 and det > 1e-14 * akk * acc:
            sk, sc = -(acc * gk - akc * gc) / det, -(akk * gc - akc * gk) / det
            expected = -(sk * gk + sc * gc)
            trial, tk, tc, tkk, tkc, tcc, qkk, qcc = _expand(f, y, sff, syy, sfy, w, m, k + sk, c + sc)
            if trial <= cost:
                gain = cost - trial
                k, c, cost, gk, gc = k + sk, c + sc, trial, tk, tc
                hkk, hkc, hcc, pkk, pcc = tkk, tkc, tcc, qkk, qcc
                # Converged when a full step gains as much as the quadratic model predicts.
                if gain <= tolerance or (damp <= 1e-6 and abs(gain - expected) <= tolerance):
                    break
                damp = max(0.1 * damp, 1e-9)
                continue
        damp = max(10.0 * damp, 1e-4)
        if damp > 1e12:
            break
    return k, c, cost, hkk, hkc, hcc


@nb.njit(cache=True, nogil=True, error_model="numpy")
def _profile(f, y, sff, syy, sfy, w, m, k0, c0, k, c, step, slope, along_k):
    """Lowest cost with one coefficient held at the distance `step` from the minimum (k0, c0).

    The other coefficient starts from the cheapest of three points: where it was last (k, c), along the ridge, or at
    the minimum. Noise gives the profile side valleys, and a search that keeps to the last point could stay in one.
    """
    best, k1, c1 = np.inf, k0, c0
    for start in range(3):
        if along_k:
            k2, c2 = k0 + step, c if start == 0 else (c0 + slope * step if start == 1 else c0)
        else:
            k2, c2 = k if start == 0 else (k0 + slope * step if start == 1 else k0), c0 + step
        cost = _cost(f, y, sff, syy, sfy, w, m, k2, c2)
        if cost < best:
            best, k1, c1 = cost, k2, c2
    k1, c1, best, _a, _b, _c = _minimise(f, y, sff, syy, sfy, w, m, k1, c1, not along_k, along_k, _ROUGH)
    return k1, c1, best


@nb.njit(cache=True, nogil=True, error_model="numpy")
def _bound(f, y, sff, syy, sfy, w, m, k0, c0, cost0, threshold, start, slope, along_k):
    """Coefficient at which the profile cost has risen by threshold; the search leaves the minimum in steps of `start`.

    Infinite, with the sign of `start`, if the cost never rises that far.
    """
    k, c = k0, c0
    inside, outside = 0.0, 0.0
    g_in, g_out = -1.0, 0.0
    step = start
    found = False
    for _ in range(_DOUBLINGS):
        k, c, cost = _profile(f, y, sff, syy, sfy, w, m, k0, c0, k, c, step, slope, along_k)
        g = np.sqrt(max(cost - cost0, 0.0) / threshold) - 1.0
        if g >= 0.0:
            outside, g_out, found = step, g, True
            break
        inside, g_in = step, g
        step *= 1.5
    if not found:
        return np.inf if start > 0 else -np.inf
    for _ in range(30):
        mid = inside - g_in * (outside - inside) / (g_out - g_in)
        if abs(outside - inside) < 1e-3 * abs(outside):
            break
        k, c, cost = _profile(f, y, sff, syy, sfy, w, m, k0, c0, k, c, mid, slope, along_k)
        g = np.sqrt(max(cost - cost0, 0.0) / threshold) - 1.0
        if abs(g) < 1e-3:
            break
        if g > 0:
            outside, g_out = mid, g
            g_in *= 0.5
        else:
            inside, g_in = mid, g
            g_out *= 0.5
    return (k0 if along_k else c0) + mid


@nb.njit(cache=True, nogil=True, error_model="numpy", inline="always")
def _quadratic(a, b, re, im, sff, syy, sfy):
    """Variance of a s_F^2 + b s_Y^2 + re Re s_FY + im Im s_FY, times the degrees of freedom of the Wishart covariance.

    It equals tr(M C M C) with the Hermitian matrix M of the coefficients.
    """
    g = complex(re, im) * 0.5
    p, q = a * sff + g * np.conj(sfy), a * sfy + g * syy
    u, v = np.conj(g) * sff + b * np.conj(sfy), np.conj(g) * sfy + b * syy
    return (p * p + 2.0 * q * u + v * v).real


@nb.njit(cache=True, nogil=True, error_model="numpy")
def _sandwich(f, y, sff, syy, sfy, pf, py, pfy, w, m, k, c, periods, hkk, hkc, hcc, o):
    """Standard errors that hold although the noise differs between the lines of the band.

    The pooled covariance weights the lines; the covariances of the single lines say how much noise entered. The pooled
    covariance is itself estimated, and where constant coefficients do not fit the band, other weights move the
    optimum; the delta method adds that variance.

    Writes into o: [2:4] standard errors of k and c, [4:6] the ratio of their variances to the inverse half Hessian,
    [6:8] their degrees of freedom (Satterthwaite), [10] the cost that noise alone is expected to leave and [11] the
    numerator degrees of freedom of the cost.
    """
    most = 2.0 * f.size * (periods - 1)
    # Values for an optimum that ran to infinity: k and c are unknown and no interval is bounded.
    o[2] = o[3] = np.inf
    o[4] = o[5] = 1.0
    o[6] = o[7] = most
    o[10], o[11] = f.size - 1.0, 2.0 * (f.size - 1)
    det = hkk * hcc - hkc * hkc
    if not (hkk > 0.0 and det > 0.0 and np.isfinite(hcc / det) and np.isfinite(hkk / det)):
        return
    ik, ix, ic = hcc / det, -hkc / det, hkk / det
    sum_k = sum_c = square_k = square_c = alike = alike_square = 0.0
    hats = by_hat = hat_square = cross = 0.0
    ka = kb = kr = ki = ca = cb = cr = ci = 0.0  # derivatives of the half gradient by s_F^2, s_Y^2, Re s_FY, Im s_FY
    for i in range(f.size):
        wi = w[i]
        a, b = k - m * wi * wi, wi * c
        z = a * a + b * b
        v, s, cov, rest = _line(f[i], y[i], pf, py, pfy, a, b)
        ratio = (sff[i] + z * syy[i] - 2.0 * (a * sfy[i].real + b * sfy[i].imag)) / s
        signal = (rest.real * rest.real + rest.imag * rest.imag) / s
        kk, cc = (ik * ik + wi * wi * ix * ix) * signal * ratio, (ix * ix + wi * wi * ic * ic) * signal * ratio
        sum_k, square_k = sum_k + kk, square_k + kk * kk
        sum_c, square_c = sum_c + cc, square_c + cc * cc
        hat = (ik + wi * wi * ic) * signal
        hats, by_hat = hats + hat, by_hat + hat * ratio
        hat_square, cross = hat_square + (hat * ratio) ** 2, cross + hat * ratio * ratio
        alike, alike_square = alike + ratio, alike_square + ratio * ratio
        power = v.real * v.real + v.imag * v.imag
        turn = np.conj(v) * (rest - cov * v) / s
        tk, tc = turn.real, -wi * turn.imag
        ka, kb, kr, ki = ka + tk, kb + tk * z - a * power, kr + power - 2.0 * a * tk, ki - 2.0 * b * tk
        ca, cb = ca + tc, cb + tc * z - wi * b * power
        cr, ci = cr - 2.0 * a * tc, ci + wi * power - 2.0 * b * tc
    # The square of a sample variance exceeds the square of the true variance by the factor 1 + 1 / (periods - 1).
    thin = periods / (periods - 1.0)
    # Lines of unequal noise give a pooled covariance with fewer degrees of freedom.
    count = min(thin * alike * alike / alike_square, float(f.size))
    of_k = _quadratic(ik * ka + ix * ca, ik * kb + ix * cb, ik * kr + ix * cr, ik * ki + ix * ci, pf, py, pfy)
    of_c = _quadratic(ix * ka + ic * ca, ix * kb + ic * cb, ix * kr + ic * cr, ix * ki + ic * ci, pf, py, pfy)
    sum_k += 2.0 * of_k / (count * (periods - 1))
    sum_c += 2.0 * of_c / (count * (periods - 1))
    o[2], o[3] = np.sqrt(0.5 * sum_k), np.sqrt(0.5 * sum_c)
    o[4], o[5] = sum_k / ik, sum_c / ic
    o[6] = min(2.0 * periods * sum_k * sum_k / square_k, most)
    o[7] = min(2.0 * periods * sum_c * sum_c / square_c, most)
    # The leverages are scaled to sum to one; those of the exact Hessian can be far from that in noise.
    sum_r = alike - by_hat / hats
    square_r = alike_square - 2.0 * cross / hats + hat_square / (hats * hats)
    o[10], o[11] = sum_r, min(2.0 * thin * sum_r * sum_r / square_r, 2.0 * (f.size - 1))


@nb.njit(cache=True, nogil=True, error_model="numpy")
def estimate(force, disp, sff, syy, sfy, w, mass, slices, periods, out):
    """Estimate every band of every lane.

    Writes into out (lanes, bands, 14): [0:2] k and c; [2:8] and [10:12] as `_sandwich`; [8] the cost; [9] the noise
    share; [12:14] the slopes dc/dk and dk/dc along the ridge of the cost.
    """
    for lane in range(force.shape[0]):
        m = mass[lane]
        for band in range(slices.shape[0]):
            a, b = slices[band, 0], slices[band, 1]
            f, y, wb = force[lane, a:b], disp[lane, a:b], w[a:b]
            n = b - a
            if not np.isfinite(y[0].real):
                continue
            pf, py = sff[lane, a:b].mean(), syy[lane, a:b].mean()
            pfy = sfy[lane, a:b].mean()
            # Two starting points: the moment estimator corrected for noise, and the dissertation's least squares.
            best = _INFINITE
            k = c = hkk = hkc = hcc = 0.0
            power = 0.0
            for i in range(n):
                power += abs(y[i]) ** 2
            for start in range(2):
                noise = py if start == 0 else 0.0
                nk = dk = nc = dc = 0.0
                for i in range(n):
                    fy = f[i] * np.conj(y[i]) - (pfy if start == 0 else 0.0)
                    p = abs(y[i]) ** 2 - noise
                    nk += fy.real + m * wb[i] ** 2 * p
                    dk += p
                    nc += wb[i] * fy.imag
                    dc += wb[i] ** 2 * p
                if dk <= 0.0 or dc <= 0.0:
                    continue
                k1, c1, cost, h1, h2, h3 = _minimise(f, y, pf, py, pfy, wb, m, nk / dk, nc / dc, True, True, _FINE)
                if cost < best:
                    best, k, c, hkk, hkc, hcc = cost, k1, c1, h1, h2, h3
            o = out[lane, band]
            o[0], o[1], o[8], o[9] = k, c, best, min(n * py / power, 1.0)
            own = (sff[lane, a:b], syy[lane, a:b], sfy[lane, a:b])
            _sandwich(f, y, own[0], own[1], own[2], pf, py, pfy, wb, m, k, c, periods, hkk, hkc, hcc, o)
            o[12], o[13] = -hkc / hcc, -hkc / hkk


@nb.njit(cache=True, nogil=True, error_model="numpy")
def bounds(force, disp, sff, syy, sfy, w, mass, slices, found, threshold, out):
    """Profile-likelihood bounds (k low, k high, c low, c high) of every band of every lane, written into out.

    found is the output of `estimate`; threshold (lanes, bands, 2) is the rise of the cost that defines a bound.
    """
    for lane in range(force.shape[0]):
        m = mass[lane]
        for band in range(slices.shape[0]):
            a, b = slices[band, 0], slices[band, 1]
            f, y, wb = force[lane, a:b], disp[lane, a:b], w[a:b]
            o, to = found[lane, band], out[lane, band]
            k, c, best = o[0], o[1], o[8]
            if not np.isfinite(k):
                continue
            qk, qc = threshold[lane, band, 0], threshold[lane, band, 1]
            pf, py = sff[lane, a:b].mean(), syy[lane, a:b].mean()
            pfy = sfy[lane, a:b].mean()
            power = 0.0
            for i in range(b - a):
                power += abs(y[i]) ** 2
            # Cost of an infinitely stiff or damped support, for which all measured displacement would be noise.
            far = power / py - best if py > 0.0 else np.inf
            for j in range(4):
                sign = -1.0 if j % 2 == 0 else 1.0
                if not np.isfinite(o[2]) or far <= (qk if j < 2 else qc):
                    to[j] = sign * np.inf
                else:  # one call of both, because the compiler would make two functions of two constants
                    along_k = j < 2
                    rise, slope = (qk, o[12]) if along_k else (qc, o[13])
                    start = sign * np.sqrt(2.0 * rise / (o[4] if along_k else o[5])) * (o[2] if along_k else o[3])
                    to[j] = _bound(f, y, pf, py, pfy, wb, m, k, c, best, rise, start, slope, along_k)
