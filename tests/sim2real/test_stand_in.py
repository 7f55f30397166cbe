"""The controller that stands in for an unknown one."""

import pytest

from maglev_env.loop.gains import LinearController
from maglev_env.loop.magnets.kinds import force_law
from maglev_env.loop.magnets.law import linearise
from maglev_env.rig.rig import load_rig
from sim2real.recorded.stand_in import HOLDING, holds


@pytest.mark.parametrize("pole", [0.0, 0.5])
def test_a_fitted_controller_must_be_clearly_stiffer_at_rest_than_the_magnets(pole):
    rig = load_rig("hmb_free")
    gain, stiffness = linearise(force_law(rig))
    for share in (0.5, 1.05, 1.4, 1.6, 5.0):
        at_rest = share * abs(stiffness) / gain
        c = LinearController((at_rest * (1 - pole),), (1.0, -pole))
        assert holds(rig, c) == (share > HOLDING)
    assert holds(rig, LinearController((1.0,), (1.0, -1.0)))  # an integrator
