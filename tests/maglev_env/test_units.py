"""Units fit the size of what is shown."""

import numpy as np
import pytest

from maglev_env.units import common_unit, prefixed


@pytest.mark.parametrize(
    ("value", "unit", "shown"),
    [
        (2.5, "N/m", "2.5 N/m"),
        (-12.5e3, "N/m", "-12.5 kN/m"),
        (0.93, "N/A", "0.93 N/A"),
        (0.0031, "N s/m", "3.1 mN s/m"),
        (7.5e-5, "s", "75 µs"),
        (999.7, "Hz", "1 kHz"),
        (3e-11, "m", "0.03 nm"),
        (2.2, "", "2.2 "),
        (0.0, "N", "0 N"),
        (np.inf, "T", "inf T"),
        (3e-8, "kg m", "0.03 g mm"),
    ],
)
def test_a_size_has_its_prefix(value, unit, shown):
    factor, name = prefixed(value, unit)
    assert f"{value * factor:.3g} {name}" == shown


def test_a_column_has_one_unit():
    assert common_unit([1e3, 3e4, np.nan, np.inf, 9e8], "N/m") == (1e-3, "kN/m")
    assert common_unit([], "N/m") == (1.0, "N/m")
