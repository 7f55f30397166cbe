"""Numbers as a person reads them."""

import pytest

from sim2real.words import fitted_quantity, quantity


@pytest.mark.parametrize(
    ("value", "se", "unit", "shown"),
    [
        (3733812528.0, 21023896.0, "N/m^3", "(3.734 +- 0.021)e9 N/m^3"),
        (-3733812528.0, 21023896.0, "N/m^3", "(-3.734 +- 0.021)e9 N/m^3"),
        (134.5e3, 1.2e3, "N/m", "134.5 +- 1.2 kN/m"),
        (75e-6, 1.2e-6, "s", "75.0 +- 1.2 µs"),
        (-75e-9, 4.1, "N", "0.0 +- 4.1 N"),
        (3e-6, 4e-5, "N", "3 +- 40 µN"),
    ],
)
def test_a_value_shows_the_digits_that_its_error_leaves(value, se, unit, shown):
    assert quantity(value, se, unit) == shown


@pytest.mark.parametrize(
    ("fitted", "is_change", "shown"),
    [
        ((0.227, 44.2, False), False, "227 mA (not identified)"),
        ((0.227, 0.1, False), False, "227 +- 100 mA"),
        ((0.01, 0.4, False), True, "+1 +- 40 %"),  # a change of 0 is a value like any other
        ((0.0, 0.4, True), False, "0 A (at its bound, not identified)"),
    ],
)
def test_what_is_not_told_has_no_interval(fitted, is_change, shown):
    value, se, ended = fitted
    told = fitted_quantity({"value": value, "se": None if ended else se, "at_bound": ended}, "A", is_change)
    assert told == shown
