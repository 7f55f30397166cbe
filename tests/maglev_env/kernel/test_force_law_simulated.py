"""Lanes with other force laws of the gap against Runge-Kutta steps of formulas written out."""

from dataclasses import replace

import numpy as np
import pytest
from gap_laws import changed_law, levitated

from maglev_env.experiment import Experiment, without_noise
from maglev_env.kernel.blocks import prepared
from maglev_env.kernel.driven import Drive
from maglev_env.kernel.lanes import structure_of
from maglev_env.kernel.replay import STRETCH, replayed
from maglev_env.kernel.simulate import simulate_records
from maglev_env.loop.effect import effect
from maglev_env.loop.gains import Gains
from maglev_env.rig.excitation import Excitation
from maglev_env.rig.rig import Rig
from maglev_env.rig.rig_file import load_rig

SAMPLES, L1, A = 400, 60e-3, 2.5e-3
INDUCTANCES = {
    "L0 + L1 / (1 + x / a)": ({"gap_offset": A, "force_constant": L1 * A / 2}, lambda x: L1 / A / (1 + x / A) ** 2),
    "L0 + L1 exp(-x / a)": ({"force_length": A, "force_constant": L1 / A / 2}, lambda x: L1 / A * np.exp(-x / A)),
}
BALL = Rig("ball", "electromagnet", mass=0.058, gap=4e-3, control_rate=2000.0, bias_current=0.7)


def driven(rig, gains, peak, effects=None, direction=0.0):
    force = Excitation("sphs", "force", 5.0, tuple(range(1, 30)), peak, direction=direction)
    return without_noise(Experiment(rig, gains, (force,), effects=effects or {}, periods=1, transient_periods=0))


def compared(e, laws):
    """Records of a lane and of the formulas, (displacement and command, samples, axes)."""
    axes, rig = e.rig.axes, e.rig
    found = simulate_records([e], 4)[0][: 2 * axes, :SAMPLES].reshape(2, axes, SAMPLES).swapaxes(1, 2)
    wave = np.resize(np.atleast_2d(e.waveform("force")), (axes, e.samples_per_period))[:, :SAMPLES].T

    def pulled(y, i):
        return np.array([law(*at) for law, at in zip(laws, zip(y, i, strict=True), strict=True)])

    return found, levitated(pulled, rig.mass, e.gains, rig.control_rate, wave)


def assert_same(found, expected, moved):
    assert np.abs(expected[0]).max() > moved
    error, size = np.abs(found - expected).max(axis=1), np.abs(expected).max(axis=1)
    assert (error < 2e-6 * size).all(), error / size


@pytest.mark.parametrize("name", INDUCTANCES)
def test_a_ball_below_a_coil_of_measured_inductance(name):
    """The force is half the slope of the inductance times the squared current, and a bias carries the weight."""
    stated, slope = INDUCTANCES[name]
    rig = replace(BALL, bias_current=0.0, **stated)
    bias, weight = np.sqrt(2 * 0.058 * 9.80665 / slope(4e-3)), 0.058 * 9.80665
    e = driven(rig, Gains(350.0, 700.0, 7.0, td=2e-3), 0.45)
    found, expected = compared(e, [lambda y, i: 0.5 * slope(4e-3 - y) * (bias + i) ** 2 - weight])
    assert_same(found, expected, 2e-4)


def test_a_ball_under_the_effect():
    e = driven(BALL, Gains(350.0, 700.0, 7.0, td=2e-3), 0.45, effect("force_law", -0.6, offset=0.4))
    k = 0.058 * 9.80665 / 0.7**2

    def law(y, i):
        return k * (0.7 + i) ** 2 * (1.4 * 4e-3 / (1.4 * 4e-3 - y)) ** 1.4 - 0.058 * 9.80665

    found, expected = compared(e, [law])
    plain, _ = compared(replace(e, effects={}), [law])
    assert_same(found, expected, 2e-4)
    assert np.abs(plain - expected)[0].max() > 0.02 * np.abs(expected[0]).max()


@pytest.mark.slow
def test_two_pairs_in_x_and_y_under_the_effect():
    raw = replace(load_rig("eframe"), protocol=None, control_rate=20000.0, adc_bits=0, dac_bits=0)
    raw = replace(
        raw, amplifier_time_constant=0.0, sensor_time_constant=0.0, support_stiffness=0.0, support_damping=0.0
    )
    own = {"bias_current": 1.3 * raw.bias_current}
    e = driven(replace(raw, axes=2, per_axis={"y": own}), raw.gains, 3.0, effect("force_law", 1.5, offset=0.3), 30.0)
    laws = [changed_law(one, 1.5, 0.3) for one in (raw, replace(raw, **own))]
    assert structure_of(e).steeper and structure_of(e).axes == 2
    found, expected = compared(e, laws)
    assert_same(found, expected, 0.02 * raw.gap)


def test_a_replay_that_ends_far_from_the_centre_stands_to_its_end():
    """What drives it ends with the record; that the ball then falls is no matter."""
    e = driven(replace(BALL, clearance=0.8e-3), Gains(600.0, 400.0, 8.0, td=2e-3), 0.1, effect("force_law", 1.0))
    samples = STRETCH // 2
    wave = 0.5e-3 * np.minimum(np.arange(samples) / 1500.0, 1.0)
    still = np.zeros(samples)
    waves = {"force": still, "current": still, "reference": wave}
    held = replayed(prepared([e]), [Drive(e, waves)])[0][0][0, 0]
    assert 0.6e-3 < held[-1] < 0.8e-3
    jump = np.append(wave, np.zeros(STRETCH // 2))
    both = {"force": 0 * jump, "current": 0 * jump, "reference": jump}
    assert np.isnan(replayed(prepared([e]), [Drive(e, both)])[0][0]).all()
