"""Unbalance force rejection: against its equations in x and y, its poles, and what is left of the current."""

from dataclasses import replace

import numpy as np
import pytest
from rotor_state_space import real_loop

from maglev_env.loop.magnets.kinds import force_law
from maglev_env.loop.magnets.law import linearise
from maglev_env.rotor.lanes import Run
from maglev_env.rotor.linear import at_planes, closed_loop_poles, control_matrices, mechanics, unbalance_response
from maglev_env.rotor.parts import Planes, Rejection, Runout
from maglev_env.rotor.rotor import load_rotor
from maglev_env.rotor.run_up import run_up
from maglev_env.rotor.simulate import spin

PUMP = load_rotor("pump")
REJECTING = replace(PUMP, rejection=Rejection())
RATE = PUMP.axis.control_rate


@pytest.mark.parametrize("rpm", [500.0, 3000.0, 14_000.0, -7000.0])
def test_poles_are_those_of_the_real_equations_and_the_notch_decays_at_its_rate(rpm):
    gain, stiffness = linearise(force_law(PUMP.axis))
    expected = np.linalg.eigvals(real_loop(REJECTING, rpm, gain, stiffness).closed()[0])
    found = closed_loop_poles(REJECTING, rpm * np.pi / 30)
    assert found.size == expected.size == 28
    assert max(abs(found[:, None] - expected).min(axis=1)) < 1e-7
    # First order in the rate: as slow as stated, and turning with the rotor.
    s = np.log(found) * RATE
    slow = s[abs(abs(s.imag) - abs(rpm) * np.pi / 30) < 5.0]
    assert slow.size >= 4 and slow.real.max() == pytest.approx(-REJECTING.rejection.rate, rel=0.05)


def test_it_is_off_at_standstill_and_below_its_least_speed():
    assert closed_loop_poles(REJECTING, 0.0).size == closed_loop_poles(REJECTING, 499 * np.pi / 30).size == 24


@pytest.mark.slow
def test_the_current_at_1x_falls_below_a_tenth_at_every_speed_and_the_orbit_is_the_linear_models():
    speeds = np.arange(500.0, 14_001.0, 500.0)
    without, rejecting = run_up([PUMP], speeds), run_up([REJECTING], speeds)
    assert (rejecting.coil_once / without.coil_once).max() < 0.1
    assert without.coil_once[0, -1].min() > 0.2 and not rejecting.touched_down.any()
    # Without a current of its own the rotor turns about its axis of inertia, pulled outward by the magnets alone.
    w = speeds[-1] * np.pi / 30
    m = mechanics(PUMP)
    free = PUMP.unbalance.static / (m.stiffness[0, 0] / w**2 - PUMP.body.mass)
    assert unbalance_response(REJECTING, np.array([w]))[0, 0] == pytest.approx(free, rel=1e-6)
    expected = abs(
        at_planes(*PUMP.planes.probes) @ unbalance_response(REJECTING, np.array([w]))[0]
        + np.array([r * t for r in 0.5e-6 * np.exp(1j * np.radians([0, 120])) for t in (1, -1j)])
    )[::2]
    lag = abs(1 + 1j * w * PUMP.axis.sensor_time_constant)
    assert rejecting.once[0, -1, :2] == pytest.approx(expected / lag, rel=0.03)


def test_a_model_that_is_off_still_rejects():
    heavier = replace(PUMP.body, mass=1.1 * PUMP.body.mass, transverse_inertia=1.1 * PUMP.body.transverse_inertia)
    drawn = replace(REJECTING, body=heavier, known=REJECTING)
    s = np.log(closed_loop_poles(drawn, 300.0)) * RATE
    slow = s[abs(abs(s.imag) - 300.0) < 5.0].real
    own = np.log(closed_loop_poles(replace(drawn, known=None), 300.0)) * RATE
    assert -20 < slow.min() < slow.max() < -5
    assert abs(own.real.max() - s.real.max()) > 0.05  # the model that it is designed by matters


def test_translation_and_tilt_are_decoupled_wherever_the_planes_are():
    uneven = replace(PUMP, planes=Planes(magnets=(-0.02, 0.034), probes=(-0.03, 0.022)))
    into, out = (matrix[::2, ::2] for matrix in control_matrices(uneven))
    m = mechanics(uneven)
    seen = into @ m.probes[::2, :2]
    assert seen == pytest.approx(np.diag([1.0, (0.022 + 0.03) / 2]), abs=1e-15)
    pushed = m.drive[:2, ::2] @ out
    assert pushed == pytest.approx(np.diag(pushed.diagonal()), abs=1e-15)
    assert pushed[0, 0] == pytest.approx(linearise(force_law(PUMP.axis))[0])
    even = (matrix[::2, ::2] for matrix in control_matrices(PUMP))
    for found, expected in zip(even, ([[0.5, 0.5], [-0.5, 0.5]], [[1, -1], [1, 1]]), strict=True):
        assert np.array_equal(found, expected)
    # In the simulation, with the magnets' stiffness, the only coupling, made small, a tilt stays one.
    still = replace(uneven.axis, negative_stiffness=-1e-6, adc_bits=0, dac_bits=0)
    still = replace(still, noise=replace(still.noise, displacement=0.0))
    lone = replace(uneven, axis=still, gravity=(0.0, 0.0, 0.0), runout=Runout())
    start = np.zeros(10)
    start[1] = 1e-4
    ends = [
        abs(spin([Run(replace(lone, planes=p))], 60, start=start).state[0, 0])
        for p in (uneven.planes, replace(uneven.planes, probes=(-0.02, 0.034)))
    ]
    assert ends[0] < 2e-3 * 1e-4 * 0.02 and ends[1] < 2e-3 * 1e-4 * 0.02
