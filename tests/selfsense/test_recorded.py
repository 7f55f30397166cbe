"""Recorded signals against the simulation that made them, and every fault flagged instead of read as a gap."""

import numpy as np
import pytest

from selfsense.coil import Coil
from selfsense.forward_path import AnalogPath, DigitalPath
from selfsense.recorded import estimate_recorded, find_pwm_frequency
from selfsense.sensor import Estimator, SelfSensor
from selfsense.simulate import simulate
from selfsense.supply import Acquisition, Supply
from selfsense.validity import WRONG_READING, gap_validity, sensed_validity

GAP, RATE = 0.35e-3, 250e3
COIL = Coil(turns=90, pole_area=39.27e-6, resistance=2.0)
FAULT = slice(4000, 6000)


def sensor(kp=0.5 / 600, ki=1e4 / 600, path=None, supply=None, gap_range=(0.02e-3, 0.7e-3), **acquisition):
    estimator = Estimator(COIL, 24.0, kp, ki, gap_range, path or DigitalPath())
    return SelfSensor(COIL, supply or Supply(), Acquisition(**acquisition), estimator, GAP)


def recorded(s, current, switching, rate=RATE, gap=GAP, current_range=np.inf, **options):
    return estimate_recorded(current, 24 * switching, rate, s.estimator, gap, current_range, **options)


def moving(samples=8000, rate=RATE):
    return GAP + 20e-6 * np.sin(2 * np.pi * 100 * (np.arange(samples) + 1) / rate)


@pytest.fixture(scope="module")
def healthy():
    sensed = simulate([sensor()], moving())
    return sensed.current[0], sensed.switching[0], sensed.estimate[0]


def reasons(found):
    return {s.reason for s in found.reasons}


def mask(found, reason, samples):
    where = np.zeros(samples, dtype=bool)
    for s in found.reasons:
        if s.reason == reason:
            where[s.start : s.stop] = True
    return where


@pytest.mark.parametrize(
    "path, acquisition",
    [(DigitalPath(), {}), (DigitalPath(), {"noise": 5e-3, "bits": 12}), (AnalogPath(), {})],
)
def test_recorded_signals_give_the_estimate_that_was_simulated(path, acquisition):
    s = sensor(path=path, **acquisition, kp=0.3 / 600)
    t = (np.arange(8000) + 1) / RATE
    sensed = simulate([s], moving(), 0.2 * np.cos(2 * np.pi * 300 * t))
    found = recorded(s, sensed.current[0], sensed.switching[0], gap=0.5e-3)
    assert reasons(found) == {"converging"} and found.pwm_frequency == 25e3
    assert found.valid.mean() > 0.9 and np.array_equal(found.valid, np.isfinite(found.gap))
    assert np.abs(found.gap - sensed.estimate[0])[found.valid].max() < 20e-9
    assert np.abs(found.gap - sensed.estimate[0])[5000:].max() < 1e-12
    assert np.allclose(found.amplitude[1000:], sensed.amplitude[0, 1000:], rtol=1e-6)
    assert found.time[1] == 1 / RATE


def test_offset_and_polarity_of_either_channel_do_not_matter(healthy):
    current, switching, estimate = healthy
    for a, b in ((current + 5.0, switching), (-current, switching), (current, -switching), (current, switching + 0.05)):
        found = recorded(sensor(), a, b)
        assert reasons(found) == {"converging"}
        assert np.abs(found.gap - estimate)[found.valid].max() < 5e-9


@pytest.mark.parametrize("rate", [60e3, 137.5e3, 252.3e3, 1e6])
def test_any_rate_above_twice_the_pwm_frequency_serves(rate):
    s = sensor(rate=rate)
    samples = 2000 * int(rate * 0.03 / 2000 + 1)
    sensed = simulate([s], np.full(samples, GAP), 0.15)
    found = recorded(s, sensed.current[0], sensed.switching[0], rate)
    assert found.pwm_frequency == pytest.approx(25e3, abs=rate / samples)
    assert np.abs(found.gap - GAP)[found.valid].max() < 5e-6 and found.valid.mean() > 0.85


@pytest.mark.parametrize("states, drive", [(2, 0.0), (2, 0.9), (2, -0.7), (3, 0.1), (3, 0.5), (3, -0.9)])
@pytest.mark.parametrize("rate, frequency", [(125e3, 25e3), (250e3, 19e3), (1e6, 40e3)])
def test_the_pwm_frequency_is_found_at_any_duty(states, drive, rate, frequency):
    s = sensor(supply=Supply(24.0, frequency, states), rate=rate)
    t = (np.arange(4000) + 1) / rate
    switching = simulate([s], np.full(4000, GAP), drive + 0.05 * np.cos(2 * np.pi * 400 * t)).switching[0]
    assert find_pwm_frequency(24 * switching, rate, DigitalPath()) == pytest.approx(frequency, abs=rate / 4000)


def faulty(name, current, switching):
    rng = np.random.default_rng(0)
    n = FAULT.stop - FAULT.start
    dying = current[FAULT.start] * np.exp(-np.arange(n) / RATE / 0.29e-3)
    part = {
        "current lost": (0.0, None),
        "current frozen": (1.3, None),
        "current frozen, noisy": (1.3 + 2e-3 * rng.standard_normal(n), None),
        "current lost in noise": (0.05 * rng.standard_normal(n), None),
        "voltage lost": (None, 0.0),
        "voltage lost, noisy": (None, 1e-3 * rng.standard_normal(n)),
        "supply off": (dying, 0.0),
    }[name]
    out = [current.copy(), switching.copy()]
    for series, value in zip(out, part, strict=True):
        if value is not None:
            series[FAULT] = value
    return out


@pytest.mark.parametrize("gains", [(0.5 / 600, 1e4 / 600), (1 / 600, 2.5e4 / 600)])
@pytest.mark.parametrize("gap_range", [(0.02e-3, 0.7e-3), (0.001e-3, 7e-3)])
@pytest.mark.parametrize(
    "name",
    [
        "current lost",
        "current frozen",
        "current frozen, noisy",
        "current lost in noise",
        "voltage lost",
        "voltage lost, noisy",
        "supply off",
    ],
)
def test_a_lost_ripple_is_flagged_and_never_read(healthy, name, gap_range, gains):
    """Whatever stays valid is the gap of the healthy record; what was lost is not, and comes back."""
    s = sensor(*gains, gap_range=gap_range)
    current, switching, _ = healthy
    whole = recorded(s, current, switching).gap
    found = recorded(s, *faulty(name, current, switching))
    assert np.nanmax(np.abs(found.gap - whole)) < 0.1e-6
    assert not found.valid[FAULT].any() and "no ripple" in reasons(found)
    assert mask(found, "no ripple", 8000)[FAULT].mean() > 0.9
    assert found.valid[1000:3500].all() and found.valid[7600:].all()


@pytest.mark.parametrize("drive", [1.0, -1.0, 0.97])
def test_a_stuck_duty_is_flagged_in_recorded_and_in_simulated_series(healthy, drive):
    drives = np.zeros(8000)
    drives[FAULT] = drive
    s = sensor()
    sensed = simulate([s], moving(), drives)
    by_record = recorded(s, sensed.current[0], sensed.switching[0])
    by_series = sensed_validity(sensed, [s])[0]
    for found in (by_record, by_series):
        assert "no ripple" in reasons(found) and not found.valid[FAULT].any()
        assert np.abs(sensed.estimate[0] - healthy[2])[found.valid].max() < 0.1e-6 and found.valid[7600:].all()


def test_the_ripple_is_too_small_below_a_tenth_of_half_duty():
    """4 alpha (1 - alpha) of 0.116 and 0.109, of which the path passes 0.103 and 0.096."""
    s = sensor()
    sensed = simulate([s, s], np.full(20000, GAP), np.repeat([[2 * 0.03 - 1], [2 * 0.028 - 1]], 20000, axis=1))
    enough, too_small = sensed_validity(sensed, [s, s])
    assert enough.valid[15000:].all() and not too_small.valid.any() and "no ripple" in reasons(too_small)


def test_a_gap_beyond_the_range_is_flagged(healthy):
    gap = moving()
    gap[FAULT] = 0.75e-3
    s = sensor()
    sensed = simulate([s], gap)
    for found in (recorded(s, sensed.current[0], sensed.switching[0]), sensed_validity(sensed, [s])[0]):
        # A gap that jumps makes the current jump, without a voltage.
        assert reasons(found) - {WRONG_READING} == {"end of gap_range", "converging"} and not found.valid[FAULT].any()
        assert np.abs(sensed.estimate[0] - healthy[2])[found.valid].max() < 0.1e-6


def test_a_clipped_current_is_flagged(healthy):
    current, switching, estimate = healthy
    clipped = current.copy()
    clipped[FAULT] = np.clip(1.3 * current[FAULT] + 0.1, -5.0, 0.5)
    found = recorded(sensor(), clipped, switching, current_range=0.5)
    assert reasons(found) == {"current clipped", "converging"}
    assert np.abs(found.gap - estimate)[found.valid].max() < 0.1e-6 and not found.valid[4010:5990].any()
    # In a simulated series the converter's own end tells: a drive moves the current out of it.
    s = sensor(bits=10, current_range=0.6, noise=1e-4)
    drives = np.zeros(8000)
    drives[FAULT] = 0.1
    sensed = simulate([s], moving(), drives)
    series = sensed_validity(sensed, [s])[0]
    assert sensed.current[0].max() == pytest.approx(0.6 * 511 / 512)
    assert "current clipped" in reasons(series) and not series.valid[4500:6000].any()
    assert np.abs(sensed.estimate[0] - estimate)[series.valid].max() < 2e-6


@pytest.mark.parametrize("rate, off", [(65e3, 25e-6), (250e3, 20e-6), (1e6, 20e-6)])
def test_a_single_wrong_reading_is_flagged_where_it_would_move_the_gap(rate, off):
    """Of 3 to 5 times their size, current readings had moved it by 260 um and voltages by 160 um, all of them valid."""
    s = sensor(rate=rate, noise=2e-3, bits=14)
    samples = 2000 * round(rate * 0.03 / 2000 + 1)
    sensed = simulate([s], moving(samples, rate), 0.2 * np.cos(2 * np.pi * 300 * np.arange(samples) / rate))
    healthy = recorded(s, sensed.current[0], sensed.switching[0], rate)
    assert reasons(healthy) == {"converging"}
    for at in samples // 2 + np.arange(0, 12, 3):
        for channel, factor in ((0, 3.0), (0, -1.0), (1, 1.5), (1, 5.0), (1, 20.0)):
            both = [sensed.current[0].copy(), sensed.switching[0].copy()]
            both[channel][at] *= factor
            found = recorded(s, *both, rate)
            assert np.nanmax(abs(found.gap - healthy.gap)) < off
            assert found.valid.mean() > healthy.valid.mean() - 0.12 and found.valid[-500:].all()
    lost = [np.delete(x, samples // 2) for x in (sensed.current[0], sensed.switching[0])]
    assert np.nanmax(abs(recorded(s, *lost, rate).gap - np.delete(healthy.gap, samples // 2))) < off


def test_a_ripple_in_too_much_noise_is_flagged_in_a_simulated_series():
    """50 mA of noise: it widens the gap by 4 um under a half duty, and by 38 µm, a tenth, under a duty of 0.9."""
    s = sensor(noise=0.05, bits=16, current_range=20.0)
    sensed = simulate([s, s], np.full(8000, GAP), np.repeat([[0.0], [0.8]], 8000, axis=1))
    half, narrow = sensed_validity(sensed, [s, s])
    assert half.valid[1000:].all() and np.abs(sensed.estimate[0, 2000:].mean() - GAP) < 8e-6
    assert not narrow.valid.any() and "no ripple" in reasons(narrow)
    assert sensed.estimate[1, 2000:].mean() > GAP + 25e-6


@pytest.mark.parametrize("drive", [0.0, 0.9])
@pytest.mark.parametrize("gains", [(0.5 / 600, 1e4 / 600), (0.1 / 600, 1e3 / 600), (1 / 600, 2.5e4 / 600)])
def test_converging_lasts_until_the_start_is_forgotten(gains, drive):
    s = sensor(*gains)
    sensed = simulate([s], np.full(40000, GAP), drive)
    found = recorded(s, sensed.current[0], sensed.switching[0], gap=0.45e-3)
    first = np.argmax(found.valid)
    settled = found.gap[-1]
    assert reasons(found) == {"converging"}
    assert abs(found.gap[first] - settled) < 50e-9
    assert first < 15 * (1 / gains[1] / 600 + gains[0] / gains[1] + 50e-6) / (1 - drive**2) * RATE


def test_an_unstable_estimator_is_flagged():
    s = sensor(2 / 600, 5e4 / 600, AnalogPath())
    sensed = simulate([s], np.full(8000, 0.5e-3))
    assert sensed.estimate[0, 4000:].std() > 10e-6
    assert not sensed_validity(sensed, [s])[0].valid.any()


def test_validity_of_a_decimated_series_is_that_of_all_samples():
    s, drives = sensor(), np.zeros(8000)
    drives[FAULT] = 1.0
    every, tenth = (simulate([s], moving(), drives, every=n) for n in (1, 10))
    a, b = sensed_validity(every, [s])[0].valid, sensed_validity(tenth, [s])[0].valid
    assert np.mean(a[9::10] != b) < 0.01
    with pytest.raises(ValueError, match="2 sensors for 1 estimates"):
        sensed_validity(every, [s, s])


def test_without_faults_nothing_but_convergence_is_flagged():
    found = gap_validity(np.full(2000, GAP), np.full(2000, 0.21), RATE, sensor().estimator, 24.0, 25e3)
    (stretch,) = found.reasons
    # 10 of 1 / (ki S) + kp / ki + sqrt(2) / w of the low-pass, S = 2 A / (2 gap).
    expected = 10 * (1 / (1e4 / 600 * 600) + 0.5e-4 + np.sqrt(2) / (2 * np.pi * 5e3)) * RATE
    assert stretch.reason == "converging" and stretch.start == 0 and stretch.stop == pytest.approx(expected, abs=2)
    assert np.array_equal(np.flatnonzero(found.valid), np.arange(stretch.stop, 2000))


def instants(time, drive):
    phase = (time * 25e3 - 1e-7) % 1
    return np.where(phase < (1 + drive) / 2, 1.0, -1.0)


@pytest.mark.parametrize("per_period, low, high", [(10, 0.05, 0.1), (40, 0.005, 0.015), (10.092, 0.01, 0.03)])
def test_instants_of_the_voltage_lose_what_is_documented(per_period, low, high):
    """The largest error of the mean gap at duties within 0.1 of one half."""
    rate = 25e3 * per_period
    drives = np.linspace(-0.2, 0.2, 9)
    s = sensor(rate=rate)
    samples = 2000 * round(rate * 0.01 / 2000 + 1)
    sensed = simulate([s] * 9, np.full(samples, GAP), np.repeat(drives[:, None], samples, axis=1))
    worst = 0.0
    for i, drive in enumerate(drives):
        volts = instants(sensed.time, drive)
        found = recorded(s, sensed.current[i], volts, rate, voltage_sampling="point")
        worst = max(worst, abs(np.nanmean(found.gap) / GAP - 1))
    assert low < worst < high


def test_wrong_records_are_refused_before_any_work(healthy):
    current, switching, _ = healthy
    s, n = sensor(), current.size
    bad = current.copy()
    bad[[17, 30]] = np.nan, np.inf
    with pytest.raises(ValueError, match=r"current: sample 17 is nan \(2 such samples\); cut"):
        recorded(s, bad, switching)
    with pytest.raises(ValueError, match="voltage: sample 3 is -inf"):
        recorded(s, current, np.where(np.arange(n) == 3, -np.inf, switching))
    with pytest.raises(ValueError, match="8000 samples and voltage 4000: they differ from sample 4000 on; give both"):
        recorded(s, current, switching[::2])
    with pytest.raises(ValueError, match="below twice the PWM frequency"):
        recorded(s, current[::6], switching[::6], RATE / 6, pwm_frequency=25e3)
    with pytest.raises(ValueError, match="'point' at 5 samples per PWM period"):
        recorded(s, current[::2], switching[::2], RATE / 2, voltage_sampling="point")
    with pytest.raises(ValueError, match="voltage_sampling = 'hold'"):
        recorded(s, current, switching, voltage_sampling="hold")
    with pytest.raises(ValueError, match=r"current has the shape \(2, 4000\)"):
        recorded(s, current.reshape(2, -1), switching)
    with pytest.raises(ValueError, match=r"current_range = -1 A"):
        recorded(s, current, switching, current_range=-1)
    with pytest.raises(ValueError, match=r"gap = 0\.8 m is not inside"):
        recorded(s, current, switching, gap=0.8)
    with pytest.raises(ValueError, match="ki = 0 never removes"):
        recorded(sensor(ki=0.0), current, switching)


def test_wholly_invalid_records_are_refused_with_their_reason(healthy):
    current, switching, _ = healthy
    s, rng = sensor(), np.random.default_rng(1)
    for still in (np.zeros(8000), np.ones(8000), 1e-3 * rng.standard_normal(8000)):
        with pytest.raises(ValueError, match="voltage: no switching stands out above 1500 Hz in its 8000 samples"):
            recorded(s, current, still)
        with pytest.raises(ValueError, match="no sample of 8000 carries a gap: 'no ripple'"):
            recorded(s, still, switching)
    with pytest.raises(ValueError, match=r"'end of gap_range' for \d+ of them.*correct the believed coil"):
        recorded(s, current, 1e-3 * switching)
    with pytest.raises(ValueError, match=r"'current clipped' for 8000 of them, first at sample 0: .*widen that range"):
        recorded(s, np.clip(current, -0.3, 0.3), switching, current_range=0.3)
    with pytest.raises(ValueError, match="'converging' for 300 of them"):
        recorded(s, current[:300], switching[:300])
