"""What is said of the actuator's gain over frequency."""

from dataclasses import replace

import numpy as np
import pytest

from estimation.apparent_gain import ApparentGain, BandGain
from maglev_workbench.commands.estimate.gain_report import gain_json, gain_line, gain_table

BANDS = tuple(BandGain(f, 1.25 * f, 1.1 * f, 10.0 + 0j, 0.1, 0.01) for f in np.geomspace(1.0, 28.0, 16))


def found(band, sign=1.0):
    bands = [replace(b, gain=sign * b.gain, sign=sign) for b in (*BANDS[:7], band, *BANDS[8:])]
    return ApparentGain(tuple(bands), -3e4, 10.0, "identified", 0.0)


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_a_band_that_chance_may_have_moved_is_not_said_to_be_late_or_of_another_gain(sign):
    """2.5 standard errors are sure of one band, and not of the latest of sixteen."""
    chance = replace(BANDS[7], gain=10.25 * np.exp(-0.025j))
    assert gain_line(found(chance, sign)) == ""
    sure = replace(BANDS[7], gain=11.0 * np.exp(-0.06j))
    text = gain_line(found(sure, sign))
    assert "actuator gain changes with frequency" in text and "; force late by 3.4" in text and text.endswith("(95 %)")
    assert gain_json(found(sure, sign))["bands"][7]["phase"] == pytest.approx(np.degrees(-0.06))
    assert gain_table(found(sure, sign)).row_count == 16


def test_the_interval_that_is_said_is_that_of_all_bands_together():
    """Of 16 bands, 2.955 standard errors to either side (the normal quantile of 1 - 0.05 / 32)."""
    late = found(replace(BANDS[7], gain=10.0 * np.exp(-0.06j)))
    low, high = late.latest.phase_within(late.together)[1:]
    assert np.radians([low, high]) == pytest.approx([-0.06 - 0.02955, -0.06 + 0.02955], abs=1e-5)
