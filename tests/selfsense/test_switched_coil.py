"""The lane kernel as an instrument: the estimator against a plain loop and theory, its lanes, noise and converter."""

from dataclasses import replace
from importlib import import_module

import numpy as np
import pytest
from reference_coil import reference_estimate

from selfsense.coil import Coil
from selfsense.forward_path import AnalogPath, DigitalPath
from selfsense.sensor import Estimator, SelfSensor, largest_gap
from selfsense.simulate import simulate
from selfsense.supply import Acquisition, Supply

COIL = Coil(turns=90, pole_area=39.27e-6, resistance=2.0)
GAP = 0.35e-3
ESTIMATOR = Estimator(COIL, 24.0, 0.5 / 600, 1e4 / 600, (0.02e-3, 0.7e-3))
SENSOR = SelfSensor(COIL, Supply(), Acquisition(), ESTIMATOR, GAP)
TIME = np.arange(1, 4001) / 250e3
MOVING = GAP + 100e-6 * np.sin(2 * np.pi * 150 * TIME)
SWING = 0.3 * np.sin(2 * np.pi * 200 * TIME)


def with_path(path):
    return replace(SENSOR, estimator=replace(ESTIMATOR, path=path))


@pytest.mark.parametrize("path", [DigitalPath(), AnalogPath()])
def test_estimator_equals_a_plain_loop(path):
    """On its own readings, from a start where the inductors differ, along a gap that runs into the end of the range."""
    sensor = with_path(path)
    sensor = replace(sensor, estimator=replace(sensor.estimator, gap_range=(0.02e-3, 0.43e-3)))
    sensed = simulate([sensor], MOVING, SWING)
    estimate, amplitude = reference_estimate(sensor, sensed.current[0], sensed.switching[0])
    assert 50 < (estimate == 0.43e-3).sum() < 2000
    np.testing.assert_allclose(sensed.estimate[0], estimate, rtol=1e-10)
    np.testing.assert_allclose(sensed.amplitude[0], amplitude, rtol=1e-10, atol=1e-13)
    np.testing.assert_allclose(sensed.time, TIME, rtol=1e-12)


@pytest.mark.parametrize(("path", "error"), [(DigitalPath(), 0.2e-6), (AnalogPath(), 0.3e-6)])
def test_converges_to_the_gap_whatever_the_duty(path, error):
    """What stays is the simulated inductor's resistance at the mean voltage of a sample: nothing with edges on samples.
    Demodulation alone would be off by 9 % of the gap at a duty of 0.35."""
    gaps, duties = np.meshgrid([0.1e-3, 0.2e-3, 0.35e-3, 0.6e-3], [0.35, 0.42, 0.5, 0.65])
    gap, drive = np.tile(gaps.reshape(-1, 1), 6000), np.tile(2 * duties.reshape(-1, 1) - 1, 6000)
    estimate = simulate([with_path(path)] * 16, gap, drive).estimate[:, -1000:]
    found = np.abs(estimate.mean(axis=1) - gap[:, 0])
    assert found.max() < error
    assert found[duties.ravel() == 0.5].max() < 1e-10
    assert estimate.std(axis=1).max() < 1e-8


def test_wrong_supply_and_coil_scale_the_gap():
    """Same ripple, V/L alike: gap_hat = (V / V_m)(K_m / K)(gap + core / 2) - core_m / 2, without resistance."""
    coil = Coil(90, 39.27e-6, core_length=2e-5)
    believed = Coil(88, 39.27e-6, core_length=3e-5)
    estimator = replace(ESTIMATOR, coil=believed, voltage=25.0)
    gaps = np.array([0.2e-3, 0.35e-3, 0.5e-3])
    sensors = [replace(SENSOR, coil=coil, estimator=estimator, gap=gap) for gap in gaps]
    expected = 24 / 25 * (88 / 90) ** 2 * (gaps + 1e-5) - 1.5e-5
    for drive in (0.0, 0.2):
        estimate = simulate(sensors, np.repeat(gaps[:, None], 8000, axis=1), drive).estimate[:, -1]
        np.testing.assert_allclose(estimate, expected, atol=1e-12)
    assert np.abs(expected - gaps).min() > 20e-6


def test_estimate_is_clipped_to_its_range_and_comes_back():
    sensor = replace(SENSOR, estimator=replace(ESTIMATOR, gap_range=(0.25e-3, 0.5e-3)))
    gap = np.repeat([0.35e-3, 0.6e-3, 0.35e-3, 0.15e-3, 0.35e-3], 4000)
    ends = simulate([sensor], gap).estimate[0].reshape(5, 4000)[:, -1]
    np.testing.assert_allclose(ends, [0.35e-3, 0.5e-3, 0.35e-3, 0.25e-3, 0.35e-3], atol=1e-9)


def test_switching_is_the_mean_voltage_since_the_sample_before():
    for states, drive in ((2, 0.37), (2, -0.1), (3, 0.37), (3, -0.1)):
        sensor = replace(SENSOR, supply=Supply(states=states))
        switching = simulate([sensor], np.full(100, GAP), drive).switching[0].reshape(10, 10)
        assert switching.mean(axis=1) == pytest.approx(drive)
        assert set(np.unique(np.round(switching, 9))) <= {-1, 0, 1, *np.round(switching[0], 9)}
        assert np.isin(np.round(switching, 9), [-1, 0, 1]).mean() >= 0.9


def various(n, rng):
    """Sensors of several structures, no two alike."""
    changes = [
        {},
        {"coil": replace(COIL, back_emf=False)},
        {"supply": Supply(states=3)},
        {"acquisition": Acquisition(noise=0.01)},
        {"estimator": replace(ESTIMATOR, path=AnalogPath())},
    ]
    picked = [replace(SENSOR, **changes[i % len(changes)]) for i in range(n)]
    return [replace(s, coil=replace(s.coil, resistance=1 + rng.random())) for s in picked]


def test_a_sensor_reads_the_same_bits_in_any_company():
    rng = np.random.default_rng(1)
    sensors = various(33, rng)
    gap, drive = rng.uniform(0.8, 1.2, (33, 1)) * MOVING[:2100], rng.uniform(-1, 1, (33, 1)) * SWING[:2100]
    whole = simulate(sensors, gap, drive, seed=4)
    first = simulate(sensors[:3], gap[:3], drive[:3], seed=4)
    for name in ("estimate", "amplitude", "current", "switching"):
        np.testing.assert_array_equal(getattr(first, name), getattr(whole, name)[:3], err_msg=name)
    assert len(np.unique(whole.estimate[:, -1])) == 33
    for i in (0, 1, 2, 4, 16, 32):  # a sensor without noise, wherever it stands
        alone = simulate(sensors[i : i + 1], gap[i], drive[i])
        np.testing.assert_array_equal(alone.estimate[0], whole.estimate[i])
        np.testing.assert_array_equal(alone.current[0], whole.current[i])


def test_noise_is_white_and_belongs_to_seed_and_position():
    noisy = replace(SENSOR, acquisition=Acquisition(noise=0.02))
    gap = np.full(40_000, GAP)
    quiet = simulate([SENSOR], gap).current
    runs = [simulate([noisy, noisy], gap, seed=seed).current - quiet for seed in (7, 7, 8)]
    np.testing.assert_array_equal(runs[0], runs[1])
    different = np.array([runs[0][0], runs[0][1], runs[2][0]])
    correlation = np.corrcoef(np.concatenate([different, different[:, ::-1]]))
    assert np.abs(correlation[np.triu_indices(6, 1)]).max() < 5 / np.sqrt(40_000)
    assert different.std(axis=1) == pytest.approx([0.02] * 3, rel=5 / np.sqrt(80_000))
    lagged = [np.mean(d[1:] * d[:-1]) / 0.02**2 for d in different]
    assert np.abs(lagged).max() < 5 / np.sqrt(40_000)


def test_converter_rounds_to_its_counts_and_clips_at_its_range():
    acquisition = Acquisition(bits=8, current_range=1.0)
    drive = np.repeat([0.0, 0.3, -0.3], 1000)
    clean, read = simulate([SENSOR, replace(SENSOR, acquisition=acquisition)], np.full(3000, GAP), drive).current
    assert acquisition.resolution == 2 / 256
    expected = np.clip(np.rint(clean * 128), -128, 127) / 128
    np.testing.assert_allclose(read, expected, atol=1e-12)
    assert read.max() == 127 / 128 and read.min() == -1.0 and (np.abs(clean) < 0.9).sum() > 1000


@pytest.mark.parametrize("rate", [250e3, 165e3])
def test_decimation_chunks_and_length_change_no_bit(monkeypatch, rate):
    sensor = replace(SENSOR, acquisition=Acquisition(rate))
    whole = simulate([sensor], MOVING, SWING)
    every = simulate([sensor], MOVING, SWING, every=10)
    short = simulate([sensor], MOVING[:2345], SWING[:2345])
    monkeypatch.setattr(import_module("selfsense.simulate"), "CHUNK", 170)
    chunks = simulate([sensor], MOVING, SWING)
    for name in ("estimate", "amplitude", "current", "switching"):
        full = getattr(whole, name)
        np.testing.assert_array_equal(getattr(every, name), full[:, 9::10], err_msg=name)
        np.testing.assert_array_equal(getattr(short, name), full[:, :2345], err_msg=name)
        np.testing.assert_array_equal(getattr(chunks, name), full, err_msg=name)
    np.testing.assert_allclose(every.time, whole.time[9::10], rtol=1e-12)


def nothing(gap, drive=0.0, **options):
    return lambda: simulate([SENSOR], gap, drive, **options)


STILL = np.full(100, GAP)
BAD = [
    (lambda: replace(SENSOR.supply, voltage=0), "supply: voltage = 0 must be a positive number"),
    (lambda: replace(SENSOR.supply, voltage="24"), "supply: voltage = '24' must be a positive number"),
    (lambda: Supply(frequency=float("inf")), "supply: frequency = inf must be a positive number"),
    (lambda: Supply(states=4), "supply: states = 4; use 2 or 3"),
    (lambda: Supply(dead_time=1e-5), "supply: dead_time = 1e-05 must be in 0 .. a quarter of the PWM period, 1e-05 s"),
    (lambda: Supply(dead_time=float("nan")), "supply: dead_time = nan must be"),
    (lambda: Acquisition(rate=-1.0), "acquisition: rate = -1.0 Hz must be a positive number"),
    (lambda: Acquisition(bits=3), "acquisition: bits = 3; use 4 to 24, or 0"),
    (lambda: Acquisition(bits=12.0), "acquisition: bits = 12.0; use 4 to 24, or 0"),
    (lambda: Acquisition(current_range=0), "acquisition: current_range = 0 A must be a positive number"),
    (lambda: Acquisition(noise=None), "acquisition: noise = None A must be at least 0"),
    (lambda: replace(ESTIMATOR, voltage=0.0), "estimator: voltage = 0.0 V must be a positive number"),
    (lambda: replace(ESTIMATOR, kp=-1e-4), "estimator: kp = -0.0001 must be a number of at least 0"),
    (lambda: replace(ESTIMATOR, ki="fast"), "estimator: ki = 'fast' must be a number of at least 0"),
    (lambda: replace(ESTIMATOR, gap_range=(7e-4, 1e-4)), "gap_range = .* must be two rising gaps above 0"),
    (lambda: replace(ESTIMATOR, gap_range=(0.0, 7e-4)), "gap_range = .* must be two rising gaps above 0"),
    (lambda: replace(ESTIMATOR, gap_range=(1e-4, 2e-4, 7e-4)), "gap_range = .* must be two rising gaps above 0"),
    (lambda: replace(ESTIMATOR, gap_range=7e-4), "gap_range = 0.0007 m must be two rising gaps above 0"),
    (lambda: replace(ESTIMATOR, path="digital"), "estimator: path = 'digital'; use a DigitalPath or an AnalogPath"),
    (
        lambda: replace(ESTIMATOR, coil=replace(COIL, core_length=1e-5, lamination=1e-4)),
        "simulated inductor knows no eddy currents and no saturation; leave them out",
    ),
    (lambda: replace(SENSOR, gap=1e-3), "self-sensor: gap = 0.001 m is not inside the estimator's 2e-05 .. 0.0007 m"),
    (lambda: replace(SENSOR, scale=float("nan")), "self-sensor: scale = nan is not a finite number"),
    (lambda: replace(SENSOR, acquisition=Acquisition(40e3)), "below twice the PWM frequency .* sample at 50000 Hz"),
    (
        lambda: replace(SENSOR, acquisition=Acquisition(25e3 * np.pi)),
        "no ratio of whole numbers below 1,000; choose",
    ),
    (lambda: replace(SENSOR, coil=replace(COIL, resistance=200.0)), "the coil's current decays .* sample faster"),
    (
        lambda: replace(SENSOR, estimator=replace(ESTIMATOR, coil=replace(COIL, resistance=200.0))),
        "the estimator's current decays .* sample faster",
    ),
    (lambda: simulate([], STILL), "give at least one self-sensor"),
    (nothing(np.ones((2, 100))), r"gap has the shape \(2, 100\); give \(samples,\) or \(1, samples\)"),
    (nothing([]), r"gap has the shape \(1, 0\)"),
    (nothing(np.where(np.arange(100) == 7, 0.0, STILL)), "gap: sample 7 of row 0 is 0; it must be above 0"),
    (nothing(np.where(np.arange(100) == 7, np.nan, STILL)), "gap: sample 7 of row 0 is nan"),
    (nothing(STILL * 100), "gap: row 0 reaches 0.035 m, .* stay below 0.00749475 m, or sample faster"),
    (nothing(STILL, 1.01), "drive: sample 0 of row 0 is 1.01; it must be in -1 .. 1"),
    (nothing(STILL, np.zeros(50)), r"drive has the shape \(1, 50\); give a number, \(100,\) or \(1, 100\)"),
    (nothing(STILL, every=3), "every = 3 must be a whole number that divides 2000 and the 100 samples"),
    (nothing(STILL, every=2.0), "every = 2.0 must be a whole number"),
    (nothing(STILL, seed=-1), "seed = -1 must be a whole number of at least 0"),
    (
        lambda: simulate([SENSOR, replace(SENSOR, acquisition=Acquisition(500e3))], STILL),
        "must share their acquisition rate and PWM frequency",
    ),
]


@pytest.mark.parametrize(("call", "message"), BAD)
def test_bad_input_is_refused(call, message):
    with pytest.raises(ValueError, match=message):
        call()


def test_the_widest_gap_that_is_followed_is_followed_well():
    """Where a current decays by 30 % within a sample the kernel's series still holds: a step to volts over ohms."""
    coil = replace(COIL, back_emf=False)
    sensor = replace(SENSOR, coil=coil, supply=Supply(states=3))
    gap = np.full(20, 0.999 * largest_gap(sensor))
    current = simulate([replace(sensor, gap=GAP)], gap, 1.0).current[0, 1:]
    decay = 2.0 / coil.inductance(gap[0]) / 250e3
    assert decay == pytest.approx(0.3, rel=1e-3)
    np.testing.assert_allclose(np.diff(current) / np.exp(-decay * np.arange(18)), current[1] - current[0], rtol=1e-4)
