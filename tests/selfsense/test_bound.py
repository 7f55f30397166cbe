"""The Cramer-Rao bound of a gap against closed forms and a matched filter, and the simulated estimator against it."""

from dataclasses import replace

import numpy as np
import pytest
from scipy import stats

from selfsense.bound import (
    cramer_rao_density,
    cramer_rao_rms,
    forward_path_cost,
    noise_bandwidth,
    noise_sweep,
    ripple_sensitivity,
)
from selfsense.coil import Coil
from selfsense.forward_path import AnalogPath
from selfsense.sensor import Estimator, SelfSensor
from selfsense.simulate import simulate
from selfsense.supply import Acquisition, Supply

COIL = Coil(turns=90, pole_area=39.27e-6, resistance=2.0)
PULL = 600.0  # A/m: of the amplitude by the gap
ESTIMATOR = Estimator(COIL, 24.0, 0.5 / PULL, 2e4 / PULL, (0.02e-3, 0.7e-3))
SENSOR = SelfSensor(COIL, Supply(), Acquisition(noise=0.01), ESTIMATOR, 0.35e-3)
ANALOG = replace(SENSOR, estimator=replace(ESTIMATOR, path=AnalogPath(), kp=0.3 / PULL, ki=1.2e4 / PULL))
WINDOW = 200  # samples


def triangle(drive, samples, rate=250e3):
    """Ripple per gap (A/m) of a coil without resistance: volts over inductance, which falls as 1 / gap."""
    period, alpha = 40e-6, (1 + drive) / 2
    height = 2 * 24.0 * period * alpha * (1 - alpha) * 2 / COIL.constant
    phase = np.arange(1, samples + 1) / rate / period % 1
    return height * np.interp(phase, [0.0, alpha, 1.0], [0.0, 1.0, 0.0])


@pytest.mark.parametrize("drive", [0.0, 0.1, -0.37])
def test_the_ripple_moves_with_the_gap_as_a_triangle_does(drive):
    coil = replace(COIL, resistance=0.01)
    sensor = replace(SENSOR, coil=coil, estimator=replace(ESTIMATOR, coil=coil))
    expected = triangle(drive, 10)
    expected -= expected.mean()
    np.testing.assert_allclose(ripple_sensitivity(sensor, drive), expected, atol=2e-3 * np.abs(expected).max())


@pytest.mark.parametrize("drive", [0.0, 0.3])
def test_density_of_a_finely_sampled_triangle(drive):
    """Mean square of a triangle of height h around its mean: h^2 / 12; white noise of sigma: 2 sigma^2 / rate."""
    sensor = replace(SENSOR, acquisition=Acquisition(rate=5e6, noise=0.01))
    slope = triangle(drive, 200, 5e6).max() / np.sqrt(12)
    assert cramer_rao_density(sensor, drive) == pytest.approx(0.01 * np.sqrt(2 / 5e6) / slope, rel=5e-3)


def matched_gaps(sensor, windows, seed):
    """Least-squares gap (m) per window of readings: ripple, mean and slope, the ripple's shape from its closed form."""
    lanes, settle = 16, 10 * WINDOW
    gap = np.full(settle + WINDOW * windows // lanes, sensor.gap)
    noisy = simulate([sensor] * lanes, gap, seed=seed).current[:, settle:].reshape(windows, WINDOW)
    regressors = np.stack([triangle(0.0, WINDOW), np.ones(WINDOW), np.linspace(-1, 1, WINDOW)], axis=1)
    return np.linalg.lstsq(regressors, noisy.T)[0][0]


@pytest.mark.parametrize("acquisition", [Acquisition(noise=0.01), Acquisition(noise=0.01, bits=10)])
def test_the_matched_estimator_reaches_the_bound(acquisition):
    sensor = replace(SENSOR, acquisition=acquisition)
    windows = 4000
    gaps = matched_gaps(sensor, windows, seed=5)
    # A mean over T seconds has a noise bandwidth of 1 / (2 T).
    bound = cramer_rao_rms(sensor, 250e3 / WINDOW / 2)
    assert gaps.std() / bound == pytest.approx(1, abs=3 / np.sqrt(2 * windows))
    # The resistance bends the triangle by 0.1 %.
    assert gaps.mean() == pytest.approx(sensor.gap, rel=2e-3)


def quantised_information(noise):
    """Fisher information of a level (in counts) of normal noise (counts) from its rounded reading, over all levels."""
    edges = np.arange(-30, 31) + 0.5
    levels = np.linspace(-0.5, 0.5, 201)[:-1]
    z = (edges - levels[:, None]) / noise
    share, slope = np.diff(stats.norm.cdf(z)), -np.diff(stats.norm.pdf(z)) / noise
    held = share > 1e-200
    return (np.where(held, slope, 0) ** 2 / np.where(held, share, 1)).sum(axis=1).mean()


def test_half_a_count_of_noise_makes_the_count_a_noise():
    for noise, low, high in ((2.0, 0.999, 1.001), (0.5, 0.98, 1.02), (0.1, 1.5, np.inf)):
        acquisition = Acquisition(bits=10, noise=noise * Acquisition(bits=10).resolution)
        taken = acquisition.reading_noise / acquisition.resolution
        assert low < quantised_information(noise) * taken**2 < high


@pytest.mark.parametrize(("sensor", "drive"), [(SENSOR, 0.0), (SENSOR, 0.2), (ANALOG, 0.0)])
def test_noise_bandwidth_is_that_of_the_simulated_tracking(sensor, drive):
    """By a multisine, of a coil without the motion's voltage: it carries what the gap does to the ripple alone."""
    rate, period = 250e3, 2500
    quiet = replace(sensor, acquisition=Acquisition(), coil=replace(COIL, back_emf=drive == 0))
    lines = np.arange(1, period // 20)
    phases = np.random.default_rng(1).uniform(0, 2 * np.pi, lines.size)
    angle = 2 * np.pi * lines[:, None] * np.arange(1, 4 * period + 1) / period + phases[:, None]
    gap = sensor.gap + 0.5e-6 * np.cos(angle).sum(axis=0) / np.sqrt(lines.size)
    estimate = simulate([quiet], gap, drive).estimate[0]
    out, into = (np.fft.rfft(x[-period:])[lines] for x in (estimate, gap))
    measured = np.sum(np.abs(out / into) ** 2) * rate / period
    assert noise_bandwidth(sensor, drive) == pytest.approx(measured, rel=0.05)


def test_a_standing_current_adds_no_noise_bandwidth():
    """At 7 A the motion itself leaks through the high-pass; the noise of the estimate knows nothing of it."""
    drive = 0.6
    (point,) = noise_sweep(SENSOR, [0], [0.001], drive, amplitude=0.0, seeds=16)
    assert point.ratio == pytest.approx(forward_path_cost(SENSOR, drive), rel=0.04)


@pytest.mark.parametrize(("sensor", "cost"), [(SENSOR, 1.098), (ANALOG, 1.013)])
def test_the_estimator_stays_above_the_bound_by_the_cost_of_its_forward_path(sensor, cost):
    assert forward_path_cost(sensor) == pytest.approx(cost, abs=2e-3)
    for point in noise_sweep(sensor, [0, 14], [0.001, 0.01], seeds=16):
        assert point.ratio == pytest.approx(cost, rel=0.04)
        assert abs(point.bias) < 0.1 * point.rms


def test_a_rectifier_costs_two_over_root_three():
    """Without filters in the way (a fast rate, a low corner) the triangle is weighed by a square wave."""
    path = replace(ESTIMATOR.path, high_pass=300.0)
    sensor = replace(SENSOR, acquisition=Acquisition(rate=5e6), estimator=replace(ESTIMATOR, path=path))
    assert forward_path_cost(sensor) == pytest.approx(2 / np.sqrt(3), rel=5e-3)


@pytest.mark.slow
@pytest.mark.parametrize("drive", [0.0, 0.1])
def test_within_twice_the_bound_at_every_noise_and_from_eight_bits_on(drive):
    points = noise_sweep(SENSOR, [8, 10, 12, 16], [0.0, 1e-3, 1e-2, 1e-1], drive)
    assert len(points) == 16
    for point in points:
        assert 0.8 < point.ratio <= 2.0
        assert point.total > point.rms * 0.95
        assert point.demodulator < 1.1 * point.rms


def test_six_bits_are_too_few():
    """A count is a fifth of the ripple: its error comes back every PWM period and is no white noise."""
    coarse, dithered = noise_sweep(SENSOR, [6], [0.0, 0.05])
    assert coarse.ratio > 2.5
    assert dithered.ratio < 1.5


def test_a_gap_that_moves_further_lags_further_behind():
    """What the estimate misses beside its noise is the lag along the sine, which grows as its amplitude does."""
    points = [noise_sweep(SENSOR, [0], [1e-3], amplitude=size, seeds=1)[0] for size in (50e-6, 100e-6)]
    near, far = (np.sqrt(point.total**2 - point.rms**2) for point in points)
    assert far == pytest.approx(2 * near, rel=0.02) and near > 0.5e-6


def test_bad_input():
    with pytest.raises(ValueError, match="drive = 0"):
        cramer_rao_density(replace(SENSOR, supply=Supply(states=3)))
    with pytest.raises(ValueError, match="noise_bandwidth"):
        cramer_rao_rms(SENSOR, 0.0)
    with pytest.raises(ValueError, match="ideal reading"):
        noise_sweep(SENSOR, [0, 8], [0.0, 0.01])
    with pytest.raises(ValueError, match="seeds"):
        noise_sweep(SENSOR, [0], [0.01], seeds=0)
    with pytest.raises(ValueError, match="frequency"):
        noise_sweep(SENSOR, [0], [0.01], frequency=0.0)
    with pytest.raises(ValueError, match="bits"):
        noise_sweep(SENSOR, [2], [0.01])
    with pytest.raises(ValueError, match="unstable"):
        noise_bandwidth(replace(SENSOR, estimator=replace(ESTIMATOR, ki=4e5 / PULL)))
