"""Numbers as tables and pages show them."""

import pytest

from maglev_workbench.page import number, with_interval


@pytest.mark.parametrize(
    ("value", "digits", "text"),
    [(99.9999, 4, "100.0"), (100.0001, 4, "100.0"), (99.97, 3, "100"), (0.09996, 3, "0.100"), (0.0, 3, "0.00")],
)
def test_a_number_is_rounded_before_its_digits_are_counted(value, digits, text):
    assert number(value, digits) == text


@pytest.mark.parametrize("half", [0.0999999, 0.1000001])
def test_an_interval_has_the_digits_of_its_rounded_half_width(half):
    assert with_interval(30.0, 30.0 - half, 30.0 + half) == "30.00 ±0.10"
