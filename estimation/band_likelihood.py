"""Compiled search behind `estimation.max_likelihood`: one band of one lane at a time."""

import numba as nb
import numpy as np

# Changes of the cost (a threshold is about 2) that no longer matter: for the estimate, and on the way to a bound.
_FINE, _ROUGH = 1e-8, 1e-4
_ITERATIONS = 60
_DOUBLINGS = 40
_INFINITE = 1e300


@nb.njit(cache=True, nogil=True, error_model="numpy", inline="always")
def _terms(f, y, sff, syy, sfy, w, m, k, c):
    """Cost of one line and its derivatives' Gauss-Newton parts: r, dr/dk, dr/dc (complex)."""
    a, b = k - m * w * w, w * c
    var = sff + (a * a + b * b) * syy - 2.0 * (a * sfy.real + b * sfy.imag)
    s = 1.0 / np.sqrt(var)
    r = (f - complex(a, b) * y) * s
    half = 0.5 * s * s
    da = -y * s - r * (half * (2.0 * a * syy - 2.0 * sfy.real))
    db = -1j * y * s - r * (half * (2.0 * b * syy - 2.0 * sfy.imag))
    return r, da, w * db


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
def _minimise(f, y, sff, syy, sfy, w, m, k, c, free_k, free_c, tolerance):
    """Levenberg-Marquardt over k, c or one of them; returns k, c, cost and the information matrix."""
    cost = _cost(f, y, sff, syy, sfy, w, m, k, c)
    damp = 1e-4
    hkk = hkc = hcc = 0.0
    fresh = True
    gk = gc = 0.0
    for _ in range(_ITERATIONS):
        if fresh:
            hkk = hkc = hcc = gk = gc = 0.0
            for i in range(f.size):
                r, dk, dc = _terms(f[i], y[i], sff, syy, sfy, w[i], m, k, c)
                hkk += dk.real * dk.real + dk.imag * dk.imag
                hcc += dc.real * dc.real + dc.imag * dc.imag
                hkc += dk.real * dc.real + dk.imag * dc.imag
                gk += dk.real * r.real + dk.imag * r.imag
                gc += dc.real * r.real + dc.imag * r.imag
        akk, acc, akc = hkk * (1.0 + damp), hcc * (1.0 + damp), hkc
        if not free_k:
            akk, akc, sk, sc = 1.0, 0.0, 0.0, -gc / acc
        elif not free_c:
            acc, akc, sk, sc = 1.0, 0.0, -gk / akk, 0.0
        else:
            det = akk * acc - akc * akc
            sk, sc = -(acc * gk - akc * gc) / det, -(akk * gc - akc * gk) / det
        trial = _cost(f, y, sff, syy, sfy, w, m, k + sk, c + sc)
        if trial <= cost:
            gain = cost - trial
            k, c, cost = k + sk, c + sc, trial
            damp *= 0.1
            fresh = True
            if gain <= tolerance:
                break
        else:
            damp = max(damp, 1e-6) * 10.0
            fresh = False
            if damp > 1e12:
                break
    return k, c, cost, hkk, hkc, hcc


@nb.njit(cache=True, nogil=True, error_model="numpy")
def _profile(f, y, sff, syy, sfy, w, m, k0, c0, k, c, step, slope, along_k):
    """Lowest cost with one coefficient held `step` from the minimum (k0, c0).

    The other starts where it costs least: where it last was (k, c), along the ridge, or at the minimum; in noise the
    profile has side valleys, and a walk that stays in one would find no way back.
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
    """Where the profile cost rises by threshold, walking from the minimum by `start`; infinite if it never does."""
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
    """Variance of a s_F^2 + b s_Y^2 + re Re s_FY + im Im s_FY times its Wishart freedom: tr(M C M C), M Hermitian."""
    g = complex(re, im) * 0.5
    p, q = a * sff + g * np.conj(sfy), a * sfy + g * syy
    u, v = np.conj(g) * sff + b * np.conj(sfy), np.conj(g) * sfy + b * syy
    return (p * p + 2.0 * q * u + v * v).real


@nb.njit(cache=True, nogil=True, error_model="numpy")
def _weight_scatter(f, y, sff, syy, sfy, w, m, k, c, ik, ix, ic):
    """Variance of k and c, times the Wishart freedom and over 2, from the scatter of the pooled covariance.

    That covariance is an estimate and sets the weights of the lines: where constant coefficients do not fit the band,
    other weights have another optimum. Delta method; ik, ix, ic: inverse of the information matrix.
    """
    ka = kb = kr = ki = ca = cb = cr = ci = 0.0  # derivatives of the gradient by s_F^2, s_Y^2, Re s_FY, Im s_FY
    for i in range(f.size):
        a, b = k - m * w[i] * w[i], w[i] * c
        s = 1.0 / (sff + (a * a + b * b) * syy - 2.0 * (a * sfy.real + b * sfy.imag))
        e = f[i] - complex(a, b) * y[i]
        q = (e.real * e.real + e.imag * e.imag) * s * s
        turn = e * np.conj(y[i]) * (2.0 * s * s)
        tk = turn.real + 4.0 * q * s * (a * syy - sfy.real)
        tc = turn.imag + 4.0 * q * s * (b * syy - sfy.imag)
        ka += tk
        kb += tk * (a * a + b * b) - 2.0 * a * q
        kr += 2.0 * (q - a * tk)
        ki -= 2.0 * b * tk
        ca += w[i] * tc
        cb += w[i] * (tc * (a * a + b * b) - 2.0 * b * q)
        cr -= w[i] * 2.0 * a * tc
        ci += w[i] * 2.0 * (q - b * tc)
    of_k = _quadratic(ik * ka + ix * ca, ik * kb + ix * cb, ik * kr + ix * cr, ik * ki + ix * ci, sff, syy, sfy)
    of_c = _quadratic(ix * ka + ic * ca, ix * kb + ic * cb, ix * kr + ic * cr, ix * ki + ic * ci, sff, syy, sfy)
    return 0.5 * of_k, 0.5 * of_c


@nb.njit(cache=True, nogil=True, error_model="numpy")
def _sandwich(f, y, sff, syy, sfy, pf, py, pfy, w, m, k, c, periods, hkk, hkc, hcc, o):
    """Standard errors that hold when the noise is not the same on all lines of the band; writes o[2:8].

    The pooled covariance weights the lines, the lines' own covariances say how much noise came through. Standard errors
    of k and c, their inflation over the information matrix, degrees of freedom (Satterthwaite), then those of the
    cost: what noise alone makes of it, and its numerator freedom.
    """
    most = 2.0 * f.size * (periods - 1)
    # The optimum ran to infinity: nothing is known of k and c, and no interval will be bounded.
    o[2] = o[3] = np.inf
    o[4] = o[5] = 1.0
    o[6] = o[7] = most
    o[10], o[11] = f.size - 1.0, 2.0 * (f.size - 1)
    det = hkk * hcc - hkc * hkc
    if not (det > 0.0 and np.isfinite(hcc / det) and np.isfinite(hkk / det)):
        return
    ik, ix, ic = hcc / det, -hkc / det, hkk / det
    sum_k = sum_c = sum_r = square_k = square_c = square_r = 0.0
    for i in range(f.size):
        _r, dk, dc = _terms(f[i], y[i], pf, py, pfy, w[i], m, k, c)
        a, b = k - m * w[i] * w[i], w[i] * c
        power = a * a + b * b
        ratio = (sff[i] + power * syy[i] - 2.0 * (a * sfy[i].real + b * sfy[i].imag)) / (
            pf + power * py - 2.0 * (a * pfy.real + b * pfy.imag)
        )
        to_k, to_c = ik * dk + ix * dc, ix * dk + ic * dc
        kk, cc = abs(to_k) ** 2 * ratio, abs(to_c) ** 2 * ratio
        leverage = 0.5 * ((to_k * np.conj(dk)).real + (to_c * np.conj(dc)).real)
        rest = max(1.0 - leverage, 0.0) * ratio
        sum_k, square_k = sum_k + kk, square_k + kk * kk
        sum_c, square_c = sum_c + cc, square_c + cc * cc
        sum_r, square_r = sum_r + rest, square_r + rest * rest
    scatter_k, scatter_c = _weight_scatter(f, y, pf, py, pfy, w, m, k, c, ik, ix, ic)
    scatter_k, scatter_c = 2.0 * scatter_k / most, 2.0 * scatter_c / most
    o[2], o[3] = np.sqrt(0.5 * (sum_k + scatter_k)), np.sqrt(0.5 * (sum_c + scatter_c))
    o[4], o[5] = (sum_k + scatter_k) / ik, (sum_c + scatter_c) / ic
    # A squared sample variance is 1 + 1 / (periods - 1) of the true square too large.
    thin = periods / (periods - 1.0)
    o[6] = min(2.0 * (periods - 1) * thin * (sum_k + scatter_k) ** 2 / square_k, most)
    o[7] = min(2.0 * (periods - 1) * thin * (sum_c + scatter_c) ** 2 / square_c, most)
    o[10], o[11] = sum_r, min(2.0 * thin * sum_r * sum_r / square_r, 2.0 * (f.size - 1))


@nb.njit(cache=True, nogil=True, error_model="numpy")
def estimate(force, disp, sff, syy, sfy, w, mass, slices, periods, out):
    """Per lane and band into out[..., :12]: k, c, then as `_sandwich`, with the cost [8] and noise share [9]."""
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
            # Two starts: the moment estimator freed of noise, and D's least squares.
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
            o[12], o[13] = hkc / hcc, hkc / hkk


@nb.njit(cache=True, nogil=True, error_model="numpy")
def bounds(force, disp, sff, syy, sfy, w, mass, slices, found, threshold, out):
    """Profile bounds (k low, k high, c low, c high) into out; found: as `estimate` left it; threshold (..., 2)."""
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
            # Cost of an infinitely stiff or damped support: all displacement is noise.
            far = power / py - best if py > 0.0 else np.inf
            for j in range(4):
                sign = -1.0 if j % 2 == 0 else 1.0
                if far <= (qk if j < 2 else qc):
                    to[j] = sign * np.inf
                elif j < 2:
                    start = sign * np.sqrt(2.0 * qk / o[4]) * o[2]
                    to[j] = _bound(f, y, pf, py, pfy, wb, m, k, c, best, qk, start, -o[12], True)
                else:
                    start = sign * np.sqrt(2.0 * qc / o[5]) * o[3]
                    to[j] = _bound(f, y, pf, py, pfy, wb, m, k, c, best, qc, start, -o[13], False)
