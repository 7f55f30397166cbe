"""Rigs within the tolerances of a rig: every one can be made, and what is uncertain differs between them."""

from dataclasses import replace

import numpy as np
import pytest

from maglev_env.loop.magnets.kinds import force_law
from maglev_env.loop.magnets.law import linearise
from maglev_env.rig.drawn import scaled_rig, tolerance_factors
from maglev_env.rig.rig import axis_rig
from maglev_env.rig.rig_file import load_rig, rig_from_toml

PAIR = """
schema = "maglev-rig/1"
name = "pair"
magnet = "electromagnet_pair"
[parameters]
mass = 1.06
gap = 0.4e-3
turns = 200
pole_area = 260e-6
bias_current = 1.0
"""


def drawn(rig, count=100):
    rng = np.random.default_rng(0)
    return [scaled_rig(rig, tolerance_factors(rig, rng)) for _ in range(count)]


def tangent(rig, axis=0):
    return np.array(linearise(force_law(axis_rig(rig, axis))))


def test_the_tangent_of_magnets_that_are_given_by_geometry_is_uncertain_too():
    rig = load_rig("eframe")
    assert rig.actuator_gain is None and rig.negative_stiffness is None
    spread = np.std(np.log([np.abs(tangent(one)) for one in drawn(rig, 300)]), axis=0)
    np.testing.assert_allclose(spread, [0.05, 0.10], rtol=0.15)


def test_a_factor_of_the_tangent_is_one_of_what_the_drawn_geometry_gives():
    rig = rig_from_toml(PAIR, "here")
    wider, both = scaled_rig(rig, {"gap": 1.1}), scaled_rig(rig, {"gap": 1.1, "actuator_gain": 0.9})
    np.testing.assert_allclose(tangent(both), tangent(wider) * [0.9, 1.0], rtol=1e-12)
    planar = replace(rig, axes=2, per_axis={"y": {"turns": 150.0}})
    found = scaled_rig(planar, {"actuator_gain": 0.9, "negative_stiffness": 1.2})
    for axis in (0, 1):
        np.testing.assert_allclose(tangent(found, axis), tangent(planar, axis) * [0.9, 1.2], rtol=1e-12)
    assert scaled_rig(load_rig("pedestal"), {"actuator_gain": 1.1}) == load_rig("pedestal")


@pytest.mark.parametrize(
    "changed, stated",
    [
        ("clearance = 0.38e-3", "gap = 0.05"),
        ("clearance = 0.38e-3", "gap = 0.05\nclearance = 0.05"),
        ("", "clearance = 0.02"),
        ("", "gap = 0.05"),
    ],
)
@pytest.mark.parametrize("axes, own", [(1, ""), (2, ""), (2, "[axis.y]\ngap = 0.39e-3")])
def test_no_rotor_that_is_drawn_has_more_room_than_its_gap(changed, stated, axes, own):
    rig = rig_from_toml(f"axes = {axes}{PAIR}{changed}\n{own}\n[tolerance]\n{stated}\n", "here")
    for one in drawn(rig):
        assert all(axis_rig(one, axis).clearance <= axis_rig(one, axis).gap for axis in range(rig.axes))
    if not changed and stated.startswith("gap"):
        assert all(one.clearance == one.gap for one in drawn(rig))


@pytest.mark.parametrize("table, value", [("tolerance", "0.1"), ("randomization", "[0.5, 1.5]")])
@pytest.mark.parametrize("name", ["adc_bits", "dac_bits", "bearings", "flux_path"])
def test_a_parameter_that_is_no_continuous_number_has_no_tolerance(table, value, name):
    with pytest.raises(ValueError, match=rf"here: \[{table}\]: .*{name}"):
        rig_from_toml(f"{PAIR}[{table}]\n{name} = {value}\n", "here")
