"""Static calibration on the dissertation's table and made-up lines, dynamic on known filters, both in simulation."""

import numpy as np
import pytest
from scipy import stats

from estimation.multisine.sphs import harmonic_range, sphs, synthesise
from selfsense.calibration.dynamic import dynamic_calibration, simulated_dynamic
from selfsense.calibration.static import static_calibration, static_sweep
from selfsense.coil import Coil
from selfsense.linear import tracking
from selfsense.recorded import estimate_recorded
from selfsense.sensor import Estimator, SelfSensor
from selfsense.simulate import simulate
from selfsense.supply import Acquisition, Supply

GAP, RATE = 0.35e-3, 250e3
COIL = Coil(turns=90, pole_area=39.27e-6, resistance=2.0)
# D Table 6.1: mm, mV.
TABLE_6_1 = (
    [0, 0.05, 0.10, 0.15, 0.20, 0.25, 0.30, 0.35, 0.40, 0.45, 0.49, 0.55, 0.60],
    [0, 22, 46, 68, 90, 113, 136, 158, 180, 202, 220, 222, 223],
)


def sensor(coil=COIL, gap_range=(0.02e-3, 0.7e-3), kp=1 / 600, ki=2.5e4 / 600, **acquisition):
    estimator = Estimator(COIL, 24.0, kp, ki, gap_range)
    return SelfSensor(coil, Supply(), Acquisition(**acquisition), estimator, GAP)


def test_the_dissertations_table():
    found = static_calibration(*TABLE_6_1)
    line = stats.linregress(TABLE_6_1[0][:11], TABLE_6_1[1][:11])
    assert found.gain == pytest.approx(449.19, abs=0.005) and found.offset == pytest.approx(0.383, abs=5e-4)
    assert found.linearity_error == pytest.approx(0.0039, abs=5e-5)
    assert found.largest_deviation == pytest.approx(0.859, abs=5e-4)
    assert found.linear_range == (0.0, 0.49) and found.saturated_above == 0.49 and found.saturated_below is None
    assert found.gain == pytest.approx(line.slope) and found.gain_se == pytest.approx(line.stderr)
    assert found.offset_se == pytest.approx(line.intercept_stderr)


def test_the_dissertations_gain_counts_a_saturated_point_as_linear():
    """Its 0.43 V/mm is the line through the first 12 points, 8 % of full scale off the last of them."""
    found = static_calibration(*TABLE_6_1, tolerance=0.1)
    assert found.linear_range == (0.0, 0.55) and found.gain == pytest.approx(429.3, abs=0.05)
    assert found.largest_deviation == pytest.approx(17.84, abs=0.005)


@pytest.mark.parametrize("gain", [2.0, -3.0])
def test_a_range_around_rest_with_saturation_on_both_sides(gain):
    x = np.arange(-10.0, 11.0)
    y = gain * np.clip(x, -6.0, 4.0) + 0.1 * gain * x + 7.0
    order = np.random.default_rng(0).permutation(np.repeat(np.arange(21), 2))  # up and down, unsorted
    found = static_calibration(x[order], y[order], rest=0.0)
    assert found.linear_range == (-6.0, 4.0) and (found.saturated_below, found.saturated_above) == (-6.0, 4.0)
    assert found.gain == pytest.approx(1.1 * gain) and found.offset == pytest.approx(7.0)
    assert found.linearity_error < 1e-12


def test_a_bend_that_keeps_half_the_gain_is_not_saturation():
    x = np.arange(21.0)
    bent, flat = (static_calibration(x, np.minimum(x, 10) + slope * np.maximum(x - 10, 0)) for slope in (0.6, 0.4))
    assert bent.linear_range[1] < 12 and bent.saturated_above is None
    assert flat.saturated_above == 10.0 and static_calibration(x, x).saturated_above is None


def test_static_standard_errors_cover():
    rng, x = np.random.default_rng(1), np.linspace(0, 1, 9)
    t = stats.t.ppf(0.975, 7)
    found = [static_calibration(x, 5 * x + 1 + 0.02 * rng.standard_normal(9), tolerance=0.5) for _ in range(800)]
    assert np.mean([abs(f.gain - 5) < t * f.gain_se for f in found]) == pytest.approx(0.95, abs=0.02)
    assert np.mean([abs(f.offset - 1) < t * f.offset_se for f in found]) == pytest.approx(0.95, abs=0.02)


def test_what_has_no_line_is_refused():
    with pytest.raises(ValueError, match=r"no three displacements around 0 lie on a line within 0\.01 of full scale"):
        static_calibration(np.arange(6.0), [0, 1, 0, 1, 0, 1])
    with pytest.raises(ValueError, match=r"displacement \(3,\) and output \(2,\)"):
        static_calibration([0, 1, 2], [0, 1])
    with pytest.raises(ValueError, match="output must be a one-dimensional array of finite"):
        static_calibration([0, 1, 2], [0, 1, np.nan])
    with pytest.raises(ValueError, match=r"tolerance = 1\.5"):
        static_calibration([0, 1, 2], [0, 1, 2], tolerance=1.5)


@pytest.mark.parametrize("still", [0.0, 1.3, -4e-7])
def test_an_output_that_stands_still_is_no_sensors(still):
    x = np.linspace(0.0, 5e-4, 6)
    with pytest.raises(ValueError, match="does not follow the displacement"):
        static_calibration(x, np.full(6, still))
    with pytest.raises(ValueError, match="does not follow the displacement"):
        static_calibration(x, still * (1 + 1e-12 * np.arange(6)))
    # Where it stands still over most of the travel only, its line is where it does not.
    x = np.arange(12.0)
    found = static_calibration(x, still + np.minimum(x, 4.0), rest=1.0)
    assert found.linear_range == (0.0, 4.0) and found.gain == pytest.approx(1.0) and found.saturated_above == 4.0


def test_a_simulated_sweep_has_the_tables_form():
    """Displacement from 0.1 mm on, the range's end 0.49 mm further: linear, then flat."""
    gaps = 0.1e-3 + np.array(TABLE_6_1[0]) * 1e-3
    estimate = static_sweep(sensor(gap_range=(0.02e-3, 0.59e-3), noise=2e-3, bits=12), gaps, seed=3)
    found = static_calibration(gaps - gaps[0], estimate)
    assert found.linear_range[1] == pytest.approx(0.49e-3) and found.saturated_above == pytest.approx(0.49e-3)
    assert found.gain == pytest.approx(1.0, abs=2e-3) and found.linearity_error < 2e-3
    assert np.all(estimate[-2:] == 0.59e-3)


def test_a_swept_sensor_shows_what_its_believed_coil_misses():
    gaps = np.linspace(0.2e-3, 0.5e-3, 7)
    found = static_calibration(gaps, static_sweep(sensor(Coil(90 * 1.01, 39.27e-6, 2.0, 20e-6)), gaps))
    # The ripple is that of core_length + 2 gap over N^2; the estimate takes the core for a gap.
    assert found.gain == pytest.approx(1 / 1.01**2, rel=1e-3)
    assert found.offset == pytest.approx(10e-6 / 1.01**2, rel=2e-2)
    with pytest.raises(ValueError, match="'no ripple' at sample 5000 of the simulation"):
        static_sweep(sensor(), gaps, drive=1.0)


def filtered(lines, periods=3, per_period=2000, fundamental=10.0, response=lambda f: np.ones_like(f)):
    """A multisine and what a filter makes of it, periodic."""
    wave = synthesise(sphs(lines, per_period, 20e-6), per_period)
    frequency = np.fft.rfftfreq(per_period) * per_period * fundamental
    out = np.fft.irfft(np.fft.rfft(wave) * response(frequency), per_period)
    return np.tile(wave, periods), np.tile(out, periods)


def test_a_known_filter_and_its_bandwidth_are_recovered():
    lines, corner = harmonic_range(1, 300), 1234.0
    x, y = filtered(lines, response=lambda f: 0.9 * np.exp(-2j * np.pi * f * 1e-4) / (1 + 1j * f / corner))
    found = dynamic_calibration(x, y, 20e3, 10.0, lines, 2)
    f = found.frequency
    assert np.array_equal(f, 10.0 * lines)
    assert np.allclose(found.response, 0.9 * np.exp(-2j * np.pi * f * 1e-4) / (1 + 1j * f / corner), atol=1e-10)
    assert found.gain == pytest.approx(0.9, rel=1e-3) and found.bandwidth == pytest.approx(corner, rel=2e-3)
    lag, error = found.lag([100.0, 2505.0])
    assert np.allclose(lag, [2 * np.pi * h * 1e-4 + np.arctan(h / corner) for h in (100, 2505)], atol=1e-4)
    assert np.all(error < 1e-6)
    with pytest.raises(ValueError, match=r"3001\.0 Hz is outside the lines measured, 10 \.\. 3000 Hz"):
        found.lag(3001.0)


@pytest.mark.parametrize("gain", [0.45, -1.0])
@pytest.mark.parametrize("delay", [0.0, 556e-6, 12e-3])
def test_a_pure_delay_is_recovered_whatever_its_gain(gain, delay):
    """D's 30 degrees at 150 Hz are 556 µs; 12 ms turns the phase more than once."""
    lines = harmonic_range(1, 150)
    x, y = filtered(lines, response=lambda f: gain * np.exp(-2j * np.pi * f * delay))
    found = dynamic_calibration(x, y, 20e3, 10.0, lines, 3)
    assert found.delay == pytest.approx(delay, abs=1e-12) and found.bandwidth == np.inf
    assert found.gain == pytest.approx(abs(gain)) and found.lag(150.0)[0] == pytest.approx(2 * np.pi * 150 * delay)


def test_the_delay_survives_lines_that_are_lost_in_noise():
    """Unwrapping the phase from line to line would slip whole turns at the lines between."""
    lines = harmonic_range(1, 60)
    x, y = filtered(lines, response=lambda f: np.where((f > 200) & (f < 350), 0, 1) * np.exp(-2j * np.pi * f * 4e-3))
    y = y + 0.05e-6 * np.random.default_rng(2).standard_normal(y.size)
    found = dynamic_calibration(x, y, 20e3, 10.0, lines, 3)
    assert found.delay == pytest.approx(4e-3, abs=5 * found.delay_se) and found.delay_se < 1e-6


def test_only_the_last_periods_count():
    lines = harmonic_range(1, 50)
    x, y = filtered(lines, periods=4, response=lambda f: np.exp(-2j * np.pi * f * 1e-4))
    y[:4000] = np.nan
    assert dynamic_calibration(x, y, 20e3, 10.0, lines, 2).delay == pytest.approx(1e-4)
    with pytest.raises(ValueError, match="estimate: sample 2000 is nan; use periods without"):
        dynamic_calibration(x, y, 20e3, 10.0, lines, 3)
    with pytest.raises(ValueError, match="5 periods of 2000 samples are asked of 8000 samples"):
        dynamic_calibration(x, y, 20e3, 10.0, lines, 5)
    with pytest.raises(ValueError, match=r"fundamental = 7\.0 Hz: its period is not a whole number"):
        dynamic_calibration(x, y, 20e3, 7.0, lines, 2)
    with pytest.raises(ValueError, match="periods = 1: two or more"):
        dynamic_calibration(x, y, 20e3, 10.0, lines, 1)
    with pytest.raises(ValueError, match="below half of the 2000 samples"):
        dynamic_calibration(x, y, 20e3, 10.0, [1000], 2)
    for wrong in ([3, 2], [0, 1], [1.5], [[1]]):
        with pytest.raises(ValueError, match="lines must be rising whole numbers"):
            dynamic_calibration(x, y, 20e3, 10.0, wrong, 2)
    with pytest.raises(ValueError, match="displacement: line 3 holds nothing"):
        dynamic_calibration(0 * x, x, 20e3, 10.0, [3], 2)


@pytest.mark.parametrize("last, periods", [(40, 2), (40, 5), (3, 2)])
def test_the_delays_interval_covers_under_noise_in_both_channels(last, periods):
    """Noise of a fifth of the signal, as D met it, and a response, of opposite phase, that no pure delay fits."""
    rng, lines = np.random.default_rng(5), harmonic_range(1, last)
    g = lambda f: -np.exp(-2j * np.pi * f * 3e-4) / (1 + 1j * f / 900)  # noqa: E731
    clean = filtered(lines, periods, 200, response=g)
    truth = dynamic_calibration(*clean, 2000.0, 10.0, lines, periods)
    noise = np.std(clean[1]) / 5
    hits, squares, errors = [], [], []
    for _ in range(600):
        x, y = (s + noise * rng.standard_normal(s.size) for s in clean)
        found = dynamic_calibration(x, y, 2000.0, 10.0, lines, periods)
        hits.append(found.delay_low < truth.delay < found.delay_high)
        squares.append(np.abs(found.response - truth.response) ** 2)
        errors.append(found.standard_error**2)
    assert np.mean(hits) == pytest.approx(0.95, abs=0.025)
    assert np.mean(squares) == pytest.approx(np.mean(errors), rel=0.05)


def test_the_delays_interval_covers_in_simulation():
    """200 calibrations of a sensor whose readings carry 5 mA of noise and 12 bits, four periods of 10 ms each."""
    lines, settling = harmonic_range(1, 40), 1500
    wave = synthesise(sphs(lines, 2500, 20e-6), 2500)
    gap = GAP + np.tile(wave, 2)[2500 - settling :]
    estimate = simulate([sensor(noise=5e-3, bits=12)] * 800, gap).estimate[:, settling:]
    found = [
        dynamic_calibration(np.tile(wave, 4), e.reshape(-1), RATE, 100.0, lines, 4)
        for e in estimate.reshape(200, 4, -1)
    ]
    delays = np.array([f.delay for f in found])
    assert np.mean([f.delay_low < delays.mean() < f.delay_high for f in found]) == pytest.approx(0.95, abs=0.04)
    assert np.mean([f.delay_se for f in found]) == pytest.approx(delays.std(), rel=0.12)


@pytest.mark.parametrize("gains", [(0.5 / 600, 1e4 / 600), (1 / 600, 2.5e4 / 600)])
def test_simulated_response_is_that_of_the_linear_model(gains):
    """D's 1 to 4000 Hz in steps of 1 Hz. What the loop sends between harmonics of the PWM is not in the model."""
    s = sensor(kp=gains[0], ki=gains[1])
    found = simulated_dynamic(s, 1.0, 4000.0, 10e-6, periods=2)
    expected = tracking(s, found.frequency)
    assert found.frequency[[0, -1]].tolist() == [1.0, 4000.0]
    assert np.abs(found.response - expected).max() < 2e-3
    assert found.lag(4000.0)[0] == pytest.approx(-np.unwrap(np.angle(expected))[-1], abs=2e-3)
    assert found.gain == pytest.approx(1.0, abs=1e-3)


def test_a_recorded_estimate_is_calibrated_like_a_simulated_one():
    s, lines = sensor(), harmonic_range(1, 40)
    wave = synthesise(sphs(lines, 2500, 10e-6), 2500)
    sensed = simulate([s], GAP + np.tile(wave, 4))
    record = estimate_recorded(sensed.current[0], 24 * sensed.switching[0], RATE, s.estimator, GAP, np.inf)
    assert np.isnan(record.gap[0])
    found = dynamic_calibration(np.tile(wave, 4), record.gap, RATE, 100.0, lines, 3)
    simulated = simulated_dynamic(s, 100.0, 4000.0, 10e-6)
    assert np.allclose(found.response, simulated.response, atol=1e-6)
    assert found.delay == pytest.approx(simulated.delay, rel=1e-6)


def test_one_sample_per_pwm_period_folds_the_ripple_onto_the_lines():
    s, lines = sensor(), harmonic_range(1, 40)
    wave = np.tile(synthesise(sphs(lines, 2500, 10e-6), 2500), 4)
    estimate = simulate([s], GAP + wave).estimate[0]
    every, tenth = (dynamic_calibration(wave[::n], estimate[::n], RATE / n, 100.0, lines, 2) for n in (1, 10))
    assert np.abs(tenth.response - every.response).max() == pytest.approx(0.005, abs=0.001)


def test_a_simulation_that_cannot_be_trusted_is_refused():
    with pytest.raises(ValueError, match="'end of gap_range' at sample"):
        simulated_dynamic(sensor(gap_range=(0.02e-3, 0.36e-3)), 100.0, 1000.0, 20e-6)
    with pytest.raises(ValueError, match="'converging' at sample 5000 of the simulation"):
        simulated_dynamic(sensor(kp=0.0, ki=0.5), 100.0, 1000.0, 20e-6)
    with pytest.raises(ValueError, match="fundamental = 90001 Hz"):
        simulated_dynamic(sensor(), 90001, 1000.0, 20e-6)
