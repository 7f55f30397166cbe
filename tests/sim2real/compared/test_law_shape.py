"""What is not known of a force law's shape, beside any law that a fit may end at."""

import pytest
from ball_bench import BALL

from maglev_env.experiment import Experiment
from maglev_env.loop.magnets.kinds import force_law
from maglev_env.loop.magnets.law import linearise, reshaped
from maglev_env.rig.rig import rig_from_toml
from sim2real.compared.law_shape import law_shapes
from sim2real.compared.simulated import Point


@pytest.mark.parametrize("exponent", [-1.5, 0.0, 3.0, 34.0, 40.0])
@pytest.mark.parametrize("offset", [-0.6, 0.0, 12.0, 20.0])
@pytest.mark.parametrize("centre", [0.0, 4e-4])
def test_every_shape_is_a_law_of_the_same_gain_and_stiffness_at_rest(exponent, offset, centre):
    rig = rig_from_toml(BALL, "ball.toml")
    effects = {"force_law": {"exponent": exponent, "offset": offset}, "eccentricity": {"offset": centre}}
    near = Point(effects | {"actuator_gain": {"change": 0.2}}, {})
    law = force_law(rig)
    gain, stiffness = linearise(reshaped(law, exponent, offset), centre)
    for point in law_shapes(rig, near).values():
        bent = point.effects["force_law"]
        other = linearise(reshaped(law, **bent), centre)
        assert other[0] * (1 + point.effects["actuator_gain"]["change"]) == pytest.approx(1.2 * gain, rel=1e-9)
        assert other[1] * (1 + point.effects["negative_stiffness"]["change"]) == pytest.approx(stiffness, rel=1e-9)
        assert bent != near.effects["force_law"]
        Experiment(rig, rig.gains, (), effects=point.effects)


def test_a_shape_leaves_gain_and_stiffness_within_their_tolerances_where_they_are():
    rig = rig_from_toml(BALL, "ball.toml")
    changes = {"actuator_gain": 0.05, "negative_stiffness": 0.08, "mass": 0.01}
    for name, point in law_shapes(rig, Point({}, changes)).items():
        assert point.effects["actuator_gain"]["change"] == pytest.approx(0.05)
        if name == "form of the force law":  # from one steepness to the same
            assert point.effects["negative_stiffness"]["change"] == pytest.approx(0.08)
        assert point.changes == changes
        beside = law_shapes(rig, Point({"actuator_gain": {"change": 0.3}}, changes))[name]
        assert beside.effects["actuator_gain"]["change"] == pytest.approx(0.3), "the effect stands for its tolerance"


def test_the_form_of_a_stiffness_stays_beside_every_shape_of_the_law():
    rig = rig_from_toml(BALL, "ball.toml")
    near = Point({"negative_stiffness": {"change": 0.3, "distance_share": 1.0}}, {})
    for point in law_shapes(rig, near).values():
        assert point.effects["negative_stiffness"]["distance_share"] == 1.0
