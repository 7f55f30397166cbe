"""Small simulated motion with each effect against the analytic loop, line by line."""

from dataclasses import replace

import numpy as np
import pytest
from effect_cases import ALL, COUPLED, EACH, FREE

from maglev_env.experiment import Experiment, without_noise
from maglev_env.kernel.simulate import simulate_records, simulate_statistics
from maglev_env.linear.expected import expected_statistics
from maglev_env.linear.loop import loop_response
from maglev_env.linear.poles import closed_loop_poles
from maglev_env.loop.effect import effect
from maglev_env.loop.gains import Gains
from maglev_env.rig.excitation import Excitation

# At rest the magnets of an eccentric rig pull: with a tenth of their stiffness, on a support this stiff, the rotor and
# its current stay where they were.
STIFF = replace(FREE, support_stiffness=1e6, support_damping=100.0)
FIRM_GAINS = (Gains(12000.0, 2000.0, 12.0), Gains(12000.0, 2000.0, 14.0))
SOFT_GAINS = Gains(100.0, 0.0, 1.0)
APART = ("eccentricity", "hysteresis")
OTHER_KERNELS = ("friction", "saturation")  # in two axes they are compared with the equations, in kernels of their own
SMALL = {name: values for name, values in EACH.items() if name not in APART}
SMALL["all"] = {**{name: values for name, values in ALL.items() if name not in APART}, **effect("delay", 61.7e-6)}


def small(rig, effects, gains=FREE.gains, lines=(2, 6, 10, 16, 40), turned=0.0):
    """20 ms periods of force and injection that move the rotor by a nanometre."""
    excitations = (
        Excitation("sphs", "force", 50.0, (1, 3, 5, 7, 9), 1e-4, direction=turned),
        Excitation("sphs", "current", 50.0, lines, 1e-5, direction=-2 * turned),
    )
    return without_noise(Experiment(rig, gains, excitations, effects=effects, periods=2, transient_periods=60))


def largest_error(e):
    """Of the lines' amplitudes in displacement and command, relative to what the analytic loop expects."""
    got = simulate_statistics([e]).statistics
    expected = expected_statistics(e, got.lines)
    kept = [i for i, name in enumerate(got.channels) if name.startswith(("displacement", "command"))]
    return np.abs(got.mean[0][kept] / expected.mean[kept] - 1).max()


@pytest.mark.slow
@pytest.mark.parametrize("effects", SMALL.values(), ids=SMALL)
def test_a_small_experiment_with_each_effect_is_the_analytic_loop_up_to_2_khz(effects):
    assert largest_error(small(FREE, effects)) < 1e-3


@pytest.mark.slow
def test_a_small_experiment_with_hysteresis_is_the_analytic_loop():
    # The simulator's hysteresis runs straight through a step, which costs more the faster the current turns.
    assert largest_error(small(FREE, EACH["hysteresis"], lines=(2, 4))) < 1e-3


@pytest.mark.slow
@pytest.mark.parametrize("name", ("eddy_current", "sensor_resonance", "support_resonance", "all"))  # one kernel
def test_a_small_experiment_in_two_axes_is_the_analytic_loop(name):
    effects = {one: values for one, values in SMALL[name].items() if one not in OTHER_KERNELS}
    e = small(COUPLED, {**effects, **effect("cross_coupling", 0.1)}, FIRM_GAINS, turned=30.0)
    assert np.abs(closed_loop_poles(e)).max() < 1 and largest_error(e) < 1e-3


@pytest.mark.slow
def test_small_motion_about_an_eccentric_rest_is_the_analytic_loop():
    effects = {**EACH["eccentricity"], **effect("negative_stiffness", -0.9)}
    assert largest_error(small(STIFF, effects, SOFT_GAINS)) < 1e-3


@pytest.mark.slow
@pytest.mark.parametrize("delay", [0.0, 61.7e-6])
@pytest.mark.parametrize("lags", [{"amplifier_time_constant": 0.0}, {}], ids=["no pole", "one pole"])
def test_the_recorded_current_is_the_amplifier_response_times_the_command(lags, delay):
    e = small(replace(FREE, **lags), {**EACH["eddy_current"], **effect("delay", delay)})
    record = simulate_records([e])[0]
    n, lines = e.samples_per_period, np.array([1, 2, 7, 16, 40])
    _, command, current, _ = np.fft.rfft(record[:, -n:], axis=-1)[:, lines]
    amplifier = loop_response(e, lines * e.fundamental).amplifier
    np.testing.assert_allclose(current, amplifier * command, rtol=1e-4)
