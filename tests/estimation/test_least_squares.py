import dataclasses

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import stats

from estimation.least_squares import least_squares


def receptance(frequency, stiffness, damping, mass):
    omega = 2 * np.pi * np.asarray(frequency)
    return 1 / (stiffness - mass * omega**2 + 1j * omega * damping)


def noise(rng, shape, sigma):
    return sigma / np.sqrt(2) * (rng.standard_normal(shape) + 1j * rng.standard_normal(shape))


@settings(max_examples=60, deadline=None)
@given(
    stiffness=st.floats(-5e4, 5e5),
    damping=st.floats(0.5, 500),
    mass=st.floats(0.05, 5),
    first=st.floats(5, 200),
    count=st.integers(2, 20),
)
def test_exact_data_give_the_coefficients_back(stiffness, damping, mass, first, count):
    frequency = first + np.arange(count)
    got = least_squares(frequency, receptance(frequency, stiffness, damping, mass), mass)
    inertia = mass * (2 * np.pi * frequency[-1]) ** 2
    assert got.stiffness == pytest.approx(stiffness, abs=1e-9 * (abs(stiffness) + inertia))
    assert got.damping == pytest.approx(damping, rel=1e-6, abs=1e-9 * inertia / first)
    assert got.r2 == pytest.approx(1.0)


def test_agrees_with_ordinary_least_squares():
    rng = np.random.default_rng(4)
    frequency, mass = np.arange(40.0, 56.0), 0.92
    g = receptance(frequency, 134.5e3, 60.0, mass)
    g = g + noise(rng, g.shape, 0.05 * np.abs(g).mean())
    got = least_squares(frequency, g, mass)

    omega = 2 * np.pi * frequency
    design = np.concatenate([np.stack([g.real, -omega * g.imag], 1), np.stack([g.imag, omega * g.real], 1)])
    target = np.concatenate([mass * omega**2 * g.real + 1, mass * omega**2 * g.imag])
    coefficients, rss, _, _ = np.linalg.lstsq(design, target, rcond=None)
    rows = target.size
    r2 = 1 - rss[0] / (rows * np.var(target))
    adjusted = 1 - (1 - r2) * (rows - 1) / (rows - 2)
    errors = np.sqrt(np.diag(np.linalg.inv(design.T @ design)) * rss[0] / (rows - 3))
    np.testing.assert_allclose([got.stiffness, got.damping], coefficients)
    np.testing.assert_allclose([got.stiffness_se, got.damping_se], errors)
    np.testing.assert_allclose([got.t_stiffness, got.t_damping], coefficients / errors)
    np.testing.assert_allclose([got.r2, got.r2_adjusted, got.goodness_of_fit], [r2, adjusted, np.sqrt(adjusted)])
    limit = stats.t(rows - 3).ppf(0.975)
    assert [got.stiffness_significant, got.damping_significant] == (np.abs(coefficients / errors) >= limit).tolist()


def test_an_insignificant_coefficient_is_marked():
    rng = np.random.default_rng(0)
    frequency = np.arange(40.0, 60.0)
    g = receptance(frequency, 134.5e3, 0.0, 0.79)
    many = least_squares(frequency, g + noise(rng, (400, g.size), 0.02 * np.abs(g).mean()), 0.79)
    assert np.all(many.stiffness_significant)
    assert np.mean(many.damping_significant) < 0.1  # the true damping is zero


@pytest.mark.parametrize(("centre", "expected"), [(30, 2.5e3), (150, 64e3), (240, 266e3)])
def test_noise_alone_makes_a_constant_stiffness_rise(centre, expected):
    stiffness, damping, mass, sigma = 2470.0, 3.1, 0.13, 1e-5
    rng = np.random.default_rng(centre)
    frequency = np.arange(centre - 5.0, centre + 6.0)
    g = receptance(frequency, stiffness, damping, mass)
    many = least_squares(frequency, g + noise(rng, (200, g.size), sigma), mass)
    # Large-sample limit: rho k + (1 - rho) m w^2, each line weighted by its power.
    omega = 2 * np.pi * frequency
    total = np.abs(g) ** 2 + sigma**2
    limit = np.sum(np.abs(g) ** 2 * stiffness + sigma**2 * mass * omega**2) / np.sum(total)
    limit_damping = damping * np.sum(omega**2 * np.abs(g) ** 2) / np.sum(omega**2 * total)
    assert np.mean(many.stiffness) == pytest.approx(expected, rel=0.06)
    assert np.mean(many.stiffness) == pytest.approx(limit, rel=0.03)
    assert np.mean(many.damping) == pytest.approx(limit_damping, abs=4 * np.std(many.damping) / np.sqrt(200))
    if centre == 240:
        assert np.mean(many.r2) == pytest.approx(0.89, abs=0.02)
        assert np.all(many.stiffness_significant)


def test_a_batch_is_the_loop():
    rng = np.random.default_rng(1)
    frequency = np.arange(10.0, 25.0)
    mass = np.array([[0.5], [0.9]])
    g = receptance(frequency, 2e4, 12.0, 0.7) * (1 + noise(rng, (2, 3, frequency.size), 0.1))
    batch = least_squares(frequency, g, mass)
    for i, j in np.ndindex(2, 3):
        single = least_squares(frequency, g[i, j], mass[i, 0])
        for field in dataclasses.fields(batch):
            np.testing.assert_allclose(getattr(batch, field.name)[i, j], getattr(single, field.name), rtol=1e-12)


@pytest.mark.parametrize(
    ("arguments", "name"),
    [
        (([10.0], [1e-5 + 0j], 1.0), "frequency"),
        (([0.0, 1.0], [1e-5 + 0j, 1e-5], 1.0), "frequency"),
        (([1.0, 2.0], [1e-5 + 0j], 1.0), "receptance"),
        (([1.0, 2.0], [1e-5 + 0j, np.nan], 1.0), "receptance"),
        (([1.0, 2.0], [0j, 0j], 1.0), "receptance"),
        (([1.0, 2.0], [1e-5 + 0j, 1e-5], 0.0), "mass"),
    ],
)
def test_bad_input_is_named(arguments, name):
    with pytest.raises(ValueError, match=name):
        least_squares(*arguments)
