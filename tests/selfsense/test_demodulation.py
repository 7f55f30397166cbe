"""Demodulation against a brute-force ripple, a scipy filter loop, the closed form of its duty error, and simulation."""

import numpy as np
import pytest
from scipy.signal import sosfilt

from selfsense.coil import Coil
from selfsense.demodulation import demodulated_gap, demodulation_error, duty_swing, path_factor, ripple_amplitude
from selfsense.forward_path import AnalogPath, DigitalPath
from selfsense.sensor import Estimator, SelfSensor
from selfsense.simulate import simulate
from selfsense.supply import Acquisition, Supply

GAP = 0.35e-3
COIL = Coil(turns=90, pole_area=39.27e-6, resistance=2.0)


def sensor(coil=COIL, path=None, rate=250e3, supply=None, kp=1 / 600, ki=2.5e4 / 600, believed=None):
    estimator = Estimator(believed or coil, 24.0, kp, ki, (0.02e-3, 0.7e-3), path or DigitalPath())
    return SelfSensor(coil, supply or Supply(), Acquisition(rate), estimator, GAP)


def held(sensors, gaps, drives, time=0.01):
    n = int(time * sensors[0].acquisition.rate)
    gaps, drives = (np.repeat(np.atleast_1d(a)[:, None], n, axis=1) for a in (gaps, drives))
    return simulate(sensors, gaps, drives).amplitude[:, -1000:].mean(axis=1)


@pytest.mark.parametrize("states, drive", [(2, 0.0), (2, 0.3), (2, -0.7), (3, 0.5), (3, -0.2)])
def test_ripple_amplitude_is_the_mean_rectified_ripple(states, drive):
    supply, coil = Supply(24.0, 25e3, states), Coil(90, 39.27e-6, core_length=50e-6)
    phase = (np.arange(100_000) + 0.5) / 100_000
    level = np.where(phase < (1 + drive) / 2, 1.0, -1.0) if states == 2 else np.sign(drive) * (phase < abs(drive))
    current = np.cumsum(24 * (level - level.mean())) / 100_000 / 25e3 / coil.inductance(GAP)
    expected = np.abs(current - current.mean()).mean()
    assert ripple_amplitude(coil, supply, GAP, drive) == pytest.approx(expected, rel=1e-4)


def test_ripple_amplitude_is_half_of_equation_6_20():
    alpha = np.array([0.5, 0.6, 0.9])
    equation = alpha * (1 - alpha) * 24 / 25e3 / COIL.constant * 2 * GAP
    assert np.allclose(ripple_amplitude(COIL, Supply(), GAP, 2 * alpha - 1), equation / 2, rtol=1e-12)


@pytest.mark.parametrize("path", [DigitalPath(), AnalogPath()])
@pytest.mark.parametrize("drive", [0.0, 0.37])
def test_path_factor_is_that_of_the_sampled_filters(path, drive):
    """The coil's exact steps over edges between samples, and its filters run by scipy."""
    rate, per_period, alpha = 250e3, 10, (1 + drive) / 2
    decay = COIL.resistance / COIL.inductance(GAP)
    current, i = np.empty(4000), 0.0
    for n in range(current.size):
        start = n % per_period / per_period
        on = min(max(alpha - start, 0.0), 1 / per_period)
        for level, share in ((24.0, on), (-24.0, 1 / per_period - on)):
            rest = level / COIL.resistance
            i = rest + (i - rest) * np.exp(-decay * share * per_period / rate)
        current[n] = i
    before, behind = (np.insert(s, 3, 1.0, axis=1) for s in path.sections(rate))
    ripple = sosfilt(before, current)
    out = np.sqrt(sosfilt(behind, ripple**2)) if path.rms else sosfilt(behind, np.abs(ripple))
    expected = out[-per_period:].mean() / ripple_amplitude(COIL, Supply(), GAP, drive)
    assert path_factor(sensor(path=path), drive) == pytest.approx(expected, rel=1e-6)


def test_path_factor_of_the_standard_coil():
    assert path_factor(sensor()) == pytest.approx(1.038, abs=5e-4)
    undistorted = DigitalPath(high_pass=1e3, low_pass=5e3)
    assert path_factor(sensor(path=undistorted, rate=2.5e6)) == pytest.approx(1.0, abs=1e-3)


@pytest.mark.parametrize("drive", [0.0, 0.3])
@pytest.mark.parametrize("core_length", [0.0, 80e-6])
def test_demodulation_recovers_the_gap_at_the_duty_assumed(drive, core_length):
    s = sensor(Coil(90, 39.27e-6, 2.0, core_length))
    gaps = np.array([0.2e-3, GAP, 0.5e-3])
    found = demodulated_gap(held([s] * 3, gaps, drive), s, drive)
    assert found[1] == pytest.approx(GAP, rel=1e-9)
    assert np.allclose(found, gaps, rtol=4e-3)  # the resistance bends the ripple differently at another gap


def test_demodulation_knows_the_believed_coil_only():
    """A true coil of 1 % more turns: its ripple is 2 % smaller, and so is the gap read."""
    s = sensor(Coil(90 * 1.01, 39.27e-6, 2.0), believed=COIL)
    assert demodulated_gap(held([s], GAP, 0.0), s)[0] == pytest.approx(GAP / 1.01**2, rel=2e-4)


def test_duty_error_is_the_closed_form_where_the_path_keeps_the_ripples_shape():
    s = sensor(path=DigitalPath(high_pass=1e3), rate=2.5e6, coil=Coil(90, 39.27e-6, core_length=40e-6))
    drives = np.array([0.0, 0.1, 0.2, -0.2, 0.4, 0.8])
    error = demodulated_gap(held([s] * 6, GAP, drives), s) - GAP
    expected = demodulation_error(GAP, s.coil, s.supply, drives)
    assert np.allclose(expected, -(drives**2) * (GAP + 20e-6), rtol=1e-12)
    assert np.allclose(error, expected, atol=1e-3 * GAP)
    three = Supply(states=3)
    assert demodulation_error(GAP, s.coil, three, 0.25, assumed=0.5) == pytest.approx(-0.25 * (GAP + 20e-6))


@pytest.mark.parametrize("motion", [0.0, 50e-6])
def test_a_moving_duty_corrupts_demodulation_ten_times_more_than_the_estimator(motion):
    s = sensor()
    t = (np.arange(7500) + 1) / 250e3
    gap = GAP + motion * np.sin(2 * np.pi * 100 * t)
    sensed = simulate([s], gap, 0.2 * np.cos(2 * np.pi * 100 * t))
    kept = slice(2500, None)  # two cycles of 100 Hz
    estimator, demodulator = (
        np.sqrt(np.mean((g - gap)[kept] ** 2)) for g in (sensed.estimate[0], demodulated_gap(sensed.amplitude[0], s))
    )
    assert demodulator == pytest.approx(10.3e-6, rel=0.05)
    assert demodulator > (10 if motion else 500) * estimator


def test_duty_swing_drives_that_current():
    coil, frequency = Coil(90, 39.27e-6), 500.0
    swing = duty_swing(frequency, coil.inductance(GAP), 2.0, 24.0)
    t = (np.arange(2500) + 1) / 250e3
    current = simulate([sensor(coil)], np.full(2500, GAP), 2 * swing * np.cos(2 * np.pi * frequency * t)).current[0]
    line = 2 * np.abs(np.mean(current * np.exp(-2j * np.pi * frequency * t)))
    assert line == pytest.approx(2.0, rel=2e-3)


def test_what_cannot_be_demodulated_is_refused():
    with pytest.raises(ValueError, match="with 2 states a drive of 1 leaves no ripple"):
        demodulated_gap(np.array([0.2]), sensor(), drive=1)
    with pytest.raises(ValueError, match=r"with 3 states a drive of 0\.0 leaves no ripple"):
        path_factor(sensor(supply=Supply(states=3)))
    with pytest.raises(ValueError, match="a drive of nan"):
        demodulation_error(GAP, COIL, Supply(), 0.1, assumed=np.nan)
    with pytest.raises(ValueError, match=r"swing of 0\.747, outside"):
        duty_swing(1000.0, 0.571e-3, 10.0, 24.0)
