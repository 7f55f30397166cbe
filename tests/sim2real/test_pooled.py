"""What the pooled estimate says of its own assumptions."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from maglev_env.rig.rig import load_rig
from sim2real.pooled import exact_mass


@pytest.mark.parametrize(
    ("stated", "forced", "said"), [({}, False, True), ({"mass": 0.0}, False, False), ({}, True, False)]
)
def test_a_mass_of_which_no_tolerance_is_stated_is_said_to_be_the_scale(stated, forced, said):
    rig = replace(load_rig("hmb_free"), tolerance=stated)
    record = SimpleNamespace(nominal=rig, driven={"force": np.array([[forced]]), "current": np.array([[True]])})
    text = exact_mass([record])
    assert (text is not None) == said and (not said or f"{rig.mass:.4g} kg" in text)
