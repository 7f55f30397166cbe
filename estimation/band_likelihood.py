"""Compiled search behind `estimation.max_likelihood`; it treats one band of one lane at a time.

Notation for one line: e = F - Z Y is the equation error, S its variance, n_Y the noise of the displacement and
C = E[n_Y e*] its covariance with e. With v = e / S, the displacement corrected for the noise that e reveals is
Y - C v. The cost |e|^2 / S then has the half gradient -Re(v* Z_j (Y - C v)), where Z_j is 1 for the stiffness and
j w for the damping.

All arrays are flat, because the compiler takes several times as long for slices and for several indices: a band of a
lane is the lines from i to end of the channels (f, y), whose frequencies are those from i - row on.
"""

from collections.abc import Callable
from functools import cache
from math import inf, isfinite, sqrt
from threading import Lock

import numpy as np

from maglev_lanes.compiled import compiled
from maglev_lanes.pieces import called

# Changes of the cost that count as converged: for the estimate, and while searching for a bound (a bound lies where
# the cost has risen by about 2).
_FINE, _ROUGH = 1e-8, 1e-4
_ITERATIONS = 60
_DOUBLINGS = 40
_INFINITE = 1e300
FOUND = 19  # numbers that `estimate` leaves for each band
_MAKING = Lock()  # threads that need a kernel at the same time make it once


@called
def _line(f, y, sff, syy, sfy, a, b):
    """Return v, S, C and Y - C v (see the module docstring) of one line with the impedance Z = a + j b."""
    s = sff + (a * a + b * b) * syy - 2.0 * (a * sfy.real + b * sfy.imag)
    v = (f - complex(a, b) * y) * (1.0 / s)
    cov = sfy.conjugate() - complex(a, -b) * syy
    return v, s, cov, y - cov * v


@called
def _cost(f, y, sff, syy, sfy, w, begin, end, row, m, k, c):
    total = 0.0
    for i in range(begin, end):
        wi = w[i - row]
        a, b = k - m * wi * wi, wi * c
        var = sff + (a * a + b * b) * syy - 2.0 * (a * sfy.real + b * sfy.imag)
        e = f[i] - complex(a, b) * y[i]
        total += (e.real * e.real + e.imag * e.imag) / var
    return total


@called
def _expand(f, y, sff, syy, sfy, w, begin, end, row, m, k, c):
    """Return the cost, its half gradient (k, c), its exact half Hessian (kk, kc, cc) and that Hessian's positive part.

    The positive part is the Hessian's diagonal (kk, cc) without the terms that the noise subtracts.
    """
    cost = gk = gc = pkk = hkc = pcc = nk = nc = 0.0
    for i in range(begin, end):
        wi = w[i - row]
        v, s, cov, rest = _line(f[i], y[i], sff, syy, sfy, k - m * wi * wi, wi * c)
        power, share = v.real * v.real + v.imag * v.imag, 1.0 / s
        cost += power * s
        gk -= v.real * rest.real + v.imag * rest.imag
        gc += wi * (v.real * rest.imag - v.imag * rest.real)
        turn = v * cov.conjugate()
        dk, dc = rest - turn, rest + turn
        pkk += share * (dk.real * dk.real + dk.imag * dk.imag)
        pcc += wi * wi * share * (dc.real * dc.real + dc.imag * dc.imag)
        hkc += wi * share * (dk.imag * dc.real - dk.real * dc.imag)
        # Subtracted below: the amount that displacement noise adds to these terms on average.
        nk += power * syy
        nc += wi * wi * power * syy
    return cost, gk, gc, pkk - nk, hkc, pcc - nc, pkk, pcc


@called
def _minimise(f, y, sff, syy, sfy, w, begin, end, row, m, k, c, free_k, free_c, tolerance):
    """Damped Newton search over k and c, or over one of them; returns k, c, the cost and its half Hessian."""
    cost, gk, gc, hkk, hkc, hcc, pkk, pcc = _expand(f, y, sff, syy, sfy, w, begin, end, row, m, k, c)
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
            trial, tk, tc, tkk, tkc, tcc, qkk, qcc = _expand(f, y, sff, syy, sfy, w, begin, end, row, m, k + sk, c + sc)
            if trial <= cost:
                gain = cost - trial
                k, c, cost, gk, gc = k + sk, c + sc, trial, tk, tc
                hkk, hkc, hcc, pkk, pcc = tkk, tkc, tcc, qkk, qcc
                # Converged when a full step gains as much as the quadratic model predicts.
                if gain <= tolerance or (damp <= 1e-6 and abs(gain - expected) <= tolerance):
                    break
                damp *= 0.1
                if damp < 1e-9:
                    damp = 1e-9
                continue
        damp *= 10.0
        if damp < 1e-4:
            damp = 1e-4
        if damp > 1e12:
            break
    return k, c, cost, hkk, hkc, hcc


@called
def _profile(f, y, sff, syy, sfy, w, begin, end, row, m, k0, c0, k, c, step, slope, along_k):
    """Lowest cost with one coefficient held at the distance `step` from the minimum (k0, c0).

    The other coefficient starts from the cheapest of three points: where it was last (k, c), along the ridge, or at
    the minimum. Noise gives the profile side valleys, and a search that keeps to the last point could stay in one.
    """
    best, k1, c1 = inf, k0, c0
    for start in range(3):
        if along_k:
            k2, c2 = k0 + step, c if start == 0 else (c0 + slope * step if start == 1 else c0)
        else:
            k2, c2 = k if start == 0 else (k0 + slope * step if start == 1 else k0), c0 + step
        cost = _cost(f, y, sff, syy, sfy, w, begin, end, row, m, k2, c2)
        if cost < best:
            best, k1, c1 = cost, k2, c2
    k1, c1, best, _a, _b, _c = _minimise(
        f, y, sff, syy, sfy, w, begin, end, row, m, k1, c1, not along_k, along_k, _ROUGH
    )
    return k1, c1, best


@called
def _bound(f, y, sff, syy, sfy, w, begin, end, row, m, k0, c0, cost0, threshold, start, slope, along_k):
    """Coefficient at which the profile cost has risen by threshold; the search leaves the minimum in steps of `start`.

    Infinite, with the sign of `start`, if the cost never rises that far.
    """
    k, c = k0, c0
    inside, outside = 0.0, 0.0
    g_in, g_out = -1.0, 0.0
    step = start
    found = False
    for _ in range(_DOUBLINGS):
        k, c, cost = _profile(f, y, sff, syy, sfy, w, begin, end, row, m, k0, c0, k, c, step, slope, along_k)
        g = _beyond(cost - cost0, threshold)
        if g >= 0.0:
            outside, g_out, found = step, g, True
            break
        inside, g_in = step, g
        step *= 1.5
    if not found:
        return inf if start > 0 else -inf
    for _ in range(30):
        mid = inside - g_in * (outside - inside) / (g_out - g_in)
        if abs(outside - inside) < 1e-3 * abs(outside):
            break
        k, c, cost = _profile(f, y, sff, syy, sfy, w, begin, end, row, m, k0, c0, k, c, mid, slope, along_k)
        g = _beyond(cost - cost0, threshold)
        if abs(g) < 1e-3:
            break
        if g > 0:
            outside, g_out = mid, g
            g_in *= 0.5
        else:
            inside, g_in = mid, g
            g_out *= 0.5
    return (k0 if along_k else c0) + mid


@called
def _beyond(rise, threshold):
    """How far a rise of the cost is beyond the threshold, as a share of the distance at which it is reached."""
    return sqrt((0.0 if rise < 0.0 else rise) / threshold) - 1.0


@called
def _quadratic(a, b, re, im, sff, syy, sfy):
    """Variance of a s_F^2 + b s_Y^2 + re Re s_FY + im Im s_FY, times the degrees of freedom of the Wishart covariance.

    It equals tr(M C M C) with the Hermitian matrix M of the coefficients.
    """
    g = complex(re, im) * 0.5
    p, q = a * sff + g * sfy.conjugate(), a * sfy + g * syy
    u, v = g.conjugate() * sff + b * sfy.conjugate(), g.conjugate() * sfy + b * syy
    return (p * p + 2.0 * q * u + v * v).real


@called
def _sandwich(f, y, sff, syy, sfy, pf, py, pfy, w, begin, end, row, m, k, c, periods, hkk, hkc, hcc, out, o):
    """Standard errors that hold although the noise differs between the lines of the band.

    The pooled covariance weights the lines; the covariances of the single lines say how much noise entered. The pooled
    covariance is itself estimated, and where constant coefficients do not fit the band, other weights move the
    optimum; the delta method adds that variance.

    Writes into out from o on: [2:4] standard errors of k and c, [4:6] the ratio of their variances to the inverse half
    Hessian, [6:8] their degrees of freedom (Satterthwaite), [10] the cost that noise alone is expected to leave and
    [11] the numerator degrees of freedom of the cost.
    """
    count = float(end - begin)
    most = 2.0 * count * (periods - 1)
    # Values for an optimum that ran to infinity: k and c are unknown and no interval is bounded.
    for j in range(2):
        out[o + 2 + j], out[o + 4 + j], out[o + 6 + j] = inf, 1.0, most
    out[o + 10], out[o + 11] = count - 1.0, 2.0 * (count - 1.0)
    det = hkk * hcc - hkc * hkc
    if not (hkk > 0.0 and det > 0.0 and isfinite(hcc / det) and isfinite(hkk / det)):
        return
    ik, ix, ic = hcc / det, -hkc / det, hkk / det
    sum_k = sum_c = square_k = square_c = alike = alike_square = 0.0
    hats = by_hat = hat_square = cross = 0.0
    ka = kb = kr = ki = ca = cb = cr = ci = 0.0  # derivatives of the half gradient by s_F^2, s_Y^2, Re s_FY, Im s_FY
    for i in range(begin, end):
        wi = w[i - row]
        a, b = k - m * wi * wi, wi * c
        z = a * a + b * b
        v, s, cov, rest = _line(f[i], y[i], pf, py, pfy, a, b)
        own = sfy[i]
        ratio = (sff[i] + z * syy[i] - 2.0 * (a * own.real + b * own.imag)) / s
        signal = (rest.real * rest.real + rest.imag * rest.imag) / s
        kk, cc = (ik * ik + wi * wi * ix * ix) * signal * ratio, (ix * ix + wi * wi * ic * ic) * signal * ratio
        sum_k, square_k = sum_k + kk, square_k + kk * kk
        sum_c, square_c = sum_c + cc, square_c + cc * cc
        hat = (ik + wi * wi * ic) * signal
        hats, by_hat = hats + hat, by_hat + hat * ratio
        hat_square, cross = hat_square + (hat * ratio) * (hat * ratio), cross + hat * ratio * ratio
        alike, alike_square = alike + ratio, alike_square + ratio * ratio
        power = v.real * v.real + v.imag * v.imag
        turn = v.conjugate() * (rest - cov * v)
        tk, tc = turn.real / s, -wi * (turn.imag / s)
        ka, kb, kr, ki = ka + tk, kb + tk * z - a * power, kr + power - 2.0 * a * tk, ki - 2.0 * b * tk
        ca, cb = ca + tc, cb + tc * z - wi * b * power
        cr, ci = cr - 2.0 * a * tc, ci + wi * power - 2.0 * b * tc
    # The square of a sample variance exceeds the square of the true variance by the factor 1 + 1 / (periods - 1).
    thin = periods / (periods - 1.0)
    # Lines of unequal noise give a pooled covariance with fewer degrees of freedom.
    same = _smaller(thin * alike * alike / alike_square, count)
    of_k = _quadratic(ik * ka + ix * ca, ik * kb + ix * cb, ik * kr + ix * cr, ik * ki + ix * ci, pf, py, pfy)
    of_c = _quadratic(ix * ka + ic * ca, ix * kb + ic * cb, ix * kr + ic * cr, ix * ki + ic * ci, pf, py, pfy)
    sum_k += 2.0 * of_k / (same * (periods - 1))
    sum_c += 2.0 * of_c / (same * (periods - 1))
    out[o + 2], out[o + 3] = sqrt(0.5 * sum_k), sqrt(0.5 * sum_c)
    out[o + 4], out[o + 5] = sum_k / ik, sum_c / ic
    out[o + 6] = _smaller(2.0 * periods * sum_k * sum_k / square_k, most)
    out[o + 7] = _smaller(2.0 * periods * sum_c * sum_c / square_c, most)
    # The leverages are scaled to sum to one; those of the exact Hessian can be far from that in noise.
    sum_r = alike - by_hat / hats
    square_r = alike_square - 2.0 * cross / hats + hat_square / (hats * hats)
    out[o + 10] = sum_r
    out[o + 11] = _smaller(2.0 * thin * sum_r * sum_r / square_r, 2.0 * (count - 1.0))


@called
def _smaller(a, b):
    """The smaller of two numbers; a if that is nan."""
    return b if b < a else a


@called
def _band(f, y, sff, syy, sfy, w, begin, end, row, m, periods, out, o):
    """Estimate one band, and write what `estimate` returns into out from o on."""
    n = end - begin
    pf = py = power = 0.0
    pfy = 0j
    for i in range(begin, end):
        pf += sff[i]
        py += syy[i]
        pfy += sfy[i]
        size = abs(y[i])
        power += size * size
    pf, py, pfy = pf / n, py / n, complex(pfy.real / n, pfy.imag / n)
    # Two starting points: the moment estimator corrected for noise, and the dissertation's least squares.
    best = _INFINITE
    k = c = hkk = hkc = hcc = 0.0
    for start in range(2):
        noise = py if start == 0 else 0.0
        nk = dk = nc = dc = 0.0
        for i in range(begin, end):
            wi, size = w[i - row], abs(y[i])
            fy = f[i] * y[i].conjugate() - (pfy if start == 0 else 0j)
            p = size * size - noise
            nk += fy.real + m * (wi * wi) * p
            dk += p
            nc += wi * fy.imag
            dc += wi * wi * p
        if dk <= 0.0 or dc <= 0.0:
            continue
        k1, c1, cost, h1, h2, h3 = _minimise(
            f, y, pf, py, pfy, w, begin, end, row, m, nk / dk, nc / dc, True, True, _FINE
        )
        if cost < best:
            best, k, c, hkk, hkc, hcc = cost, k1, c1, h1, h2, h3
    out[o], out[o + 1], out[o + 8], out[o + 9] = k, c, best, _smaller(n * py / power, 1.0)
    _sandwich(f, y, sff, syy, sfy, pf, py, pfy, w, begin, end, row, m, k, c, periods, hkk, hkc, hcc, out, o)
    out[o + 12], out[o + 13] = -hkc / hcc, -hkc / hkk
    out[o + 14], out[o + 15], out[o + 16], out[o + 17], out[o + 18] = pf, py, pfy.real, pfy.imag, power


# A kernel calls the search by way of another part: directly, it would be compiled once more for each of them.
@cache
def _estimate() -> Callable[..., None]:
    sources = 0  # see `compiled`

    def estimate(force, disp, sff, syy, sfy, w, mass, slices, periods, out):
        if sources == 0:
            return
        bands = slices.size // 2
        for lane in range(mass.size):
            m, row = mass[lane], lane * w.size
            for band in range(bands):
                begin, end, o = row + slices[2 * band], row + slices[2 * band + 1], (lane * bands + band) * FOUND
                if isfinite(disp[begin].real):
                    _band(force, disp, sff, syy, sfy, w, begin, end, row, m, periods, out, o)

    return compiled(estimate, fast=False)


@cache
def _bounds() -> Callable[..., None]:
    sources = 0

    def bounds(force, disp, w, mass, slices, found, threshold, out):
        if sources == 0:
            return
        bands = slices.size // 2
        for lane in range(mass.size):
            m, row = mass[lane], lane * w.size
            for band in range(bands):
                begin, end = row + slices[2 * band], row + slices[2 * band + 1]
                at = lane * bands + band
                o = at * FOUND
                k, c, best = found[o], found[o + 1], found[o + 8]
                if not isfinite(k):
                    continue
                pf, py, pfy, power = found[o + 14], found[o + 15], complex(found[o + 16], found[o + 17]), found[o + 18]
                # Cost of an infinitely stiff or damped support, for which all measured displacement would be noise.
                far = power / py - best if py > 0.0 else inf
                for j in range(4):
                    of = j // 2
                    sign = -1.0 if j % 2 == 0 else 1.0
                    rise = threshold[2 * at + of]
                    if not isfinite(found[o + 2]) or far <= rise:
                        out[4 * at + j] = sign * inf
                    else:
                        start = sign * sqrt(2.0 * rise / found[o + 4 + of]) * found[o + 2 + of]
                        out[4 * at + j] = _bound(
                            force, disp, pf, py, pfy, w, begin, end, row, m, k, c, best, rise, start,
                            found[o + 12 + of], of == 0,
                        )  # fmt: skip

    return compiled(bounds, fast=False)


def estimate(
    force: np.ndarray, disp: np.ndarray, sff: np.ndarray, syy: np.ndarray, sfy: np.ndarray, w: np.ndarray,
    mass: np.ndarray, slices: np.ndarray, periods: int,
) -> np.ndarray:  # fmt: skip
    """Estimate every band of every lane.

    Args:
        force, disp: amplitudes (lanes, n).
        sff, syy, sfy: covariances of their noise (lanes, n).
        w: angular frequencies (n,), rad/s.
        mass: (lanes,), kg.
        slices: first line and the one behind the last of every band (bands, 2).
        periods: number of periods.

    Returns:
        (lanes, bands, FOUND): [0:2] k and c; [2:8] and [10:12] as `_sandwich`; [8] the cost; [9] the noise share;
        [12:14] the slopes dc/dk and dk/dc along the ridge of the cost; [14:18] the pooled covariance, of the force, of
        the displacement, and of both, real and imaginary; [18] the displacement's power. nan where the data are.
    """
    found = np.full((len(mass), len(slices), FOUND), np.nan)
    with _MAKING:
        kernel = _estimate()
    of_lines = (np.ascontiguousarray(a).reshape(-1) for a in (force, disp, sff, syy, sfy))
    kernel(*of_lines, w, mass, slices.reshape(-1), periods, found.reshape(-1))
    return found


def bounds(
    force: np.ndarray, disp: np.ndarray, w: np.ndarray, mass: np.ndarray, slices: np.ndarray, found: np.ndarray,
    threshold: np.ndarray,
) -> np.ndarray:  # fmt: skip
    """Profile-likelihood bounds (k low, k high, c low, c high) of every band of every lane, (lanes, bands, 4).

    Args:
        force, disp, w, mass, slices: as for `estimate`.
        found: what it returned.
        threshold: rise of the cost that defines a bound of k and of c, (lanes, bands, 2).
    """
    ends = np.full((len(mass), len(slices), 4), np.nan)
    with _MAKING:
        kernel = _bounds()
    flat = (np.ascontiguousarray(a).reshape(-1) for a in (force, disp))
    kernel(*flat, w, mass, slices.reshape(-1), found.reshape(-1), threshold.reshape(-1), ends.reshape(-1))
    return ends
