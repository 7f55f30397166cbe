"""The two-axis estimator against optimisers and derivatives of its own, and what it refuses."""

from dataclasses import fields, replace

import numpy as np
import pytest
from drawn_spectra import draw, record
from planar_records import (
    BAND,
    DAMPING,
    DIAGONALS,
    MASS,
    STIFFNESS,
    SYMMETRIC,
    VERTICAL,
    F,
    correlated,
    diagonal_records,
    noise_levels,
    planar_record,
)
from scipy.optimize import brentq, minimize
from scipy.stats import t as student_t

from estimation.max_likelihood import maximum_likelihood
from estimation.xy.planar import axis_statistics, eight_coefficients, row_sums
from estimation.xy.planar_least_squares import planar_least_squares
from estimation.xy.planar_lines import CHANNELS


def matrices(estimate):
    return np.concatenate([estimate.stiffness.reshape(-1), estimate.damping.reshape(-1)])


def errors(estimate):
    return np.concatenate([estimate.stiffness_se.reshape(-1), estimate.damping_se.reshape(-1)])


@pytest.mark.parametrize("centre", [30.0, 70.0, 150.0, 240.0])
@pytest.mark.parametrize("noise", [0.0, 1e-10])
def test_exact_without_noise(centre, noise):
    f = centre + np.arange(-7.0, 8.0)
    mass = (0.92, 0.85)
    scale = noise_levels(f, 1 / noise) if noise else (0.0, 0.0)
    s = [planar_record(f, d, scale, mass=mass) for d in DIAGONALS]
    e = eight_coefficients(s, np.array([[centre - 7.5, centre + 7.5]]), mass)
    assert np.abs(e.stiffness[0] - STIFFNESS).max() < 1e-9 * np.abs(STIFFNESS).max()
    assert np.abs(e.damping[0] - DAMPING).max() < 1e-9 * np.abs(DAMPING).max()
    assert np.all((e.stiffness_low[0] <= STIFFNESS) & (e.stiffness_high[0] >= STIFFNESS))
    assert e.informative[0] and e.identifiable[0] and e.condition[0] < 2
    assert (e.stiffness_high - e.stiffness_low).max() < 1.0


def test_one_record_whose_lines_drive_different_axes_is_enough():
    s = planar_record(F, np.where(np.arange(F.size)[:, None] % 2, [[1.0, 0.0]], [[0.0, 1.0]]))
    e = eight_coefficients([s], BAND, MASS)
    assert matrices(e) == pytest.approx(np.concatenate([STIFFNESS.ravel(), DAMPING.ravel()]), rel=1e-9)


def test_records_may_differ_in_lines_periods_and_channels():
    a, b = planar_record(F, VERTICAL), planar_record(F[1::3] + 0.5, [1.0, 0.2], periods=9)
    order = [3, 0, 2, 1]
    b = replace(
        b,
        channels=(*(CHANNELS[i] for i in order), "current_x"),
        mean=np.concatenate([b.mean[order], np.full((1, b.frequency.size), np.nan)]),
        covariance=np.pad(b.covariance[np.ix_(order, order)], ((0, 1), (0, 1), (0, 0)), constant_values=np.nan),
    )
    elsewhere = planar_record(np.arange(200.0, 210.0), VERTICAL)
    e = eight_coefficients([elsewhere, a, b], BAND, MASS)
    assert matrices(e) == pytest.approx(np.concatenate([STIFFNESS.ravel(), DAMPING.ravel()]), rel=1e-8)


def line_costs(theta, u, covariances):
    """Cost of each line of one record, from its definition; u (n, 4)."""
    w = 2 * np.pi * F[:, None, None]
    k, c = theta.reshape(2, 2, 2)
    a = np.concatenate(
        [np.broadcast_to(np.eye(2), (F.size, 2, 2)), -(k - MASS * w**2 * np.eye(2) + 1j * w * c)], axis=2
    )
    e = (a @ u[..., None])[..., 0]
    s = a @ covariances @ np.conj(np.swapaxes(a, 1, 2))
    return np.real(np.conj(e) * np.linalg.solve(s, e[..., None])[..., 0]).sum(axis=1)


def pooled(s):
    return s.covariance.mean(axis=-1)


def cost(theta, records):
    return sum(line_costs(theta, s.mean.T, pooled(s)).sum() for s in records)


def profile(records, start, scale, held=None, value=None):
    """Lowest cost with one coefficient held, by BFGS; the point and the cost."""
    free = np.arange(8) != held

    def at(x):
        theta = start.copy()
        theta[free] += x * scale[free]
        if held is not None:
            theta[held] = value
        return theta

    r = minimize(lambda x: cost(at(x), records), np.zeros(free.sum()), method="BFGS", options={"gtol": 1e-5})
    return at(r.x), r.fun


@pytest.mark.parametrize("correlation", [None, correlated(1)])
@pytest.mark.parametrize("ratio", [300, 10, 2])
def test_agrees_with_an_independent_optimiser(ratio, correlation):
    drawn = diagonal_records(ratio, 3, seed=1, correlation=correlation)
    for i in range(3):
        s = [record(d, i) for d in drawn]
        found = eight_coefficients(s, BAND, MASS)
        theta, least = profile(s, np.concatenate([STIFFNESS.ravel(), DAMPING.ravel()]), errors(found))
        assert found.cost[0] == pytest.approx(least, rel=1e-7)
        assert np.all(np.abs(matrices(found) - theta) < 2e-3 * errors(found))


def delta_method(records, theta, scale):
    """Per coefficient: lines' shares of the variance, the weights' share, and the inverse Hessian's diagonal.

    All by central differences of the cost: of its gradient by the channels of each line and by the pooled covariance.
    """
    h = 0.02 * np.diag(scale)

    def gradient(s, u, covariances):
        return np.array([line_costs(theta + d, u, covariances) - line_costs(theta - d, u, covariances) for d in h]) / (
            0.04 * scale[:, None]
        )

    hessian = np.array([
        [cost(theta + a + b, records) - cost(theta + a - b, records) - cost(theta - a + b, records)
         + cost(theta - a - b, records) for b in h] for a in h
    ]) / 0.0016 / np.outer(scale, scale)  # fmt: skip
    inverse = np.linalg.inv(hessian)
    shares, weights = [], 0.0
    for s in records:
        u, noise, n = s.mean.T, pooled(s), F.size
        sd = np.sqrt(np.diag(noise).real)
        steps = []
        for channel in range(4):
            for unit in (1, 1j):
                du = np.zeros(4, complex)
                du[channel] = 0.02 * sd[channel] * unit
                steps.append((gradient(s, u + du, noise) - gradient(s, u - du, noise)) / 0.04 / sd[channel])
        by_channel = -np.einsum("ij,cjn->nci", inverse, np.array(steps))  # (n, 8, 8)
        for i in range(n):
            own = s.covariance[..., i]
            real = np.kron(own.real, np.eye(2)) + np.kron(own.imag, np.array([[0, -1], [1, 0]]))
            shares.append(np.diag(by_channel[i].T @ (real / 2) @ by_channel[i]))
        # A Hermitian matrix of freedom n (P - 1): the change by each of its 16 parts, and their covariance.
        basis = []
        for a in range(4):
            for b in range(a + 1):
                for unit in (1, 1j) if a != b else (1,):
                    e = np.zeros((4, 4), complex)
                    e[a, b] += unit
                    e[b, a] += np.conj(unit)
                    basis.append(e * np.outer(sd, sd))
        moved = [(gradient(s, u, noise + 1e-3 * e) - gradient(s, u, noise - 1e-3 * e)).sum(1) / 2e-3 for e in basis]
        # Coordinates x of dN = sum x e from tr(dN dual): cov(tr(dN A), tr(dN B)) = tr(A N B N) / freedom.
        gram = np.array([[np.trace(p @ q).real for q in basis] for p in basis])
        spread = np.array([[np.trace(p @ noise @ q @ noise).real for q in basis] for p in basis])
        coordinates = np.linalg.solve(gram, np.linalg.solve(gram, spread).T) / (n * (s.periods - 1))
        change = -np.array(moved) @ inverse
        weights = weights + np.diag(change.T @ coordinates @ change)
    return np.array(shares), weights, np.diag(inverse)


# Noise that is small (its second order is in neither), in a band that constant coefficients fit and one they miss.
@pytest.mark.parametrize(("tilt", "j"), [(0.0, 4), (0.02, 1)])
def test_standard_errors_and_bounds_agree_with_a_numerical_delta_method(tilt, j):
    drawn = diagonal_records(1000, 1, seed=2, correlation=correlated(2), tilt=tilt)
    s = [record(d, 0) for d in drawn]
    found = eight_coefficients(s, BAND, MASS)
    theta, se = matrices(found), errors(found)
    shares, weights, information = delta_method(s, theta, se)
    variance = shares.sum(axis=0) + weights
    assert se == pytest.approx(np.sqrt(variance), rel=0.01)
    assert (weights / variance > 0.1).any() == (tilt > 0)
    freedom = np.minimum(2 * 5 * variance**2 / (shares**2).sum(axis=0), 2 * 2 * F.size * 4)
    threshold = student_t.ppf(0.975, freedom) ** 2 * variance / information / 2
    least = cost(theta, s)
    low = np.concatenate([found.stiffness_low.ravel(), found.damping_low.ravel()])
    high = np.concatenate([found.stiffness_high.ravel(), found.damping_high.ravel()])

    def rise(value):
        return profile(s, theta, se, j, value)[1] - least - threshold[j]

    for sign, bound in ((-1, low[j]), (1, high[j])):
        expected = brentq(rise, theta[j], theta[j] + 5 * sign * se[j], xtol=5e-3 * se[j])
        assert abs(bound - expected) < 0.02 * se[j]


def test_turning_the_axes_turns_the_matrices():
    angle = 0.4
    turn = np.array([[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]])
    both = np.kron(np.eye(2), turn)
    s = diagonal_records(3, 5, seed=3, correlation=correlated(3))
    turned = [
        replace(r, mean=both @ r.mean, covariance=np.einsum("ab,lbcn,dc->ladn", both, r.covariance, both)) for r in s
    ]
    a, b = eight_coefficients(s, BAND, MASS), eight_coefficients(turned, BAND, MASS)
    assert b.stiffness == pytest.approx(turn @ a.stiffness @ turn.T, abs=1e-3 * a.stiffness_se.min())
    assert b.damping == pytest.approx(turn @ a.damping @ turn.T, abs=1e-3 * a.damping_se.min())
    assert b.cost == pytest.approx(a.cost, rel=1e-8) and b.fit_p == pytest.approx(a.fit_p, rel=1e-6)


def test_a_batch_is_its_lanes_one_by_one():
    s = diagonal_records(10, 6, seed=4)
    bands, mass = np.array([[63.0, 70.0], [66.0, 77.0], [63.0, 77.0]]), np.linspace(0.8, 1.0, 6)
    batch = eight_coefficients(s, bands, (mass, mass + 0.05))
    assert batch.stiffness.shape == (6, 3, 2, 2) and batch.fit_p.shape == (6, 3)
    for i in range(6):
        single = eight_coefficients([record(r, i) for r in s], bands, (mass[i], mass[i] + 0.05))
        for f in fields(single):
            a, b = getattr(single, f.name), getattr(batch, f.name)[i]
            assert a == pytest.approx(b, rel=1e-6, abs=1e-9), f.name
    nested = [replace(r, mean=r.mean.reshape(2, 3, 4, -1), covariance=r.covariance.reshape(2, 3, 4, 4, -1)) for r in s]
    again = eight_coefficients(nested, bands, (mass.reshape(2, 3), mass.reshape(2, 3) + 0.05))
    assert np.array_equal(again.damping_high.reshape(6, 3, 2, 2), batch.damping_high)


def test_a_lane_of_nan_gives_nan_and_leaves_its_neighbours_alone():
    s = diagonal_records(10, 3, seed=5)
    broken = [s[0], replace(s[1], mean=s[1].mean.copy())]
    broken[1].mean[1] = np.nan
    for estimator in (eight_coefficients, planar_least_squares):
        a, b = estimator(s, BAND, MASS), estimator(broken, BAND, MASS)
        for f in fields(a):
            value = getattr(b, f.name)
            assert np.array_equal(value[[0, 2]], getattr(a, f.name)[[0, 2]])
            assert not value[1].any() if value.dtype == bool else np.isnan(value[1]).all(), f.name


def test_without_intervals_the_rest_is_the_same():
    s = diagonal_records(10, 4, seed=6)
    full, quick = eight_coefficients(s, BAND, MASS), eight_coefficients(s, BAND, MASS, intervals=False)
    for f in fields(full):
        if not f.name.endswith(("_low", "_high")) and f.name != "informative":
            assert np.array_equal(getattr(full, f.name), getattr(quick, f.name))
    assert np.isnan(quick.damping_low).all() and not quick.informative.any()


def test_a_higher_level_has_wider_intervals_until_they_have_no_bound():
    s = diagonal_records(6, 20, seed=7, frequency=F[:4], periods=2)
    narrow, wide = eight_coefficients(s, BAND, MASS, level=0.8), eight_coefficients(s, BAND, MASS, level=0.99)
    ratio = (wide.stiffness_high - wide.stiffness_low) / (narrow.stiffness_high - narrow.stiffness_low)
    assert narrow.informative.all() and np.all(ratio > 1.9)
    # Taking the displacement for noise, with coefficients as large as one likes, costs little enough at some level.
    unbounded = eight_coefficients(s, BAND, MASS, level=1 - 1e-9)
    assert wide.informative.all() and 0.2 < unbounded.informative.mean() < 0.9
    assert np.array_equal(unbounded.informative, np.isfinite(unbounded.stiffness_high - unbounded.stiffness_low).all(
        (2, 3)) & np.isfinite(unbounded.damping_high - unbounded.damping_low).all((2, 3)))  # fmt: skip
    assert not eight_coefficients(s, BAND, MASS, level=1 - 1e-15).informative.any()
    assert np.all(unbounded.stiffness_low <= wide.stiffness_low) and np.all(wide.damping_high <= unbounded.damping_high)


def columns(records):
    """Real regressor of a row, from the definition; each record over the rms of its force."""
    parts = []
    for s in records:
        x, y = s.mean[2:] / np.sqrt(np.mean(np.abs(s.mean[:2]) ** 2))
        w = 2 * np.pi * s.frequency
        table = np.stack([x, y, 1j * w * x, 1j * w * y], axis=1)
        parts += [table.real, table.imag]
    return np.concatenate(parts)


@pytest.mark.parametrize("second", [[1.0, -1.0], [1.0, 0.7], [30.0, 15.0], [1.0, 1j]])
def test_condition_and_inflation_follow_their_definitions(second):
    s = [planar_record(F, VERTICAL), planar_record(F, second)]
    e = eight_coefficients(s, BAND, MASS, intervals=False)
    table = columns(s)
    assert e.condition[0] == pytest.approx(np.linalg.cond(table / np.linalg.norm(table, axis=0)), rel=1e-6)
    for j, name in enumerate(("stiffness_inflation", "damping_inflation")):
        for axis in range(2):
            column, rest = table[:, 2 * j + axis], np.delete(table, 2 * j + axis, axis=1)
            left = column - rest @ np.linalg.lstsq(rest, column, rcond=None)[0]
            assert getattr(e, name)[0][:, axis] == pytest.approx((column @ column) / (left @ left), rel=1e-6)


def test_excitations_too_much_alike_are_refused():
    apart, close = (
        eight_coefficients(
            [planar_record(F, direction, **SYMMETRIC) for direction in (VERTICAL, [1.0, 1.0 + d])], BAND, MASS
        )
        for d in (0.4, 0.02)
    )
    assert apart.identifiable[0] and not close.identifiable[0] and close.condition[0] > 30
    for name in ("stiffness", "damping_se", "stiffness_low", "cost", "fit_p"):
        assert np.isnan(getattr(close, name)).all() and not close.informative.any()


# The noise makes the columns of one excitation independent; no amount of it may make them count as such. One lane in
# a thousand may pass by the level of the test behind it.
@pytest.mark.parametrize("periods", [2, 5, 20])
@pytest.mark.parametrize("ratio", [np.inf, 1e6, 1e3, 100, 30, 10, 5, 3, 2, 1, 0.3, 0.01])
def test_one_excitation_is_refused_at_every_noise_level(ratio, periods):
    levels = noise_levels(F, ratio, **SYMMETRIC) if np.isfinite(ratio) else (0.0, 0.0)
    one = draw(planar_record(F, VERTICAL, levels, periods=periods, **SYMMETRIC), 500, 8)
    assert eight_coefficients([one], BAND, MASS, intervals=False).identifiable.sum() <= 2
    again = draw(planar_record(F, 3 * VERTICAL, levels, periods=periods, **SYMMETRIC), 500, 9)
    assert eight_coefficients([one, again], BAND, MASS, intervals=False).identifiable.sum() <= 2


@pytest.mark.parametrize("spread", [1.0, 1.5])
def test_one_excitation_is_refused_where_the_noise_differs_between_lines(spread):
    expected = planar_record(F, VERTICAL, noise_levels(F, 10), correlated(4), **SYMMETRIC)
    expected = replace(expected, covariance=expected.covariance * np.exp(spread * np.sin(F)))
    assert eight_coefficients([draw(expected, 2000, 10)], BAND, MASS, intervals=False).identifiable.sum() <= 4


def scaled(s, factor):
    """The record in another unit: every channel times a factor, or each times its own."""
    size = np.broadcast_to(factor, len(s.channels)).astype(float)
    return replace(s, mean=s.mean * size[:, None], covariance=s.covariance * np.outer(size, size)[:, :, None])


@pytest.mark.parametrize("factor", [0.01, 30.0])
def test_a_louder_copy_of_a_record_tells_as_much(factor):
    """Of excitations that are barely apart, beside noise in which a third of the draws pass for two."""
    levels = noise_levels(F, 8, **SYMMETRIC)
    one, two = (
        draw(planar_record(F, direction, levels, **SYMMETRIC), 300, i)
        for i, direction in enumerate((VERTICAL, np.array([1.0, 1.7]) / 2))
    )
    plain = eight_coefficients([one, two], BAND, MASS, intervals=False)
    louder = eight_coefficients([one, scaled(two, factor)], BAND, MASS, intervals=False)
    passed = plain.identifiable.mean()
    assert 0.2 < passed < 0.8
    assert np.array_equal(louder.identifiable, plain.identifiable)
    np.testing.assert_allclose(louder.stiffness, plain.stiffness, rtol=1e-5)


def test_estimates_do_not_depend_on_the_units():
    """A force in MN and a mass in Gg."""
    unit, s = 1e-6, diagonal_records(3, 6, 12)
    tiny = [scaled(one, [unit if name.startswith("force") else 1.0 for name in one.channels]) for one in s]
    e, small = eight_coefficients(s, BAND, MASS), eight_coefficients(tiny, BAND, MASS * unit)
    for f in fields(e):
        factor = unit if f.name.startswith(("stiffness", "damping")) and "inflation" not in f.name else 1.0
        np.testing.assert_allclose(getattr(small, f.name), getattr(e, f.name) * factor, rtol=2e-3, err_msg=f.name)


def test_circular_motion_and_an_axis_at_rest_are_refused():
    uncoupled = {"stiffness": np.diag([130e3, 130e3]), "damping": np.diag([20.0, 20.0])}
    whirl = planar_record(F, [1.0, 1j], **uncoupled)
    assert not eight_coefficients([whirl, whirl], BAND, MASS).identifiable[0]
    still = planar_record(F, [1.0, 0.0], **uncoupled)
    e = eight_coefficients([still], BAND, MASS)
    assert not e.identifiable[0] and np.isinf(e.condition[0])


def test_row_sums_are_what_one_excitation_tells():
    s = draw(planar_record(F, VERTICAL, noise_levels(F, 20), **SYMMETRIC), 3, 11)
    found = row_sums(s, BAND, (0.92, 0.95))
    for axis, mass in (("x", 0.92), ("y", 0.95)):
        own = maximum_likelihood(axis_statistics(s, axis), BAND, mass)
        for f in fields(own):
            assert np.array_equal(getattr(getattr(found, axis), f.name), getattr(own, f.name))
    exact = row_sums(planar_record(F, VERTICAL, **SYMMETRIC), BAND, MASS)
    assert exact.x.stiffness[0] == pytest.approx(129e3) and exact.y.damping[0] == pytest.approx(25.0)
    assert exact.ratio[0] == pytest.approx(1.0) and exact.ratio_spread[0] < 1e-6
    assert np.abs(found.ratio - 1).max() < 0.1 and found.ratio_spread.max() < 0.1


def test_direct_coefficients_hold_for_the_ratio_of_the_motions():
    narrow, ratio = np.array([100.0, 100.001, 100.002]), 0.5 + 0.8j
    w = 2 * np.pi * narrow
    motion = np.array([1e-6, ratio * 1e-6])
    z = STIFFNESS - MASS * w[:, None, None] ** 2 * np.eye(2) + 1j * w[:, None, None] * DAMPING
    s = planar_record(narrow, z @ motion)
    found = row_sums(s, np.array([[99.0, 101.0]]), MASS)
    for own, other, r in ((0, 1, ratio), (1, 0, 1 / ratio)):
        k, c = STIFFNESS[own], DAMPING[own]
        estimate = found.x if own == 0 else found.y
        stiffness = k[own] + r.real * k[other] - w[0] * r.imag * c[other]
        damping = c[own] + r.real * c[other] + r.imag * k[other] / w[0]
        assert estimate.stiffness[0] == pytest.approx(stiffness, rel=1e-4)
        assert estimate.damping[0] == pytest.approx(damping, rel=1e-4)
    assert found.ratio[0] == pytest.approx(ratio, rel=1e-4)


def test_axis_statistics_keep_one_axis_under_its_plain_names():
    s = diagonal_records(10, 2, seed=12)[0]
    names = ("current_y", *CHANNELS, "command_x", "speed")
    rng = np.random.default_rng(0)
    covariance = rng.standard_normal((2, 7, 7, F.size)) + 0j
    wide = replace(s, channels=names, mean=rng.standard_normal((2, 7, F.size)) + 0j, covariance=covariance)
    x, y = axis_statistics(wide, "x"), axis_statistics(wide, "y")
    assert x.channels == ("force", "displacement", "command") and y.channels == ("current", "force", "displacement")
    assert np.array_equal(x.amplitude("command"), wide.amplitude("command_x"))
    assert np.array_equal(y.cross("current", "displacement"), wide.cross("current_y", "displacement_y"))
    with pytest.raises(ValueError, match="force_z"):
        axis_statistics(wide, "z")


@pytest.mark.parametrize("estimator", [eight_coefficients, planar_least_squares])
def test_bad_input_is_named(estimator):
    a, b = diagonal_records(10)
    with pytest.raises(ValueError, match="no record"):
        estimator([], BAND, MASS)
    renamed = replace(b, channels=("force_x", "force_z", "displacement_x", "probe"))
    with pytest.raises(ValueError, match="record 1: channels force_y, displacement_y are missing"):
        estimator([a, renamed], BAND, MASS)
    with pytest.raises(ValueError, match=r"200 .. 215 Hz holds 0 lines"):
        estimator([a, b], np.array([[62.5, 77.5], [200.0, 215.0]]), MASS)
    for mass in (0.0, -1.0, np.nan, (1.0, 0.0)):
        with pytest.raises(ValueError, match="must be positive"):
            estimator([a, b], BAND, mass)
    with pytest.raises(ValueError, match=r"record 1 has lanes \(3,\), record 0 has \(2,\)"):
        estimator([draw(a, 2, 0), draw(b, 3, 0)], BAND, MASS)


def test_too_few_lines_are_named():
    s = [planar_record(F[:1], d, periods=3) for d in DIAGONALS]
    with pytest.raises(ValueError, match="record 0 has 1 lines of 3 periods"):
        eight_coefficients(s, BAND, MASS)
    with pytest.raises(ValueError, match="holds 2 lines of all records and needs 3"):
        planar_least_squares(s, BAND, MASS)


@pytest.mark.parametrize("ratio", [5, 30])
def test_the_noise_share_is_that_of_the_displacement_that_was_drawn(ratio):
    found = eight_coefficients(diagonal_records(ratio, 200, seed=14), BAND, MASS, intervals=False)
    assert np.median(found.noise_share) == pytest.approx(1 / (1 + ratio**2), rel=0.1)
