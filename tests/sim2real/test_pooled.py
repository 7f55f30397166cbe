"""What the pooled estimate says of its own assumptions."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from maglev_env.rig.rig_file import load_rig
from sim2real.coefficients import Coefficient
from sim2real.pooled import _disagreements, _pulled, _reaching, exact_mass


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


def test_what_contradicts_the_mass_at_rest_is_no_surer_of_what_rest_does_not_tell():
    """Twelve standard errors off in one coefficient, as of an aliased current, may be as many in another one."""
    moving = [
        Coefficient("actuator_gain", "N/A", 6.16, 0.09, 5.5, True),
        Coefficient("negative_stiffness", "N/m", -1130.0, 10.0, -1000.0, True),
        Coefficient("damping", "N s/m", -0.7, 0.14, 0.0, True, most=2.0),
    ]
    resting = [replace(moving[0], value=5.53, se=0.02), replace(moving[1], value=-1012.0, se=5.0)]
    gain, stiffness, damping = _reaching(moving, resting)
    for c, other in ((gain, 5.53), (stiffness, -1012.0)):
        assert min(abs(end - other) for end in c.interval) < 0.05 * abs(c.value - other)
    assert damping.se == pytest.approx(0.14 * 118 / 10 / 1.96, rel=1e-3) and damping.bounded
    assert not _reaching([*moving[:2], replace(moving[2], most=0.5)], resting)[2].bounded
    assert _reaching([moving[2]], resting)[0] == moving[2]


def damping(value, se):
    return [Coefficient("damping", "N s/m", value, se, 0.1, True)]


def test_how_far_a_recording_is_from_all_follows_from_what_is_printed():
    said = _disagreements("run2", damping(0.69, 0.05), damping(0.4, 0.03))["damping"]
    assert said.startswith("run2: damping 0.690 +- 0.050 N s/m, and 0.4 N s/m of all recordings together: ")
    assert said.endswith("apart by 0.290 +- 0.040 N s/m, 7.2 standard errors")


def test_a_recording_that_is_surer_than_all_differs_from_them_by_its_own_error():
    """0.1365 +- 0.0018 beside 0.1319 +- 0.0038 had been 5.1 standard errors apart."""
    assert not _disagreements("run", damping(0.1365, 0.0018), damping(0.1319, 0.0038))
    (said,) = _disagreements("run", damping(0.1365, 0.0018), damping(0.1019, 0.0038)).values()
    assert "0.0346 +- 0.0018 N s/m, 19.2 standard errors" in said
