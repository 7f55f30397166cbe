"""Means over a band in which k and c are not constant: truth by quadrature of the curves that make the lines."""

import numpy as np
import pytest
import scipy

from estimation.band_mean import band_mean
from estimation.lines.periods import LineStatistics
from estimation.max_likelihood import maximum_likelihood

MASS, PERIODS, RECORDS = 0.08, 6, 300
LINES = np.arange(60, 76)
BAND = np.array([60.0, 75.0])


def stiffness(f):
    return 3e4 + 400.0 * (f - 60) - 9.0 * (f - 66) ** 2


def damping(f):
    return 12.0 + 0.3 * np.sin(f / 4)


def statistics(rng, noise, distortion=0.0):
    """Lines of one record whose periods differ by noise and whose displacement bears a distortion that repeats.

    The last line is a resonance far above the band, which holds most of the motion.
    """
    w = 2 * np.pi * LINES
    z = stiffness(LINES) - MASS * w**2 + 1j * w * damping(LINES)
    z = np.append(z, abs(z).min() / 20)
    normal = lambda *shape: (rng.standard_normal(shape) + 1j * rng.standard_normal(shape)) / np.sqrt(2)  # noqa: E731
    clean = (1 / z) * (1 + distortion * normal(z.size))
    scatter = np.array([1e-3, noise * abs(1 / z[:-1]).mean()])[None, :, None]
    periods = np.stack([np.ones(z.size) + 0 * clean, clean])[None] + scatter * normal(PERIODS, 2, z.size)
    mean = periods.mean(0)
    rest = periods - mean
    covariance = np.einsum("pan,pbn->abn", rest, rest.conj()) / (PERIODS - 1) / PERIODS
    lines = np.append(LINES, 140)
    return LineStatistics(lines.astype(float), lines, ("force", "displacement"), mean, covariance, PERIODS)


@pytest.mark.parametrize(("noise", "distortion"), [(0.003, 0.0), (0.05, 0.0), (0.003, 0.02)])
def test_the_interval_covers_the_mean_of_the_band_also_under_distortion(noise, distortion):
    rng = np.random.default_rng(3)
    fine = np.linspace(*BAND, 2001)
    truth = np.array([stiffness(fine).mean(), damping(fine).mean()])
    hits, constants = np.zeros(2), 0
    for _ in range(RECORDS):
        lines = statistics(rng, noise, distortion)
        constant = maximum_likelihood(lines, BAND[None], MASS)
        start = float(constant.stiffness[0]), float(constant.damping[0])
        found = band_mean(lines, BAND, MASS, start)
        hits += [m.low <= t <= m.high for m, t in zip(found, truth, strict=True)]
        constants += constant.stiffness_low[0] <= truth[0] <= constant.stiffness_high[0]
    tolerance = 3 * np.sqrt(0.95 * 0.05 / RECORDS)
    assert (abs(hits / RECORDS - 0.95) < tolerance).all()
    if noise < 0.01:
        assert constants / RECORDS < 0.85  # the interval of constants speaks of something else


def test_the_range_is_that_of_the_curve_inside_the_band():
    k, c = band_mean(statistics(np.random.default_rng(0), 1e-5), BAND, MASS, (3.3e4, 12.0))
    assert k.range == pytest.approx((stiffness(60.0), stiffness(75.0)), rel=2e-3)
    assert k.range[0] < k.value < k.range[1] and c.range[0] < c.value < c.range[1]
    whole = statistics(np.random.default_rng(0), 1e-5)
    few = whole.at_lines(whole.lines[:4])  # too few for more than constants
    assert band_mean(few, few.frequency[[0, -1]] + [-0.5, 0.5], MASS, (3.3e4, 12.0))[0].range is None


@pytest.mark.parametrize(("noise", "distortion"), [(0.05, 0.0), (1e-4, 0.05)])
def test_the_mean_is_where_an_independent_cost_is_least_and_its_error_is_the_curvature(noise, distortion):
    """The noise is that of the displacement, or of the force, beside which the distortion is weighted otherwise."""
    lines = statistics(np.random.default_rng(6), noise, distortion)
    k, c = band_mean(lines, BAND, MASS, (3.3e4, 12.0))
    f, w = lines.frequency[:-1], 2 * np.pi * lines.frequency[:-1]
    force, moved = lines.mean[:, :-1]
    u = (2 * f - BAND.sum()) / np.ptp(BAND)
    shape = np.stack([np.ones_like(u), u, (3 * u**2 - 1) / 2], axis=1)
    own = lines.covariance[..., :-1].mean(axis=-1)
    moves = 1 / abs(stiffness(f) - MASS * w**2 + 1j * w * damping(f)) ** 2  # what a force moves, of every line

    def left(p, extra):
        z = shape @ p[:3] - MASS * w**2 + 1j * w * (shape @ p[3:])
        row = np.stack([np.ones_like(z), -z])
        noise_of = np.real(np.einsum("an,ab,bn->n", row, own, row.conj())) + extra * moves * abs(z) ** 2
        e = (force - z * moved) / np.sqrt(noise_of / 2)
        return np.concatenate([e.real, e.imag])

    scale = np.array([1e4, 1e3, 1e3, 10.0, 1.0, 1.0])
    for extra in np.append(0.0, np.geomspace(1e-4, 0.1, 150) * np.mean(abs(force) ** 2)):
        found = scipy.optimize.least_squares(lambda q: left(q * scale, extra), [3.0, 0, 0, 1, 0, 0])  # noqa: B023
        ratio = 2 * found.cost / (2 * f.size - 6)
        if ratio < 1.0:  # the least distortion that explains what is left
            break
    se = np.sqrt(np.diag(np.linalg.inv(found.jac.T @ found.jac))) * scale
    assert (extra > 0) == (distortion > 0)
    exact = {"rel": 2e-4} if not extra else {"rel": 0.05}
    assert (k.se, c.se) == pytest.approx((se[0], se[3]), **exact)
    assert abs(k.value - found.x[0] * scale[0]) < (0.001 if not extra else 0.05) * k.se
    assert abs(c.value - found.x[3] * scale[3]) < (0.001 if not extra else 0.05) * c.se


def duffing(rng, lines, cubic, k=3e4, c=12.0, samples=1024):
    """Force and displacement at lines (1 Hz apart) of a spring that hardens, in its steady state: harmonic balance.

    cubic: stiffness that it adds at the rms of the linear motion, of k.
    """
    w = 2 * np.pi * np.arange(samples // 2 + 1)
    force = np.zeros(w.size, complex)
    force[lines] = np.exp(2j * np.pi * rng.random(lines.size))
    linear = 1 / (k - MASS * w**2 + 1j * w * c)
    moved = force * linear
    factor = cubic * k / (2 * np.sum(abs(moved) ** 2))
    for _ in range(100):
        y = np.fft.irfft(moved * samples, samples)
        moved, before = (moved + (force - np.fft.rfft(factor * y**3) / samples) * linear) / 2, moved
    assert np.abs(moved - before).max() < 1e-8 * np.abs(moved).max()
    return force[lines], moved[lines]


@pytest.mark.parametrize("driven", [(92, 105), (60, 140)])
def test_the_stiffness_of_a_band_that_holds_the_motion_is_less_certain_than_its_lines_show(driven):
    """A cubic spring moves the stiffness of all lines of the band together; without the factor .84 are covered."""
    rng, lines, band = np.random.default_rng(8), np.arange(driven[0], driven[1] + 1), np.array([92.0, 105.0])
    found = []
    for _ in range(120):
        values = np.stack(duffing(rng, lines, 0.03))
        silent = np.zeros((2, 2, lines.size))
        record = LineStatistics(lines.astype(float), lines, ("force", "displacement"), values, silent, PERIODS)
        found.append(band_mean(record, band, MASS, (3e4, 12.0)))
    for coefficient in zip(*found, strict=True):
        truth = np.mean([m.value for m in coefficient])
        assert np.mean([m.low <= truth <= m.high for m in coefficient]) > 0.92
    k = [m for m, _ in found]
    assert np.std([m.value for m in k]) > 0.6 * np.median([m.se for m in k])  # nor much wider than it has to be


def test_a_wide_band_across_a_resonance_is_weighted_as_the_force_scatters():
    """A force that is not recorded, of the same size at each line: as certain as the best linear estimate of them."""
    rng, lines, band, size, found = np.random.default_rng(10), np.arange(60, 141), np.array([60.0, 140.0]), 0.03, []
    w = 2 * np.pi * lines
    z = 3e4 - MASS * w**2 + 12.0j * w
    for _ in range(100):
        normal = (rng.standard_normal(lines.size) + 1j * rng.standard_normal(lines.size)) / np.sqrt(2)
        values = np.stack([np.ones(lines.size), (1 + size * normal) / z])
        silent = np.zeros((2, 2, lines.size))
        record = LineStatistics(lines.astype(float), lines, ("force", "displacement"), values, silent, PERIODS)
        found.append([m.value for m in band_mean(record, band, MASS, (3e4, 12.0))])
    u = (lines - 100.0) / 40.0
    shape = np.stack([np.ones_like(u), u, (3 * u**2 - 1) / 2], axis=1)
    columns = np.hstack([shape, 1j * w[:, None] * shape]) / z[:, None]
    best = np.sqrt(np.diag(np.linalg.inv((columns.conj().T @ columns).real)) * size**2 / 2)
    assert np.std(found, axis=0) == pytest.approx(best[[0, 3]], rel=0.2)
