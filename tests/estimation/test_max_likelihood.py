"""The band estimator against an optimiser and a delta method of its own, and its behaviour at the edges."""

from dataclasses import fields, replace

import numpy as np
import pytest
from drawn_spectra import draw, record
from likelihood_records import BAND, C, F, K, M, W, statistics
from scipy.optimize import brentq, minimize, minimize_scalar
from scipy.stats import t as student_t

from estimation.max_likelihood import lane, maximum_likelihood


def estimate(s, **options):
    return lane(maximum_likelihood(s, BAND, M, **options), ...)


@pytest.mark.parametrize("noise", [0.0, 1e-9])
@pytest.mark.parametrize("c", [C, 0.0, -5.0])
@pytest.mark.parametrize("k", [K, 0.0, -4000.0])
def test_exact_without_noise(k, c, noise):
    e = maximum_likelihood(statistics(noise, k, c), BAND, M)
    assert e.stiffness[0] == pytest.approx(k, abs=1e-6) and e.damping[0] == pytest.approx(c, abs=1e-8)
    assert e.stiffness_low[0] <= k <= e.stiffness_high[0] and e.informative[0]
    assert e.stiffness_high[0] - e.stiffness_low[0] < 1e-4
    assert e.noise_share[0] == pytest.approx(12 * noise**2 / np.sum(np.linspace(1, 2, 12) ** 2), abs=1e-30)


def pooled(s):
    pairs = (("force",) * 2, ("displacement",) * 2, ("force", "displacement"))
    return [s.cross(*pair).mean(axis=-1) for pair in pairs]


def cost(theta, f, y, covariance):
    """The errors-in-variables cost, written from its definition with the covariance as a matrix."""
    ff, yy, fy = covariance
    total = 0.0
    matrix = np.array([[ff, fy], [np.conj(fy), yy]])
    for fi, yi, w in zip(f, y, W, strict=True):
        row = np.array([1.0, -(theta[0] - M * w**2 + 1j * w * theta[1])])
        error = row @ np.array([fi, yi])
        total += abs(error) ** 2 / (row @ matrix @ np.conj(row)).real
    return total


def optimum(f, y, covariance, start):
    scale = np.array([100.0, 1.0])
    options = {"xatol": 1e-9, "fatol": 1e-13, "maxiter": 4000}
    r = minimize(lambda x: cost(x * scale, f, y, covariance), start / scale, method="Nelder-Mead", options=options)
    return r.x * scale, r.fun


@pytest.mark.parametrize("correlation", [0.0, 0.6 + 0.3j])
@pytest.mark.parametrize("noise", [0.003, 0.2, 0.6])
def test_agrees_with_an_independent_optimiser(noise, correlation):
    drawn = draw(statistics(noise, correlation=correlation), 4, seed=1)
    for i in range(4):
        s = record(drawn, i)
        found = maximum_likelihood(s, BAND, M)
        (k, c), least = optimum(s.amplitude("force"), s.amplitude("displacement"), pooled(s), np.array([K, C]))
        assert found.cost[0] == pytest.approx(least, rel=1e-7)
        assert abs(found.stiffness[0] - k) < 2e-3 * found.stiffness_se[0]
        assert abs(found.damping[0] - c) < 2e-3 * found.damping_se[0]


def influence(s, theta):
    """Change of the optimum per unit of the real and imaginary parts of F and Y, and of the pooled covariance."""
    f, y, covariance = s.amplitude("force"), s.amplitude("displacement"), pooled(s)

    def gradient(f, y, covariance):
        h = np.array([1e-2, 1e-5])
        e = np.eye(2) * h
        return [
            (cost(theta + e[j], f, y, covariance) - cost(theta - e[j], f, y, covariance)) / 2 / h[j] for j in (0, 1)
        ]

    h = np.array([1.0, 1e-3])

    def at(a, b):
        return cost(theta + np.array([a, b]) * h, f, y, covariance)

    mixed = (at(1, 1) - at(1, -1) - at(-1, 1) + at(-1, -1)) / 4
    curvature = np.array([[at(1, 0) - 2 * at(0, 0) + at(-1, 0), mixed], [mixed, at(0, 1) - 2 * at(0, 0) + at(0, -1)]])
    curvature /= np.outer(h, h)
    rows = []
    for i in range(F.size):
        for which, unit in ((f, np.sqrt(covariance[0])), (y, np.sqrt(covariance[1]))):
            for direction in (1, 1j):
                step = np.zeros(F.size, complex)
                step[i] = 0.01 * unit * direction
                plus = gradient(*((f + step, y) if which is f else (f, y + step)), covariance)
                minus = gradient(*((f - step, y) if which is f else (f, y - step)), covariance)
                rows.append((np.array(plus) - minus) / (0.02 * unit))
    weights = []
    for j, direction in ((0, 1), (1, 1), (2, 1), (2, 1j)):
        unit = 1e-3 * np.sqrt(covariance[0] * covariance[1]) if j == 2 else 1e-3 * covariance[j]
        plus, minus = list(covariance), list(covariance)
        plus[j] = plus[j] + unit * direction
        minus[j] = minus[j] - unit * direction
        weights.append((np.array(gradient(f, y, plus)) - gradient(f, y, minus)) / (2 * unit))
    inverse = np.linalg.inv(curvature)
    return -np.array(rows).reshape(F.size, 4, 2) @ inverse, -np.array(weights) @ inverse, inverse


def alike(s, theta):
    """How many lines of equal noise make a pooled covariance as good; F.size where the lines are equal."""
    row = np.array([np.ones(F.size), -(theta[0] - M * W**2 + 1j * W * theta[1])])
    order = [s.index("force"), s.index("displacement")]
    noise = np.einsum("in,ijn,jn->n", row, s.covariance[np.ix_(order, order)], np.conj(row)).real
    mean = s.covariance[np.ix_(order, order)].mean(axis=-1)
    share = noise / np.einsum("in,ij,jn->n", row, mean, np.conj(row)).real
    # A sample variance over P periods squares to P / (P - 1) of the true square in the mean.
    return min(s.periods / (s.periods - 1) * share.sum() ** 2 / (share**2).sum(), F.size)


def delta_method(s, theta):
    """Covariance of (k, c), what the information alone gives, and each line's share: all by numerical derivatives."""
    lines, weights, information = influence(s, theta)
    shares = []
    for i in range(F.size):
        ff, yy, fy = s.cross("force", "force")[i], s.cross("displacement", "displacement")[i], 0
        fy = s.cross("force", "displacement")[i]
        real = np.array([[ff, 0, fy.real, -fy.imag], [0, ff, fy.imag, fy.real],
                         [fy.real, fy.imag, yy, 0], [-fy.imag, fy.real, 0, yy]]) / 2  # fmt: skip
        shares.append(np.diag(lines[i].T @ real @ lines[i]))
    ff, yy, fy = pooled(s)
    # Complex Wishart: E[dC_ab dC_cd*] = C_ac C_bd* / freedom.
    g, product = abs(fy) ** 2, ff * yy
    wishart = np.array([
        [ff**2, g, ff * fy.real, ff * fy.imag],
        [g, yy**2, yy * fy.real, yy * fy.imag],
        [ff * fy.real, yy * fy.real, (product + (fy**2).real) / 2, (fy**2).imag / 2],
        [ff * fy.imag, yy * fy.imag, (fy**2).imag / 2, (product - (fy**2).real) / 2],
    ]) / (alike(s, theta) * (s.periods - 1))  # fmt: skip
    return np.array(shares), np.diag(weights.T @ wishart @ weights), np.diag(information)


# Noise that is small (its second order is not in either delta method), alike on all lines or not, with a band that
# constant coefficients fit, and one that they miss by many standard errors.
@pytest.mark.parametrize("correlation", [0.0, 0.5 - 0.4j])
@pytest.mark.parametrize(("tilt", "colour"), [(0.0, 0.0), (0.0, 1.5), (3.0, 0.0), (3.0, 1.5)])
def test_standard_errors_and_bounds_agree_with_a_numerical_delta_method(tilt, colour, correlation):
    s = record(draw(statistics(0.001, correlation=correlation, tilt=tilt, colour=colour), 1, seed=7), 0)
    found = maximum_likelihood(s, BAND, M)
    theta = np.array([found.stiffness[0], found.damping[0]])
    shares, scatter, information = delta_method(s, theta)
    variance = shares.sum(axis=0) + scatter
    assert found.stiffness_se[0] == pytest.approx(np.sqrt(variance[0]), rel=0.01)
    assert found.damping_se[0] == pytest.approx(np.sqrt(variance[1]), rel=0.01)
    assert (scatter / variance > 0.2).any() == (tilt > 0)

    freedom = np.minimum(2 * 5 * variance**2 / (shares**2).sum(axis=0), 2 * 12 * 4)
    threshold = student_t.ppf(0.975, freedom) ** 2 * variance / information / 2
    f, y, covariance = s.amplitude("force"), s.amplitude("displacement"), pooled(s)
    least = cost(theta, f, y, covariance)
    for free, se, low, high in (
        (0, found.stiffness_se, found.stiffness_low, found.stiffness_high),
        (1, found.damping_se, found.damping_low, found.damping_high),
    ):
        spread = np.array([found.stiffness_se[0], found.damping_se[0]])

        def rise(value, free=free, spread=spread):
            def at(x):
                point = theta + x * spread * 3
                point[free] = value
                return cost(point, f, y, covariance)

            return minimize_scalar(at, bracket=(-1, 1), tol=1e-12).fun - least - threshold[free]

        for sign, bound in ((-1, low[0]), (1, high[0])):
            expected = brentq(rise, theta[free], theta[free] + sign * 8 * se[0])
            assert abs(bound - expected) < 0.02 * se[0]


@pytest.mark.parametrize("correlation", [0.0, 0.5 - 0.4j])
def test_both_bounds_lie_where_the_profile_has_risen_as_far(correlation):
    """In this noise the profile is no parabola; its lowest point in the other coefficient is sought on fine grids."""
    drawn = draw(statistics(0.6, k=400.0, correlation=correlation), 6, seed=12)
    e = maximum_likelihood(drawn, BAND, M)
    assert e.informative.all()
    apart = []
    for i in range(6):
        s = record(drawn, i)
        f, y, (ff, yy, fy) = s.amplitude("force"), s.amplitude("displacement"), pooled(s)

        def costs(k, c, f=f, y=y, ff=ff, yy=yy, fy=fy):
            z = k[:, None] - M * W**2 + 1j * W * c[:, None]
            variance = ff.real + np.abs(z) ** 2 * yy.real - 2 * (np.conj(z) * fy).real
            return (np.abs(f - z * y) ** 2 / variance).sum(axis=-1)

        def risen(of, value, i=i, costs=costs):
            middle, width = (e.damping, e.damping_se) if of == 0 else (e.stiffness, e.stiffness_se)
            centre, reach = middle[i, 0], 12 * width[i, 0]
            for _ in range(8):
                grid = np.linspace(centre - reach, centre + reach, 401)
                held = np.full(grid.size, value)
                found = costs(*((held, grid) if of == 0 else (grid, held)))
                centre, reach = grid[found.argmin()], reach / 50
            return found.min() - e.cost[i, 0]

        for of, low, high in ((0, e.stiffness_low, e.stiffness_high), (1, e.damping_low, e.damping_high)):
            below, above = risen(of, low[i, 0]), risen(of, high[i, 0])
            # The bounds are sought to a thousandth of their distance: two of the rise.
            assert below == pytest.approx(above, rel=5e-3)
            middle = (e.stiffness, e.damping)[of][i, 0]
            apart.append(abs(np.log((high[i, 0] - middle) / (middle - low[i, 0]))))
    assert max(apart) > 0.05  # intervals that are not symmetric


def test_intervals_of_two_periods_have_a_degree_of_freedom_for_each_part_of_each_line():
    s = statistics(0.001, periods=2)
    e = maximum_likelihood(s, BAND, M)
    expected = student_t.ppf(0.975, 2 * F.size * (2 - 1))
    for se, low, high in (
        (e.stiffness_se, e.stiffness_low, e.stiffness_high),
        (e.damping_se, e.damping_low, e.damping_high),
    ):
        assert (high - low)[0] / 2 / se[0] == pytest.approx(expected, rel=3e-3)


# Near its minimum the profile is a parabola, and its width and the standard error are two readings of one Hessian.
@pytest.mark.parametrize("correlation", [0.0, 0.5 - 0.4j])
@pytest.mark.parametrize("noise", [0.001, 0.3, 0.9])
def test_standard_errors_are_those_of_the_profile_near_its_minimum(noise, correlation):
    drawn = draw(statistics(noise, correlation=correlation, periods=40), 200, seed=3)
    e = maximum_likelihood(drawn, BAND, M, level=0.2)
    quantile = student_t.ppf(0.6, 2 * F.size * 39)
    for se, low, high in (
        (e.stiffness_se, e.stiffness_low, e.stiffness_high),
        (e.damping_se, e.damping_low, e.damping_high),
    ):
        assert np.median((high - low) / 2 / se) == pytest.approx(quantile, rel=0.005)


def test_the_search_ends_at_a_minimum_in_noise():
    """Two fifths of |Y|^2 is noise that differs between lines: the cost has saddles, and slopes without an end."""
    s = draw(statistics(1.0, colour=1.2), 4000, seed=9)
    e = maximum_likelihood(s, BAND, M)
    ff, yy, fy = (v[:, None] for v in pooled(s))

    def cost_at(k, c):
        z = k - M * W**2 + 1j * W * c
        error = np.abs(s.amplitude("force") - z * s.amplitude("displacement")) ** 2
        return (error / (ff.real + np.abs(z) ** 2 * yy.real - 2 * (np.conj(z) * fy).real)).sum(axis=-1)

    ok = e.informative[:, 0]
    assert ok.mean() > 0.9
    assert cost_at(e.stiffness, e.damping)[ok] == pytest.approx(e.cost[ok, 0], rel=1e-9)
    for angle in np.arange(16) * np.pi / 8:
        for step in (0.03, 0.1, 0.3):
            dk, dc = step * np.cos(angle) * e.stiffness_se, step * np.sin(angle) * e.damping_se
            with np.errstate(invalid="ignore"):  # no standard error where the optimum ran to infinity
                assert (cost_at(e.stiffness + dk, e.damping + dc) - e.cost[:, 0])[ok].min() > 0


def test_correlated_noise_is_used():
    s = draw(statistics(0.5, correlation=0.8), 500, seed=2)  # noise that moves force and displacement together
    ignored = replace(s, covariance=s.covariance * np.eye(2)[:, :, None])
    with_it, without = maximum_likelihood(s, BAND, M), maximum_likelihood(ignored, BAND, M)
    error = with_it.stiffness.mean() - K
    assert abs(error) < 4 * with_it.stiffness.std() / np.sqrt(500)
    assert abs(without.stiffness.mean() - K) > 8 * without.stiffness.std() / np.sqrt(500)


def test_a_batch_is_its_lanes_one_by_one():
    s = draw(statistics(0.3), 20, seed=3)  # more than a block
    bands, mass = np.array([[20.0, 25.0], [24.0, 31.0], [20.0, 31.0]]), np.linspace(0.1, 0.2, 20)
    batch = maximum_likelihood(s, bands, mass)
    assert batch.stiffness.shape == (20, 3)
    for i in range(20):
        single = maximum_likelihood(record(s, i), bands, mass[i])
        for f in fields(single):
            assert np.array_equal(getattr(single, f.name), getattr(lane(batch, i), f.name)), f.name
    nested = replace(s, mean=s.mean.reshape(4, 5, 2, 12), covariance=s.covariance.reshape(4, 5, 2, 2, 12))
    again = maximum_likelihood(nested, bands, mass.reshape(4, 5))
    assert np.array_equal(again.damping_high.reshape(20, 3), batch.damping_high)


def test_a_lane_of_nan_gives_nan_and_leaves_its_neighbours_alone():
    s = draw(statistics(0.3), 3, seed=4)
    broken = replace(s, mean=s.mean.copy(), covariance=s.covariance.copy())
    broken.mean[1], broken.covariance[1] = np.nan, np.nan
    a, b = maximum_likelihood(s, BAND, M), maximum_likelihood(broken, BAND, M)
    for f in fields(a):
        value = getattr(b, f.name)
        assert np.array_equal(value[[0, 2]], getattr(a, f.name)[[0, 2]])
        assert value[1, 0] == False if f.name == "informative" else np.isnan(value[1, 0])  # noqa: E712


def test_without_intervals_the_rest_is_the_same():
    s = draw(statistics(0.3), 5, seed=5)
    full, quick = maximum_likelihood(s, BAND, M), maximum_likelihood(s, BAND, M, intervals=False)
    for name in ("stiffness", "damping", "stiffness_se", "damping_se", "cost", "fit_p", "noise_share"):
        assert np.array_equal(getattr(full, name), getattr(quick, name))
    assert np.isnan(quick.stiffness_low).all() and not quick.informative.any()


def test_a_higher_level_has_wider_intervals():
    s = draw(statistics(0.1), 20, seed=6)
    narrow, wide = maximum_likelihood(s, BAND, M, level=0.8), maximum_likelihood(s, BAND, M, level=0.99)
    ratio = (wide.stiffness_high - wide.stiffness_low) / (narrow.stiffness_high - narrow.stiffness_low)
    assert np.all(ratio > 1.9) and ratio.mean() == pytest.approx(2.576 / 1.282, rel=0.1)


def test_displacement_that_is_all_noise_is_uninformative():
    s = statistics(0.3)
    silent = replace(s, mean=s.mean * np.array([[1e-6], [1.0]]))
    e = maximum_likelihood(draw(silent, 400, seed=8), BAND, M)
    # Noise alone finds a direction in (k, c) that an infinite stiffness explains worse: chi-square of 2 above 3.84.
    assert 0.8 < np.mean(~e.informative) < 0.95
    assert np.all(e.stiffness_low <= e.stiffness) and np.all(e.stiffness <= e.stiffness_high)
    assert np.all(np.isfinite(e.fit_p))


@pytest.mark.parametrize("mass", [0.0, -1.0, np.nan])
def test_mass_must_be_positive(mass):
    with pytest.raises(ValueError, match="must be positive"):
        maximum_likelihood(statistics(0.1), BAND, mass)


def test_estimates_do_not_depend_on_the_units():
    """A force in MN and a mass in Gg: bounds are sought to a share of their distance, whatever their size."""
    s, unit = draw(statistics(0.6, k=400.0), 6, seed=12), 1e-6
    force = np.array([unit if name == "force" else 1.0 for name in s.channels])
    tiny = replace(s, mean=s.mean * force[:, None], covariance=s.covariance * np.outer(force, force)[:, :, None])
    e, small = maximum_likelihood(s, BAND, M), maximum_likelihood(tiny, BAND, M * unit)
    for f in fields(e):
        factor = unit if f.name.startswith(("stiffness", "damping")) else 1.0
        assert getattr(small, f.name) == pytest.approx(getattr(e, f.name) * factor, rel=1e-6), f.name
