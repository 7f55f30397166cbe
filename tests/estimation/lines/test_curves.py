import numpy as np
import pytest
import scipy

from estimation.lines.curves import _spline, crossings, largest, refine, smooth_response

FREQUENCY = np.geomspace(1, 100, 60)


def test_refine_passes_through_the_lines_of_a_batch():
    values = np.random.default_rng(0).standard_normal((2, 60)) + 1j
    grid, curve = refine(FREQUENCY, values)
    assert curve.shape == (2, grid.size) == (2, 16 * 59 + 1)
    np.testing.assert_allclose(np.exp(grid[::16]), FREQUENCY)
    np.testing.assert_allclose(curve[:, ::16], values, atol=1e-12)


@pytest.mark.parametrize("n, k", [(4, 1), (5, 3), (90, 20)])
def test_the_spline_is_that_of_scipy(n, k):
    rng = np.random.default_rng(n)
    x, values = np.cumsum(rng.uniform(0.01, 1.0, n)), rng.standard_normal((2, k, n))
    values = values[0] + 1j * values[1]
    np.testing.assert_allclose(_spline(x, values), scipy.interpolate.CubicSpline(x, values, axis=-1).c, rtol=1e-9)


def test_largest_finds_the_vertex_on_an_uneven_grid_and_keeps_the_ends():
    grid = np.array([0.0, 1.0, 1.5, 3.0, 3.2])
    _, at = largest(grid, np.stack([-((grid - 1.7) ** 2), grid, -grid, np.zeros(5)]))
    np.testing.assert_allclose(np.log(at), [1.7, 3.2, 0.0, 0.0], atol=1e-12)


def test_crossings_and_least_pick_the_wanted_one():
    grid = np.linspace(0, 3, 4)
    found = crossings(grid, np.array([-1.0, 1.0, 3.0, -1.0]), 10 * grid)
    np.testing.assert_allclose(found.log_frequency, [0.5, 2.75])
    (other,) = found.others
    assert found.least(other, -other) == pytest.approx((27.5, np.exp(2.75)))
    assert np.isnan(found.least(np.full(2, np.inf), np.full(2, np.inf))).all()


def test_the_least_of_each_curve_is_found():
    grid, level = np.linspace(0, 3, 4), np.array([[[-1.0, 1.0, 3.0, -1.0], [1.0, 1.0, 1.0, 1.0]]])
    found = crossings(grid, np.concatenate([level, -level]), np.broadcast_to(10 * grid, (2, 2, 4)))
    value, frequency = found.least(*found.others, *found.others)
    assert value.shape == frequency.shape == (2, 2)
    np.testing.assert_allclose(value, [[5, np.nan], [5, np.nan]])
    np.testing.assert_allclose(np.log(frequency), [[0.5, np.nan], [0.5, np.nan]])


def test_smoothing_takes_noise_off_and_keeps_straight_lines():
    clean = 1 / (1 - (FREQUENCY / 20) ** 2 + 0.6j * FREQUENCY / 20)
    rng = np.random.default_rng(1)
    sigma = 0.05
    noisy = clean + sigma / np.sqrt(2) * (rng.standard_normal((40, 60)) + 1j * rng.standard_normal((40, 60)))
    error = np.array([smooth_response(FREQUENCY, row, np.full(60, sigma**2)) for row in noisy]) - clean
    assert np.sqrt(np.mean(np.abs(error) ** 2)) < 0.65 * sigma
    straight = 2 + 1j * np.log(FREQUENCY)
    np.testing.assert_allclose(smooth_response(FREQUENCY, straight, np.linspace(0, 1, 60)), straight, atol=1e-6)
    np.testing.assert_array_equal(smooth_response(FREQUENCY, clean, np.zeros(60)), clean)


@pytest.mark.parametrize(
    ("arguments", "name"),
    [
        ((FREQUENCY[:3], np.ones(3), np.ones(3)), "frequency"),
        ((FREQUENCY, np.ones(3), np.ones(60)), "response"),
        ((FREQUENCY, np.ones(60), -np.ones(60)), "variance"),
    ],
)
def test_bad_input_is_named(arguments, name):
    with pytest.raises(ValueError, match=name):
        smooth_response(*arguments)
