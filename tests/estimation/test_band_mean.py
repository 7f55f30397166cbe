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
    """Lines of one record whose periods differ by noise and whose displacement bears a distortion that repeats."""
    w = 2 * np.pi * LINES
    z = stiffness(LINES) - MASS * w**2 + 1j * w * damping(LINES)
    normal = lambda *shape: (rng.standard_normal(shape) + 1j * rng.standard_normal(shape)) / np.sqrt(2)  # noqa: E731
    clean = (1 / z) * (1 + distortion * normal(LINES.size))
    periods = np.stack([np.ones(LINES.size) + 0 * clean, clean])[None] + np.array([1e-3, noise * abs(1 / z).mean()])[
        None, :, None
    ] * normal(PERIODS, 2, LINES.size)
    mean = periods.mean(0)
    rest = periods - mean
    covariance = np.einsum("pan,pbn->abn", rest, rest.conj()) / (PERIODS - 1) / PERIODS
    return LineStatistics(LINES.astype(float), LINES, ("force", "displacement"), mean, covariance, PERIODS)


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


@pytest.mark.parametrize(("noise", "distortion"), [(0.05, 0.0), (1e-4, 0.05)])
def test_the_mean_is_where_an_independent_cost_is_least_and_its_error_is_the_curvature(noise, distortion):
    """The noise is that of the displacement, or of the force, beside which the distortion is weighted otherwise."""
    lines = statistics(np.random.default_rng(6), noise, distortion)
    k, c = band_mean(lines, BAND, MASS, (3.3e4, 12.0))
    f, w = lines.frequency, 2 * np.pi * lines.frequency
    force, moved = lines.mean
    u = (2 * f - BAND.sum()) / np.ptp(BAND)
    shape = np.stack([np.ones_like(u), u, (3 * u**2 - 1) / 2], axis=1)
    own = lines.covariance.mean(axis=-1)

    def left(p, extra):
        z = shape @ p[:3] - MASS * w**2 + 1j * w * (shape @ p[3:])
        row = np.stack([np.ones_like(z), -z])
        at = own + np.diag([0.0, extra])
        e = (force - z * moved) / np.sqrt(np.real(np.einsum("an,ab,bn->n", row, at, row.conj())) / 2)
        return np.concatenate([e.real, e.imag])

    scale = np.array([1e4, 1e3, 1e3, 10.0, 1.0, 1.0])
    for extra in np.append(0.0, np.geomspace(1e-4, 0.1, 150) * np.mean(abs(moved) ** 2)):
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
