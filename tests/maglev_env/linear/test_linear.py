"""The analytic sampled loop against python-control and against itself."""

from dataclasses import replace

import control as ct
import numpy as np
import pytest
from control_loops import DT, control_loop

from maglev_env.experiment import protocol_experiment
from maglev_env.linear.expected import expected_statistics
from maglev_env.linear.loop import loop_response
from maglev_env.linear.plant import discrete_plant
from maglev_env.linear.poles import closed_loop_poles, pole_radii
from maglev_env.loop.effect import effect
from maglev_env.loop.gains import Gains
from maglev_env.rig.rig import axis_rig
from maglev_env.rig.rig_file import load_rig


@pytest.mark.parametrize("name", ["hmb_free", "hmb_radial"])
def test_loop_gain_is_what_python_control_discretises(name):
    e = protocol_experiment(axis_rig(load_rig(name), 0))
    f = np.array([1.0, 10.0, 66.0, 110.0, 700.0, 2000.0, 9000.0])
    expected = ct.frequency_response(control_loop(e), 2 * np.pi * f).complex
    np.testing.assert_allclose(loop_response(e, f).loop_gain, expected.ravel(), rtol=1e-7)


def test_poles_are_the_roots_of_the_closed_loop():
    e = protocol_experiment(load_rig("hmb_free"))
    closed = ct.feedback(control_loop(e), 1)
    expected = np.sort(np.abs(closed.poles()))
    np.testing.assert_allclose(np.sort(np.abs(closed_loop_poles(e)))[-expected.size :], expected, atol=1e-7)
    # In continuous time the right-most pole is at -43 1/s.
    assert np.log(expected.max()) / DT == pytest.approx(-42.8, abs=0.5)


def test_radii_of_many_are_those_of_each():
    rig, other = load_rig("hmb_free"), replace(load_rig("hmb_free"), mass=0.1)
    effects = ({}, effect("delay", 75e-6), effect("eddy_current", 1400.0), effect("eddy_current", 900.0))
    many = [
        protocol_experiment(r, replace(rig.gains, kd=kd), e) for r in (rig, other) for e in effects for kd in (4, 6)
    ]
    each = [np.abs(closed_loop_poles(e)).max() for e in many]
    np.testing.assert_array_equal(pole_radii(many), each)
    assert len(set(each)) == len(many)


def test_the_published_gains_levitate_with_the_measured_gain_and_not_with_the_theoretical_one():
    e = protocol_experiment(load_rig("hmb_free"))
    assert np.abs(closed_loop_poles(e)).max() < 1
    # In continuous time the right-most pole is at +116 1/s; sampling and the probe make it a little slower.
    weak = replace(e, effects=effect("actuator_gain", 1.281 / 5.7 - 1))
    assert np.log(np.abs(closed_loop_poles(weak)).max()) / DT == pytest.approx(108.7, abs=0.5)


@pytest.mark.parametrize("samples", [0.37, 1.0, 1.5, 3.25])
def test_a_delay_is_its_phase_and_moves_the_poles_consistently(samples):
    e = protocol_experiment(load_rig("hmb_free"))
    late = replace(e, effects=effect("delay", samples * DT))
    f = np.array([5.0, 100.0, 400.0])
    ratio = loop_response(late, f).plant / loop_response(e, f).plant
    if samples == int(samples):
        np.testing.assert_allclose(ratio, np.exp(-2j * np.pi * f * samples * DT), rtol=1e-12)
    else:
        np.testing.assert_allclose(ratio, np.exp(-2j * np.pi * f * samples * DT), rtol=2e-3)
    # Nyquist at the poles: 1 + L(z) vanishes there.
    z = closed_loop_poles(late)
    slow = z[np.argmax(np.abs(z) * (np.abs(z.imag) > 1e-6))]
    a, _, b_old, b_new, c, _ = discrete_plant(late)
    g, whole = e.gains, int(np.floor(samples + 1e-9))
    pid = g.kp + g.kd / g.td * (slow - 1) / (slow - np.exp(-DT / g.td))
    pid += g.ki * (1 - np.exp(-DT / g.ti)) / (slow - np.exp(-DT / g.ti))
    plant = c @ np.linalg.solve(slow * np.eye(len(a)) - a, slow**-whole * (b_new + b_old / slow))
    assert abs(1 + pid * plant) < 1e-6


def test_support_alone_gives_the_textbook_receptance():
    rig = load_rig("pedestal")
    f = np.array([10.0, 65.6, 90.0])
    e = protocol_experiment(rig, Gains(0.0, 0.0, 0.0))
    w = 2 * np.pi * f
    continuous = 1 / (rig.support_stiffness - rig.mass * w**2 + 1j * w * rig.support_damping)
    hold = np.sinc(f * DT) * np.exp(-1j * np.pi * f * DT)
    # Aliases of the held force add the rest, (f / rate)^2 of it.
    np.testing.assert_allclose(loop_response(e, f).receptance, continuous * hold, rtol=3e-4)


@pytest.mark.parametrize("name", ["hmb_free", "hmb_radial"])
def test_a_measured_force_has_its_own_noise_alone(name):
    """White noise over n samples has the power 4 sigma^2 / n at a line, and the mean of P periods a P-th of it."""
    e = protocol_experiment(load_rig(name))
    s = expected_statistics(e, np.array([7, 40, 300]))
    for channel in (c for c in s.channels if c.startswith("force")):
        for other in s.channels:
            expected = 4 * e.rig.noise.force**2 / (e.samples_per_period * e.periods) if other == channel else 0.0
            assert s.cross(channel, other) == pytest.approx(np.full(3, expected), rel=1e-12, abs=1e-30)
