"""Magnets between the probes, whose curved force a rig along the probes does not have."""

import numpy as np
import pytest

from maglev_env.experiment import Experiment
from maglev_env.loop.gains import NO_CONTROLLER
from maglev_env.rig.rig import rig_from_toml
from sim2real.compared.crossed import turned_force

RIG = """schema = "maglev-rig/1"
name = "two pairs"
magnet = "electromagnet_pair"
axes = 2
[parameters]
mass = 1.0
gap = 0.5e-3
bias_current = 2.0
actuator_gain = 40.0
negative_stiffness = -4e4
"""


def test_a_cubic_pull_between_the_axes_is_half_of_its_own_and_the_rest_of_the_other():
    e = Experiment(rig_from_toml(RIG, "rig.toml"), NO_CONTROLLER, ())
    nothing, x, y = np.zeros((2, 1)), 2e-5, 1e-5
    # Without current a pair pulls by k x + 2 k x^3 / g^2 + ..., with the magnet's k = 4e4 N/m and the gap g.
    cubic = 2 * 4e4 / 0.5e-3**2
    (along, across), (both, _) = (turned_force(e, np.array([[x], [v]]), nothing).ravel() for v in (0.0, y))
    assert along == pytest.approx(-0.5 * cubic * x**3, rel=0.02)
    assert across == pytest.approx(0.0, abs=0.02 * abs(along))
    assert both - along == pytest.approx(1.5 * cubic * x * y**2, rel=0.02)
