"""The rotor levitated by self-sensing: against the one-axis simulator, its linear loops, and the linear rotor."""

from dataclasses import replace

import numpy as np
import pytest

from maglev_env.experiment import Experiment, recorded_channels, without_noise
from maglev_env.kernel.simulate import simulate_records
from maglev_env.linear.poles import closed_loop_poles as one_axis_poles
from maglev_env.loop.self_sensor import SelfSensing
from maglev_env.rig.excitation import Excitation
from maglev_env.rig.self_sensor import self_sensor
from maglev_env.rotor.identification import identify_runs
from maglev_env.rotor.lanes import Run
from maglev_env.rotor.linear import (
    closed_loop_poles,
    continuous,
    controller_readings,
    mechanics,
    probe_readings,
    reading_response,
    sensitivity,
    unbalance_response,
)  # fmt: skip
from maglev_env.rotor.loop_quantities import linear_quantities
from maglev_env.rotor.parts import Planes, Runout, Unbalance
from maglev_env.rotor.rotor import Rotor, load_rotor
from maglev_env.rotor.run_up import run_up
from maglev_env.rotor.simulate import spin
from selfsense.linear import tracking

PUMP = load_rotor("pump")
SENSED = replace(PUMP, sensor="self_sensing")
FINE = replace(PUMP.axis, adc_bits=0, dac_bits=30, self_sensing=SelfSensing(adc_bits=0))
QUIET = replace(SENSED, axis=replace(FINE, noise=replace(FINE.noise, displacement=0.0, current=0.0)))
STILL = replace(QUIET, gravity=(0.0, 0.0, 0.0), unbalance=Unbalance(), runout=Runout((0.0, 0.0), (0.0, 0.0)))
# Integral gains (m/(A s)) of an estimator with kp = 0, which lags by so many degrees at 150 Hz.
SLOW = {25: 3.375, 30: 2.741}
SOFTER = {"translation": 6000.0, "tilt": 5000.0}


def slow(rotor: Rotor, degrees: int) -> Rotor:
    own = replace(rotor.axis.self_sensing, kp=0.0, ki=SLOW[degrees])
    return replace(rotor, axis=replace(rotor.axis, self_sensing=own))


def decay(rotor: Rotor, rpm: float) -> float:
    """Largest real part of the poles, 1/s."""
    return np.log(abs(closed_loop_poles(rotor, rpm * np.pi / 30)).max()) * rotor.axis.control_rate


def test_pushed_without_turning_it_reads_and_moves_as_the_one_axis_loop_does():
    excitations = (
        Excitation("sphs", "force", 20.0, tuple(range(1, 24, 2)), 0.5),
        Excitation("sphs", "current", 20.0, (2, 6, 10, 20, 40, 60, 80, 100), 0.05),
    )
    rig = replace(STILL.axis, gains=PUMP.gains["translation"])
    e = Experiment(rig, rig.gains, excitations, periods=2, transient_periods=0, sensor="self_sensing")
    e = without_noise(e)
    e = replace(e, rig=replace(e.rig, dac_bits=30))
    one = dict(zip(recorded_channels(e), simulate_records([e])[0], strict=True))
    force = np.zeros((5, e.samples_per_period))
    injection = np.zeros((4, e.samples_per_period))
    force[0], injection[[0, 2]] = e.waveform("force"), e.waveform("current")
    both = spin([Run(STILL)], 2 * e.samples_per_period, injection=injection, force=force)
    a_x, a_y, b_x, b_y = both.readings[0]
    size = np.std(one["displacement"])
    # In y the estimator only settles from its start.
    assert size > 5e-6 and np.abs(a_x - b_x).max() < 1e-6 * size and np.abs([a_y, b_y]).max() < 0.02 * size
    assert np.abs(a_x - one["displacement"]).max() < 1e-6 * size
    assert np.abs(both.channels[0, 13] - one["position"]).max() < 1e-6 * size
    assert np.abs(both.channels[0, 4] - one["current"]).max() < 1e-6 * np.std(one["current"])
    assert both.gap_error[0, 0] == pytest.approx(one["displacement"] - one["position"], abs=1e-6 * size)


@pytest.mark.parametrize("rotor", [SENSED, slow(SENSED, 30)])
def test_poles_of_its_translation_at_rest_are_those_of_the_one_axis_loop(rotor):
    rig = replace(rotor.axis, gains=PUMP.gains["translation"])
    one = one_axis_poles(Experiment(rig, rig.gains, (), sensor="self_sensing"))
    every = closed_loop_poles(rotor)
    away = abs(one[:, None] - every).min(axis=1)
    assert len(one) == 10 and np.all(away[abs(one) > 1e-3] < 1e-6)
    probe = one_axis_poles(Experiment(rig, rig.gains, ()))
    away = abs(probe[:, None] - closed_loop_poles(replace(rotor, sensor="probe"))).min(axis=1)
    assert np.all(away[abs(probe) > 1e-3] < 1e-6)


def test_the_linear_reading_is_the_estimators_tracking():
    f = np.array([10.0, 150.0, 600.0])
    for rotor in (SENSED, slow(SENSED, 30)):
        exact = tracking(rotor.self_sensor, f)
        assert np.abs(reading_response(rotor, f) / exact - 1).max() < 0.02
    assert rotor.self_sensor == self_sensor(rotor.axis)
    assert np.degrees(np.angle(reading_response(rotor, np.array([150.0]))))[0] == pytest.approx(-30, abs=0.1)
    assert continuous(SENSED, 0.0).shape == (14, 18) and continuous(PUMP, 0.0).shape == (8, 12)


def test_it_reads_at_the_coils_and_its_probes_only_watch():
    assert mechanics(SENSED).probes[0, 1] == PUMP.planes.magnets[0]
    uneven = replace(QUIET, planes=Planes((-0.016, 0.034), (-0.03, 0.02)))
    spun = spin([Run(uneven, 6000.0)], 2000, settle=4000)
    probes, magnets = spun.channels[0, :4:2], spun.channels[0, 13:17:2]
    tilt = (magnets[1] - magnets[0]) / 0.05
    at_probes = magnets[0] + np.outer([-0.014, 0.036], tilt)
    seen = probes - probes.mean(axis=1, keepdims=True)
    runout = 2 * max(PUMP.runout.amplitude)
    assert np.abs(seen - (at_probes - at_probes.mean(axis=1, keepdims=True))).max() < runout
    assert np.ptp(probes) > 10 * runout and np.abs(spun.gap_error).max() < 4e-6


@pytest.mark.parametrize("rpm", [4000.0, -9000.0, 14_000.0])
def test_a_small_unbalance_moves_it_as_the_linear_loop_says(rpm):
    small = replace(STILL, unbalance=Unbalance(4.5e-9, 2e-9, 90.0))
    speed = np.array([rpm * np.pi / 30])
    expected = unbalance_response(small, speed)
    n = round(small.axis.control_rate * 60 / abs(rpm) * 20)
    spun = spin([Run(small, rpm)], n, settle=8000)
    turn = np.exp(-1j * speed * np.arange(n) / small.axis.control_rate)
    found = np.abs(2 / n * spun.channels[0] @ turn)
    assert found[:4] == pytest.approx(abs(probe_readings(small, expected, speed))[0], rel=0.01)
    assert found[9:13] == pytest.approx(abs(controller_readings(small, expected, speed))[0], rel=0.01)
    on_probes = abs(probe_readings(PUMP, unbalance_response(replace(small, sensor="probe"), speed), speed))[0]
    assert np.abs(found[:4] / on_probes - 1).max() > 0.03


@pytest.mark.parametrize("rpm", [0.0, 14_000.0])
def test_the_identified_sensitivity_is_that_of_the_linear_loop(rpm):
    found = identify_runs([Run(STILL, rpm)])
    for c, f in enumerate(found.frequency):
        low = f < 1000.0
        model = sensitivity(STILL, f, rpm * np.pi / 30)[low, c, c]
        assert np.abs(found.sensitivity[c][0][low] / model - 1).max() < 0.03
    moved = replace(STILL, planes=Planes(PUMP.planes.magnets, PUMP.planes.magnets), sensor="probe")
    probe = identify_runs([Run(moved, rpm)])
    assert found.stiffness == pytest.approx(probe.stiffness, rel=0.03)
    assert found.damping == pytest.approx(probe.damping, rel=0.1)


def test_it_runs_up_without_touching_down_and_errs_as_one_axis_does():
    up = run_up([SENSED, PUMP], np.array([0.0, 8000.0, 14_000.0]), seed=3)
    assert not up.touched_down.any() and up.peak.max() < 0.15 * PUMP.axis.clearance
    # 1.12 um rms on one axis (test_self_sensing); at speed the lag adds to it.
    assert up.gap_error[0, 0, 0] == pytest.approx(1.12e-6, rel=0.05)
    assert np.all(np.diff(up.gap_error[0, :, 0]) > 0) and up.gap_error[0, 2, 0] < 2.5e-6
    assert abs(up.gap_error[0, :, 1]).max() < 1e-7 and np.isnan(up.gap_error[1]).all()
    again = run_up([SENSED], np.array([14_000.0]), seed=[(3, 2)])
    alone = run_up([PUMP, SENSED], np.array([0.0, 8000.0, 14_000.0]), seed=3)
    assert np.array_equal(alone.peak[1], up.peak[0]) and np.array_equal(alone.peak[0], up.peak[1])
    assert again.peak.shape == (1, 1, 2)


def test_a_lag_of_30_degrees_at_150_hz_drops_it_at_the_nominal_gains_and_not_at_softer_ones():
    late = slow(SENSED, 30)
    softer = {name: replace(g, kp=SOFTER[name]) for name, g in PUMP.gains.items()}
    held = [slow(SENSED, 25), replace(late, gains=softer)]
    speeds = np.array([0.0, 14_000.0])
    assert decay(late, 0.0) > 5 and decay(late, 14_000.0) > 20
    assert all(decay(rotor, v) < -20 for rotor in held for v in speeds)
    assert run_up([late, *held], speeds).touched_down.all(axis=1).tolist() == [True, False, False]


def test_what_it_cannot_do_is_refused():
    with pytest.raises(ValueError, match="sensor = 'coils'; use probe or self_sensing"):
        replace(PUMP, sensor="coils")
    three = SENSED.self_sensor
    with pytest.raises(ValueError, match="two states"):
        replace(PUMP, sensor=replace(three, supply=replace(three.supply, states=3)))
    with pytest.raises(ValueError, match="starts at rest in the centre"):
        spin([Run(SENSED)], 10, start=np.zeros(10))
    with pytest.raises(ValueError, match="record them apart"):
        spin([Run(SENSED), Run(PUMP)], 10)
    with pytest.raises(ValueError, match="on the probes"):
        linear_quantities(SENSED, 0.0, (5.0, 400.0))
    odd = replace(PUMP.axis, control_rate=20_001.3)
    with pytest.raises(ValueError, match="no ratio of whole numbers"):
        spin([Run(replace(SENSED, axis=odd))], 10)
