"""Numbers as a person reads them."""

import pytest

from sim2real.words import quantity


@pytest.mark.parametrize(
    ("value", "se", "unit", "shown"),
    [
        (3733812528.0, 21023896.0, "N/m^3", "(3.734 +- 0.021)e9 N/m^3"),
        (-3733812528.0, 21023896.0, "N/m^3", "(-3.734 +- 0.021)e9 N/m^3"),
        (134.5e3, 1.2e3, "N/m", "134.5 +- 1.2 kN/m"),
        (75e-6, 1.2e-6, "s", "75.0 +- 1.2 µs"),
    ],
)
def test_a_value_shows_the_digits_that_its_error_leaves(value, se, unit, shown):
    assert quantity(value, se, unit) == shown
