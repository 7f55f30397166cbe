"""What the pooled estimate says of its own assumptions."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from maglev_env.rig.rig_file import load_rig
from sim2real.coefficients import Coefficient
from sim2real.pooled import _pulled, exact_mass


@pytest.mark.parametrize(
    ("stated", "forced", "said"), [({}, False, True), ({"mass": 0.0}, False, False), ({}, True, False)]
)
def test_a_mass_of_which_no_tolerance_is_stated_is_said_to_be_the_scale(stated, forced, said):
    rig = replace(load_rig("hmb_free"), tolerance=stated)
    record = SimpleNamespace(nominal=rig, driven={"force": np.array([[forced]]), "current": np.array([[True]])})
    text = exact_mass([record])
    assert (text is not None) == said and (not said or f"{rig.mass:.4g} kg" in text)


def test_motion_that_pulls_away_what_is_known_at_rest_contradicts_it():
    def at(gain, se):
        return [Coefficient("actuator_gain", "N/A", gain, se, 0.8, True)]

    assert not _pulled(at(0.99, 0.005), at(0.93, 0.023))
    (said,) = _pulled(at(0.845, 0.03), at(0.93, 0.023))
    assert "0.930 +- 0.023 N/A" in said and "3.7 standard errors away, to 0.845" in said
