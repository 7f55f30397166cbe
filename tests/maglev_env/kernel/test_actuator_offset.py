"""A constant error of the current: where the loop comes to rest with it, by hand."""

from dataclasses import replace

import numpy as np

from maglev_env.experiment import Experiment, without_noise
from maglev_env.kernel.simulate import simulate_records
from maglev_env.loop.effect import effect
from maglev_env.loop.gains import Gains
from maglev_env.rig.excitation import Excitation
from maglev_env.rig.rig_file import load_rig


def test_the_loop_rests_where_its_command_makes_up_for_the_offset():
    # At rest command = -kp y and k_i (command + i0) = k y with k < 0: the loop answers a drifted zero like a load.
    rig = replace(load_rig("hmb_free"), protocol=None)
    gains = Gains(8000.0, 0.0, 5.2)
    tiny = Excitation("sphs", "force", 50.0, (1, 2), 1e-9)
    e = without_noise(Experiment(rig, gains, (tiny,), periods=1, transient_periods=20))
    zero = 1e-3
    record = simulate_records([replace(e, effects=effect("actuator_offset", zero))])[0]
    displacement, command, current = (row[-200:].mean() for row in record[:3])
    expected = rig.actuator_gain * zero / (rig.actuator_gain * gains.kp + rig.negative_stiffness)
    np.testing.assert_allclose(displacement, expected, rtol=1e-3)
    np.testing.assert_allclose([command, current], -gains.kp * displacement, rtol=1e-6)
