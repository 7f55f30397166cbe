"""What is not known of the measurement, taken out of whitened data, against the square root of its covariance."""

import numpy as np

from sim2real.recorded.nuisances import AT_ONCE, Nuisances


def test_data_of_the_stated_covariance_become_white_ones():
    """A symmetric map takes 1 + C C^T to 1, for few numbers and for more than are mapped together."""
    rng = np.random.default_rng(1)
    for count in (6, AT_ONCE):
        columns = rng.standard_normal((3, count)) + 1j * rng.standard_normal((3, count))
        found = Nuisances(("a", "b", "c"), columns)
        parts = columns.view(float)
        data = rng.standard_normal((2, count)) + 1j * rng.standard_normal((2, count))
        kept = data.copy()
        mapped = found.without(data)
        np.testing.assert_array_equal(data, kept)
        # Twice the symmetric map is the inverse of the covariance (Woodbury's identity).
        twice = found.without(mapped).view(float)
        own = data.view(float)
        inverse = own - own @ parts.T @ np.linalg.inv(np.eye(3) + parts @ parts.T) @ parts
        np.testing.assert_allclose(twice, inverse, atol=1e-10 * np.sqrt(count))
        np.testing.assert_array_equal(found.clear(data), mapped)
        assert np.shares_memory(found.clear(data), data)


def test_the_most_probable_amounts_are_those_of_bayes_rule():
    rng = np.random.default_rng(2)
    columns = 3 * rng.standard_normal((3, 40)) + 3j * rng.standard_normal((3, 40))
    true, noise = np.array([0.5, -2.0, 1.0]), rng.standard_normal(80)
    data = (true @ columns.view(float) + noise).view(complex)
    found = Nuisances(("a", "b", "c"), columns)
    amounts = found.amounts(found.without(data))
    c = columns.view(float)
    expected = np.linalg.solve(np.eye(3) + c @ c.T, c @ data.view(float))
    assert list(amounts) == list("abc")
    np.testing.assert_allclose(list(amounts.values()), expected, rtol=1e-9)
    np.testing.assert_allclose(expected, true, atol=0.3)
    covariance = np.linalg.inv(np.eye(3) + c @ c.T)
    np.testing.assert_allclose(list(found.spread.values()), np.sqrt(np.diag(covariance)), rtol=1e-9)
