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
def test_every_shape_is_a_law_of_the_same_gain_and_stiffness_at_rest(exponent, offset):
    rig = rig_from_toml(BALL, "ball.toml")
    near = Point({"force_law": {"exponent": exponent, "offset": offset}}, {})
    law = force_law(rig)
    gain, stiffness = linearise(reshaped(law, exponent, offset))
    for point in law_shapes(rig, near).values():
        bent = point.effects["force_law"]
        other = linearise(reshaped(law, **bent))
        assert other[0] == pytest.approx(gain, rel=1e-9)
        assert other[1] * (1 + point.effects["negative_stiffness"]["change"]) == pytest.approx(stiffness, rel=1e-9)
        assert bent != near.effects["force_law"]
        Experiment(rig, rig.gains, (), effects=point.effects)
