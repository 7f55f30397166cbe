"""Errors-in-variables maximum likelihood of stiffness and damping per band, with profile-likelihood intervals.

Unlike least squares on the receptance it stays unbiased when the displacement is noisy (Pintelon and Schoukens 2012,
ch. 9; the dissertation's eq 4.13-4.19 is the estimator it replaces).
"""

from dataclasses import dataclass, fields

import numba as nb
import numpy as np
from scipy import stats

from estimation.bands import band_slices
from estimation.periods import LineStatistics

# Changes of the cost (a threshold is about 2) that no longer matter: for the estimate, and on the way to a bound.
_FINE, _ROUGH = 1e-8, 1e-4
_ITERATIONS = 60
_DOUBLINGS = 40
_INFINITE = 1e300


@dataclass(frozen=True)
class BandEstimate:
    """Per lane and band, arrays (..., bands), SI.

    stiffness, damping with standard errors; *_low, *_high 95 % profile-likelihood bounds, -inf or inf where the data
    do not bound them; cost at the minimum; fit_p: p-value that constant coefficients explain the band; informative:
    both intervals are bounded; noise_share: share of the measured |Y|^2 that is noise.
    """

    stiffness: np.ndarray
    damping: np.ndarray
    stiffness_se: np.ndarray
    damping_se: np.ndarray
    stiffness_low: np.ndarray
    stiffness_high: np.ndarray
    damping_low: np.ndarray
    damping_high: np.ndarray
    cost: np.ndarray
    fit_p: np.ndarray
    informative: np.ndarray
    noise_share: np.ndarray


def maximum_likelihood(
    statistics: LineStatistics,
    bands: np.ndarray,
    mass: float | np.ndarray,
    intervals: bool = True,
    level: float = 0.95,
) -> BandEstimate:
    """Minimise sum |F - Z Y|^2 / (s_F^2 + |Z|^2 s_Y^2 - 2 Re(conj(Z) s_FY)), Z = k - m w^2 + j w c, in each band.

    statistics: channels "force" and "displacement" at the force lines (see `LineStatistics.at_lines`); bands (b, 2)
    Hz; mass kg, scalar or one per lane. Covariances are pooled over the band, so that their own scatter over few
    periods is small and known: the interval threshold and the fit test use F quantiles with 2 n (P - 1) degrees of
    freedom. Lanes with nan give nan. intervals=False leaves the bounds nan (cheaper).
    ValueError when mass is not positive.
    """
    mass = np.asarray(mass, dtype=float)
    if not np.all(mass > 0):
        raise ValueError(f"mass = {mass} kg must be positive; pass the moving mass or estimate it")
    force, displacement = statistics.amplitude("force"), statistics.amplitude("displacement")
    shape = force.shape[:-1]
    n = force.shape[-1]
    flat = [
        np.ascontiguousarray(a.reshape(-1, n))
        for a in (
            force,
            displacement,
            statistics.cross("force", "force"),
            statistics.cross("displacement", "displacement"),
            statistics.cross("force", "displacement"),
        )
    ]
    slices = band_slices(statistics.frequency, bands)
    count = slices[:, 1] - slices[:, 0]
    freedom = 2 * count * (statistics.periods - 1)
    threshold = stats.f.ppf(level, 1, freedom) / 2
    masses = np.ascontiguousarray(np.broadcast_to(mass, shape).reshape(-1))
    out = np.full((len(masses), len(bands), 10), np.nan)
    _estimate(*flat, 2 * np.pi * statistics.frequency, masses, slices, threshold, intervals, out)
    out = out.reshape(*shape, len(bands), 10)
    k, c, k_se, c_se, k_lo, k_hi, c_lo, c_hi, cost, share = np.moveaxis(out, -1, 0)
    fit_p = stats.f.sf(cost / (count - 1), 2 * (count - 1), freedom)
    bounded = np.isfinite(k_lo) & np.isfinite(k_hi) & np.isfinite(c_lo) & np.isfinite(c_hi)
    return BandEstimate(k, c, k_se, c_se, k_lo, k_hi, c_lo, c_hi, cost, fit_p, bounded, share)


def lane(estimate: BandEstimate, index: int) -> BandEstimate:
    """One lane of a batched estimate."""
    return BandEstimate(**{f.name: getattr(estimate, f.name)[index] for f in fields(estimate)})


def least_squares_bias(
    statistics: LineStatistics, bands: np.ndarray, mass: float | np.ndarray, estimate: BandEstimate
) -> tuple[np.ndarray, np.ndarray]:
    """Bias that displacement noise gives D's least squares, stiffness N/m and damping N s/m, (..., bands).

    The estimate tends to rho k + (1 - rho) m w^2 and rho c, rho the signal's share of |G|^2.
    """
    w = 2 * np.pi * statistics.frequency
    force = np.abs(statistics.amplitude("force")) ** 2
    measured = np.abs(statistics.amplitude("displacement")) ** 2 / force
    noise = statistics.cross("displacement", "displacement") / force
    stiffness, damping = np.full(estimate.stiffness.shape, np.nan), np.full(estimate.damping.shape, np.nan)
    for b, (start, stop) in enumerate(band_slices(statistics.frequency, bands)):
        total, part = measured[..., start:stop].sum(-1), noise[..., start:stop].sum(-1)
        pull = (noise * w**2)[..., start:stop].sum(-1) * mass
        stiffness[..., b] = (pull - part * estimate.stiffness[..., b]) / total
        turn = (noise * w**2)[..., start:stop].sum(-1) / (measured * w**2)[..., start:stop].sum(-1)
        damping[..., b] = -turn * estimate.damping[..., b]
    return stiffness, damping


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
def _bound(f, y, sff, syy, sfy, w, m, k0, c0, cost0, threshold, start, slope, along_k):
    """Where the profile cost rises by threshold, walking from the minimum by `start`; infinite if it never does."""
    k, c = k0, c0
    inside, outside = 0.0, 0.0
    g_in, g_out = -1.0, 0.0
    step = start
    found = False
    for _ in range(_DOUBLINGS):
        if along_k:
            k, c, cost, _a, _b, _c = _minimise(
                f, y, sff, syy, sfy, w, m, k0 + step, c + slope * (step - inside), False, True, _ROUGH
            )
        else:
            k, c, cost, _a, _b, _c = _minimise(
                f, y, sff, syy, sfy, w, m, k + slope * (step - inside), c0 + step, True, False, _ROUGH
            )
        g = np.sqrt(max(cost - cost0, 0.0) / threshold) - 1.0
        if g >= 0.0:
            outside, g_out, found = step, g, True
            break
        inside, g_in = step, g
        step *= 1.5
    if not found:
        return _INFINITE if start > 0 else -_INFINITE
    for _ in range(30):
        mid = inside - g_in * (outside - inside) / (g_out - g_in)
        if abs(outside - inside) < 1e-3 * abs(outside):
            break
        if along_k:
            k, c, cost, _a, _b, _c = _minimise(f, y, sff, syy, sfy, w, m, k0 + mid, c, False, True, _ROUGH)
        else:
            k, c, cost, _a, _b, _c = _minimise(f, y, sff, syy, sfy, w, m, k, c0 + mid, True, False, _ROUGH)
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


@nb.njit(cache=True, nogil=True, error_model="numpy")
def _estimate(force, disp, sff, syy, sfy, w, mass, slices, threshold, intervals, out):
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
            det = hkk * hcc - hkc * hkc
            o[0], o[1] = k, c
            o[2], o[3] = np.sqrt(0.5 * hcc / det), np.sqrt(0.5 * hkk / det)
            o[8], o[9] = best, min(n * py / power, 1.0)
            if not intervals:
                continue
            q = threshold[band]
            # Cost of an infinitely stiff or damped support: all displacement is noise.
            if py <= 0.0 or power / py - best > q:
                wide_k, wide_c = np.sqrt(2.0 * q) * o[2], np.sqrt(2.0 * q) * o[3]
                sk, sc = -hkc / hcc, -hkc / hkk
                o[4] = _bound(f, y, pf, py, pfy, wb, m, k, c, best, q, -wide_k, sk, True)
                o[5] = _bound(f, y, pf, py, pfy, wb, m, k, c, best, q, wide_k, sk, True)
                o[6] = _bound(f, y, pf, py, pfy, wb, m, k, c, best, q, -wide_c, sc, False)
                o[7] = _bound(f, y, pf, py, pfy, wb, m, k, c, best, q, wide_c, sc, False)
            else:
                o[4], o[5], o[6], o[7] = -_INFINITE, _INFINITE, -_INFINITE, _INFINITE
            for j in range(4, 8):
                if abs(o[j]) >= _INFINITE:
                    o[j] = np.inf * np.sign(o[j])
