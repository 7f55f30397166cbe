"""The estimator as a linear periodic system, against the kernel: its tracking, its step over a cycle, its statics."""

from dataclasses import replace

import numpy as np
import pytest

from maglev_lanes.layout import LANES, row
from selfsense import kernel_rows as k
from selfsense.coil import Coil
from selfsense.forward_path import AnalogPath, DigitalPath
from selfsense.kernel import CHANNELS, kernel
from selfsense.linear import controller_response, forward_response, linearise, monodromy, stable, tracking
from selfsense.sensor import Estimator, SelfSensor, samples_and_periods, sensor_rows, structure_of
from selfsense.simulate import simulate
from selfsense.supply import Acquisition, Supply

PULL = 600.0  # A/m: amplitude by gap of the coil at half duty
COIL = Coil(turns=90, pole_area=39.27e-6, resistance=2.0)
ESTIMATOR = Estimator(COIL, 24.0, 1.1 / PULL, 1.8e4 / PULL, (0.02e-3, 0.7e-3))
SENSOR = SelfSensor(COIL, Supply(), Acquisition(), ESTIMATOR, 0.35e-3)
ANALOG = replace(SENSOR, estimator=replace(ESTIMATOR, path=AnalogPath(), kp=0.7 / PULL, ki=9e3 / PULL))
NO_EMF = replace(SENSOR, coil=replace(COIL, back_emf=False))
UNLIKE = replace(SENSOR, coil=replace(COIL, turns=88, resistance=6.0, core_length=20e-6))
LOSSY = replace(SENSOR, coil=replace(COIL, resistance=20.0))
MAGNET = replace(SENSOR, coil=replace(COIL, magnet_emf=2.0))
SLOWER = replace(SENSOR, acquisition=Acquisition(rate=165e3))
THREE = replace(SENSOR, supply=Supply(states=3))
LINES = np.array([700.0, 2100, 3400, 4800, 6100, 7300])  # 165 kHz folds none of them onto another


def simulated_tracking(sensor, drive, frequency=LINES, fundamental=100.0, periods=4):
    """Estimate over gap at lines of a small multisine, of its last period, less what no motion gives."""
    rate = sensor.acquisition.rate
    period = round(rate / fundamental)
    time = (np.arange(periods * period) + 1) / rate
    phases = np.random.default_rng(1).uniform(0, 2 * np.pi, len(frequency))
    motion = 1e-7 * np.cos(2 * np.pi * np.outer(time, frequency) + phases).sum(axis=1)
    estimate = simulate([sensor] * 2, sensor.gap + np.stack([motion, 0 * motion]), drive).estimate
    turn = np.exp(-2j * np.pi * np.outer(frequency, time[-period:]))
    return turn @ (estimate[0] - estimate[1])[-period:] / (turn @ motion[-period:])


@pytest.mark.parametrize(
    ("sensor", "drive", "percent", "degrees"),
    [
        (SENSOR, 0.0, 0.02, 0.03),
        (SENSOR, 0.2, 0.02, 0.03),
        (NO_EMF, -0.3, 0.02, 0.03),
        (UNLIKE, 0.0, 0.05, 0.1),
        (LOSSY, 0.1, 0.03, 0.03),
        (MAGNET, 0.3, 0.1, 0.1),
        (SLOWER, 0.0, 0.1, 0.1),
        (ANALOG, 0.0, 0.1, 0.1),
        (ANALOG, 0.2, 0.1, 0.1),
        (THREE, 0.4, 0.02, 0.03),
    ],
    ids=[
        "plain",
        "drive",
        "no emf",
        "unlike coils",
        "lossy",
        "magnet",
        "165 kHz",
        "analog",
        "analog drive",
        "three states",
    ],
)
def test_tracking_is_what_the_kernel_does(sensor, drive, percent, degrees):
    error = tracking(sensor, LINES, drive) / simulated_tracking(sensor, drive)
    np.testing.assert_allclose(100 * np.abs(error), 100, atol=percent)
    np.testing.assert_allclose(np.angle(error, deg=True), 0, atol=degrees)


@pytest.mark.parametrize("sensor", [SENSOR, NO_EMF, ANALOG], ids=["plain", "no emf", "analog"])
def test_the_mean_responses_close_the_loop(sensor):
    """At half duty the PWM's harmonics carry next to nothing around the loop."""
    linear, estimator = linearise(sensor), sensor.estimator
    controller = controller_response(estimator.kp, estimator.ki, 250e3, LINES)
    loop = controller * forward_response(sensor, LINES)
    expected = tracking(sensor, LINES)
    np.testing.assert_allclose(controller * linear.coil(LINES) / (1 + loop), expected, rtol=1e-2)


def kernel_step_over_a_cycle(sensor, drive):
    """Jacobian (n, n) of the kernel's estimator over one cycle, by small changes of its converged state."""
    step = kernel(structure_of(sensor, regulated=False), len(CHANNELS))
    cycle, periods = samples_and_periods(sensor)
    rows = np.ascontiguousarray(sensor_rows([sensor] * LANES))
    settle = 500 * cycle

    def run(n):
        waves = np.full(n * LANES, sensor.gap), np.full(n * LANES, drive), np.empty(len(CHANNELS) * n * LANES)
        step(rows.reshape(-1), np.zeros(LANES, np.uint64), 0, n, periods, cycle, 1, *waves)

    run(settle)
    before = range(4) if sensor.estimator.path.rms else range(2)
    simulated = row(k.SIMULATED)
    states = [row(k.MODEL), *(simulated + i for i in (*before, 4, 5)), row(k.INTEGRAL), row(k.ESTIMATE)]
    small = np.array([1e-7] * (len(states) - 2) + [1e-9] * 2)
    rows[states, range(len(states))] += small
    run(cycle)
    return (rows[states, : len(states)] - rows[states, -1:]) / small


@pytest.mark.parametrize(
    ("sensor", "drive"),
    [(SENSOR, 0.0), (SENSOR, 0.2), (UNLIKE, -0.1), (SLOWER, 0.0), (ANALOG, 0.0), (ANALOG, 0.3), (THREE, 0.5)],
)
def test_monodromy_is_what_the_kernel_does(sensor, drive):
    expected = kernel_step_over_a_cycle(sensor, drive)
    scale = np.abs(expected).max(axis=1, keepdims=True)
    np.testing.assert_allclose(monodromy(sensor, drive) / scale, expected / scale, atol=1e-3)


@pytest.mark.parametrize("sensor", [SENSOR, NO_EMF, UNLIKE, ANALOG], ids=["plain", "no emf", "unlike", "analog"])
@pytest.mark.parametrize("drive", [0.0, 0.23])
def test_static_response_is_the_slope_of_the_simulated_amplitude(sensor, drive):
    gaps = sensor.gap + np.array([[-1e-6], [1e-6]])
    moved = simulate([sensor] * 2, np.repeat(gaps, 5000, axis=1), drive)
    slope = np.diff(moved.amplitude[:, -500:].mean(axis=1))[0] / 2e-6
    assert linearise(sensor, drive).coil(0.0) == pytest.approx(slope, rel=1e-3)
    converged = simulate([sensor], np.full(5000, sensor.gap), drive).estimate[0, -500:].mean()
    assert linearise(sensor, drive).estimate == pytest.approx(converged, rel=3e-4)


def test_finely_sampled_without_losses_it_is_the_ideal_low_pass():
    """Mean of a rectified triangle: V / (8 f L), so V / (4 f K) per gap (D eq 6.20 at half duty, half its height).

    The sidebands of harmonic n of the PWM are integrated by 1 / (n -+ x), x the frequency over the PWM's: the sum over
    the square of the voltage and that of the rectifier's sign is sec(pi x / 2) - 1 over x^2.
    """
    coil = replace(COIL, resistance=0.0)
    estimator = replace(ESTIMATOR, coil=coil, path=DigitalPath(high_pass=100.0))
    rate = 2.05e6  # the ripple's zeros lie between samples
    ideal = SelfSensor(coil, Supply(), Acquisition(rate=rate), estimator, 0.35e-3)
    s, x, static = 1j * LINES / 5e3, LINES / 25e3, 24.0 / (4 * 25e3 * coil.constant)
    expected = static / (1 + np.sqrt(2) * s + s**2) * 8 / np.pi**2 * (1 / np.cos(np.pi * x / 2) - 1) / x**2
    late = np.exp(-1j * np.pi * LINES / rate)  # an estimate holds for the sample after it
    np.testing.assert_allclose(forward_response(ideal, LINES), expected * late, rtol=5e-3)
    assert forward_response(ideal, 0.0) == pytest.approx(static, rel=1e-3)


def test_an_unstable_estimator_is_told():
    assert stable(SENSOR)
    assert not stable(replace(SENSOR, estimator=replace(ESTIMATOR, kp=6 / PULL)))


def test_shapes():
    assert tracking(SENSOR, 1000.0).shape == ()
    assert forward_response(SENSOR, np.ones((2, 3))).shape == (2, 3)
    assert linearise(SENSOR).growth(np.ones((4, 1)) / PULL, np.ones(5) * 1e4 / PULL).shape == (4, 5)


@pytest.mark.parametrize(
    ("sensor", "drive", "told"),
    [
        (SENSOR, 1.0, "does not ripple"),
        (SENSOR, np.nan, "does not ripple"),
        (THREE, 0.0, "not 0"),
        (replace(SENSOR, coil=replace(COIL, resistance=0.0)), 0.1, "without resistance"),
        (replace(SENSOR, estimator=replace(ESTIMATOR, voltage=6.0)), 0.0, "no gap in its range"),
        (replace(SENSOR, estimator=replace(ESTIMATOR, voltage=600.0)), 0.0, "no gap in its range"),
    ],
)
def test_what_cannot_be_linearised_is_refused(sensor, drive, told):
    with pytest.raises(ValueError, match=told):
        linearise(sensor, drive)
