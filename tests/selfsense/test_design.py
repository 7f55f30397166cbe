"""Gains for the estimator: margins against the open loop, the best of them against brute force and the simulation."""

from dataclasses import replace

import numpy as np
import pytest

from selfsense.coil import Coil
from selfsense.design import assess, design_pi, pi_gains, trade_off, with_gains
from selfsense.forward_path import AnalogPath
from selfsense.linear import controller_response, forward_response, linearise, tracking
from selfsense.sensor import Estimator, SelfSensor
from selfsense.simulate import simulate
from selfsense.supply import Acquisition, Supply

COIL = Coil(turns=90, pole_area=39.27e-6, resistance=2.0)
SENSOR = SelfSensor(COIL, Supply(), Acquisition(), Estimator(COIL, 24.0, 0.0, 0.0, (0.02e-3, 0.7e-3)), 0.35e-3)
ANALOG = replace(SENSOR, estimator=replace(SENSOR.estimator, path=AnalogPath()))
SLOWER = replace(SENSOR, acquisition=Acquisition(rate=165e3))
DECIBEL = np.log(10) / 20


@pytest.mark.parametrize("sensor", [SENSOR, ANALOG, SLOWER], ids=["digital", "analog", "165 kHz"])
@pytest.mark.parametrize(("crossover", "margin"), [(2500.0, 60.0), (3000.0, 70.0), (2000.0, 83.0)])
def test_the_loop_crosses_with_the_margin_asked_for(sensor, crossover, margin):
    kp, ki = pi_gains(sensor, crossover, margin)
    loop = controller_response(kp, ki, sensor.acquisition.rate, crossover) * forward_response(sensor, crossover)
    assert loop == pytest.approx(-np.exp(1j * np.radians(margin)), abs=1e-9)
    found = assess(with_gains(sensor, kp, ki))
    assert found.crossover == pytest.approx(crossover, rel=1e-4)
    assert found.phase_margin == pytest.approx(margin, abs=0.01)


@pytest.mark.parametrize(("crossover", "move"), [(500.0, "raise"), (9000.0, "lower"), (60e3, "lower")])
def test_a_phase_that_no_pi_has_is_refused(crossover, move):
    with pytest.raises(ValueError, match=f"a PI has -90 to 0: {move} the crossover"):
        pi_gains(SENSOR, crossover, 60.0)


def test_a_crossover_above_half_the_rate_is_refused():
    with pytest.raises(ValueError, match="below half of the 250000 Hz"):
        pi_gains(SENSOR, 130e3, 60.0)


def test_the_gain_margin_is_where_the_loop_becomes_unstable():
    found = design_pi(SENSOR)
    for factor, holds in ((0.97, True), (1.03, False)):
        gains = np.array([found.kp, found.ki]) * found.gain_margin * factor
        assert (linearise(SENSOR).growth(*gains) < 1) == holds


@pytest.mark.parametrize(
    ("sensor", "lag", "droop"), [(SENSOR, 50.0, 1.0), (SENSOR, 30.0, 2.5), (ANALOG, 65.0, 1.5), (SLOWER, 40.0, 2.0)]
)
def test_the_simulated_estimate_keeps_what_the_design_says(sensor, lag, droop):
    found = design_pi(sensor, lag, droop=droop)
    rate = sensor.acquisition.rate
    frequency = np.array([1000.0, 2000.0, 3000.0, 4000.0, round(found.bandwidth, -2)]) + np.array([0, 0, 100, 0, 0])
    time = (np.arange(round(0.03 * rate)) + 1) / rate
    motion = 1e-7 * np.cos(2 * np.pi * np.outer(time, frequency) + np.arange(5.0) ** 2).sum(axis=1)
    gaps = sensor.gap + np.stack([motion, 0 * motion])
    estimate = simulate([with_gains(sensor, found.kp, found.ki)] * 2, gaps).estimate
    turn = np.exp(-2j * np.pi * np.outer(frequency, time[-round(0.01 * rate) :]))
    seen = turn @ (estimate[0] - estimate[1])[-turn.shape[1] :] / (turn @ motion[-turn.shape[1] :])
    assert -np.angle(seen[3], deg=True) == pytest.approx(lag, abs=0.3)
    assert np.log(np.abs(seen[:4])).min() > -droop * DECIBEL - 0.01
    # Bandwidth is rounded to a line of the record.
    assert np.log(np.abs(seen[4])) == pytest.approx(-3 * DECIBEL, abs=0.03)
    assert np.log(np.abs(seen)).max() < np.log(found.peak) + 0.01


@pytest.mark.parametrize(("sensor", "lag", "droop"), [(SENSOR, 50.0, 1.0), (ANALOG, 65.0, 1.5)])
def test_no_other_gains_have_more_margin(sensor, lag, droop):
    """Brute force over the plane of gains around those found."""
    found, linear = design_pi(sensor, lag, droop=droop), linearise(sensor)
    spread = np.geomspace(0.3, 2, 81)
    kp, ki = (a.ravel()[:, None] for a in np.meshgrid(found.kp * spread, found.ki * spread))
    f, inside = np.geomspace(200, 2e4, 400), np.linspace(50, 4000, 80)
    loop = controller_response(kp, ki, linear.rate, f) * linear.forward(f)
    crossed = (np.abs(loop) < 1).argmax(axis=1)
    margin = 180 + np.degrees(np.unwrap(np.angle(loop), axis=1))[np.arange(len(kp)), crossed]
    controller = controller_response(kp, ki, linear.rate, inside)
    seen = controller * linear.coil(inside) / (1 + controller * linear.forward(inside))
    kept = (-np.degrees(np.angle(seen[:, -1])) <= lag) & (np.abs(seen).min(axis=1) > np.exp(-droop * DECIBEL))
    assert kept.any()
    assert margin[kept].max() < found.phase_margin + 0.2
    assert margin[kept].max() > found.phase_margin - 4


def test_figures_of_a_design():
    found = design_pi(SENSOR)
    sensor = with_gains(SENSOR, found.kp, found.ki)
    frequency = np.arange(1.0, 125e3, 20)
    size = np.abs(tracking(sensor, frequency))
    assert found.peak == pytest.approx(size.max(), rel=5e-3)
    assert found.noise_bandwidth == pytest.approx((size**2).sum() * 20, rel=5e-3)
    assert found.bandwidth == pytest.approx(frequency[size < 10 ** (-3 / 20)][0], rel=5e-3)
    assert assess(sensor) == found


def test_less_lag_costs_margin_peak_and_noise():
    table = trade_off(SENSOR, droop=2.9)
    assert np.all(np.diff(table.lag) > 0)
    assert np.all(np.diff(table.noise_bandwidth) < 0)
    assert np.all(np.diff(table.peak) < 1e-3)
    # The low-pass alone would allow 20 degrees at 54 of margin; high-pass and sample delay leave them at 26.
    assert design_pi(SENSOR, 20.0, droop=2.9).phase_margin == pytest.approx(25.5, abs=0.5)
    assert trade_off(SENSOR, [83.0], droop=2.9).lag == pytest.approx(57, abs=1)


def test_trade_off_and_design_agree():
    found = design_pi(SENSOR, 45.0)
    row = trade_off(SENSOR, [found.phase_margin])
    assert row.lag == pytest.approx(45.0, abs=0.05)
    assert row.kp == pytest.approx(found.kp, rel=1e-3)


def test_a_margin_that_nothing_reaches_is_nan():
    table = trade_off(SENSOR, [60.0, 85.0])
    assert np.isfinite(table.lag[0]) and np.isnan(table.lag[1])
    np.testing.assert_array_equal(table.phase_margin, [60.0, 85.0])


def test_three_states_take_twice_the_gain():
    """At half duty their ripple is half as high."""
    two, three = design_pi(SENSOR), design_pi(replace(SENSOR, supply=Supply(states=3)))
    assert three.kp == pytest.approx(2 * two.kp, rel=1e-3)
    assert three.lag == pytest.approx(two.lag, abs=0.01)


@pytest.mark.parametrize(
    ("arguments", "told"),
    [
        ({"lag": 10.0}, "at best it lags 1[0-9] degrees"),
        ({"at": 20e3}, "no PI gains"),
        ({"at": 130e3}, "below half of the 250000 Hz"),
        ({"lag": -5.0}, "lag = -5"),
        ({"droop": 3.5}, "droop = 3.5 dB"),
    ],
)
def test_what_no_gains_reach_is_refused(arguments, told):
    with pytest.raises(ValueError, match=told):
        design_pi(SENSOR, **arguments)


def test_unstable_gains_are_not_assessed():
    with pytest.raises(ValueError, match="not stable"):
        assess(with_gains(SENSOR, 6 / 600, 0.0))
