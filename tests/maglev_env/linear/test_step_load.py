"""The step of the load against the simulator of another library, and against the static stiffness."""

import control
import numpy as np
import pytest

from maglev_env.design.defaults import with_defaults
from maglev_env.experiment import protocol_experiment
from maglev_env.linear.loop import loop_response
from maglev_env.linear.poles import closed_loop
from maglev_env.linear.step_load import step_load
from maglev_env.loop.effect import effect
from maglev_env.rig.rig_file import load_rig


@pytest.mark.parametrize("effects", [{}, effect("delay", 1.3e-4)])
def test_the_step_of_a_load_is_that_of_python_control(effects):
    experiment = protocol_experiment(with_defaults(load_rig("hmb_free")), effects=effects)
    times, read = step_load(experiment, 0.05)
    a, b, c = closed_loop(experiment)
    system = control.ss(a, b, c, np.zeros((1, 1)), 1 / experiment.rig.control_rate)
    found = control.step_response(system, np.arange(0, 1001) / experiment.rig.control_rate)
    stride = round(times[1] * experiment.rig.control_rate)
    assert times[-1] == pytest.approx(0.05, abs=stride / experiment.rig.control_rate)
    np.testing.assert_allclose(read[:, 0, 0], found.outputs[::stride][: times.size], rtol=1e-6, atol=1e-12)


def test_a_load_that_stays_ends_at_the_static_receptance():
    experiment = protocol_experiment(with_defaults(load_rig("hmb_radial")))
    _, read = step_load(experiment, 2.0)
    static = loop_response(experiment, np.array([1e-3])).receptance[0]
    np.testing.assert_allclose(read[-1], static.real, rtol=1e-4, atol=1e-9)
