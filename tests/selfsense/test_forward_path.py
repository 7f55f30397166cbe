"""Forward paths: the kernel against scipy's filters, D's figures of both paths, and what they make of a ripple."""

from dataclasses import replace

import numpy as np
import pytest
from reference_coil import filters
from scipy.optimize import brentq
from scipy.signal import butter, freqs, lfilter

from selfsense.coil import Coil
from selfsense.forward_path import AnalogPath, DigitalPath, response
from selfsense.sensor import Estimator, SelfSensor
from selfsense.simulate import simulate
from selfsense.supply import Acquisition, Supply

COIL = Coil(turns=90, pole_area=39.27e-6, resistance=2.0)
GAP = 0.35e-3


def sensor(path, rate=250e3, coil=COIL):
    return SelfSensor(coil, Supply(), Acquisition(rate), Estimator(COIL, 24.0, 0.0, 0.0, (2e-5, 7e-4), path), GAP)


@pytest.mark.parametrize("rate", [250e3, 165e3])
@pytest.mark.parametrize("path", [DigitalPath(), DigitalPath(10e3, 2e3), AnalogPath(), AnalogPath(30e3, 1.2, 0.9, 3e3)])
def test_amplitude_is_what_scipy_makes_of_the_current(path, rate):
    time = np.arange(1, 3001) / rate
    gap, drive = GAP + 100e-6 * np.sin(2 * np.pi * 150 * time), 0.3 * np.sin(2 * np.pi * 220 * time)
    sensed = simulate([sensor(path, rate)], gap, drive)
    before, behind = filters(path, rate)
    value = sensed.current[0]
    for b, a in before:
        value = lfilter(b, a, value)
    if isinstance(path, AnalogPath):
        expected = np.sqrt(np.maximum(lfilter(*behind, value**2), 0.0))
    else:
        expected = lfilter(*behind, np.abs(value))
    np.testing.assert_allclose(sensed.amplitude[0], expected, rtol=1e-9, atol=1e-12)


def gain(sections, frequency, rate):
    return np.abs(response(sections, np.exp(2j * np.pi * np.asarray(frequency) / rate)))


@pytest.mark.parametrize("rate", [250e3, 62.5e3])
def test_digital_path_is_the_analog_butterworth_at_the_warped_frequency(rate):
    frequency = np.linspace(100, 0.45 * rate, 60)
    warped = 2 * rate * np.tan(np.pi * frequency / rate)
    before, behind = DigitalPath().sections(rate)
    for sections, corner, kind in ((before, 15e3, "highpass"), (behind, 5e3, "lowpass")):
        _, expected = freqs(*butter(2, 2 * np.pi * corner, kind, analog=True), warped)
        np.testing.assert_allclose(gain(sections, frequency, rate), np.abs(expected), rtol=1e-9)
    assert gain(behind, 0.0, rate) == pytest.approx(1.0)


def edges(sections, rate):
    """Frequencies (Hz) at which the gain is 3 dB below that at 25 kHz."""
    half = gain(sections, 25e3, rate) / np.sqrt(2)
    return [brentq(lambda f: gain(sections, f, rate) - half, *ends) for ends in ((1e3, 25e3), (25e3, 100e3))]


def test_a_band_pass_stage_has_the_gain_and_the_width_of_the_circuit():
    """1.15 at 25 kHz, and 30 kHz wide. A quality of 0.83 puts that at 14 to 44 kHz, as a band-pass is symmetric in the
    logarithm of frequency; Tustin's rule at 250 kHz pulls the upper end to 41.5 kHz, and two stages pass 17 to 35."""
    fine, _ = AnalogPath().sections(20e6)
    sampled, _ = AnalogPath().sections(250e3)
    assert gain(fine[:1], 25e3, 20e6) == pytest.approx(1.15, rel=1e-9)
    assert gain(sampled[:1], 25e3, 250e3) == pytest.approx(1.15, rel=1e-9)
    low, high = edges(fine[:1], 20e6)
    assert (low, high) == pytest.approx((14.13e3, 44.25e3), rel=1e-3)
    assert high - low == pytest.approx(25e3 / 0.83, rel=1e-3)
    assert low * high == pytest.approx(25e3**2, rel=1e-3)
    assert edges(sampled[:1], 250e3) == pytest.approx([14.45e3, 41.53e3], rel=1e-3)
    assert edges(sampled, 250e3) == pytest.approx([17.42e3, 35.25e3], rel=1e-3)


@pytest.mark.parametrize(
    ("rate", "factors"),
    [
        (250e3, {0.35: 0.5067, 0.4: 0.5246, 0.45: 0.5146, 0.5: 0.5153, 0.55: 0.5028, 0.6: 0.5246, 0.65: 0.4942}),
        (2.5e6, {0.35: 0.4935, 0.4: 0.4975, 0.5: 0.5006, 0.6: 0.4975, 0.65: 0.4935}),
    ],
)
def test_the_filters_of_appendix_d_give_half_of_eq_6_20(rate, factors):
    """Per duty; the coarse samples of a rectified ripple scatter by 3 %, which comes on top of the filters' 1 %."""
    coil = replace(COIL, resistance=0.0)
    duty, factor = np.array(list(factors)), np.array(list(factors.values()))
    drive = np.tile(2 * duty[:, None] - 1, round(3e-3 * rate))
    sensed = simulate([sensor(DigitalPath(), rate, coil)] * len(duty), np.full(drive.shape[1], GAP), drive)
    mean = sensed.amplitude[:, -10 * round(40e-6 * rate) :].mean(axis=1)
    eq_6_20 = duty * (1 - duty) * 24.0 * 40e-6 / coil.constant * 2 * GAP
    np.testing.assert_allclose(mean / eq_6_20, factor, atol=2e-4)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: DigitalPath(high_pass=-1.0), "digital path: high_pass = -1.0 must be a positive number"),
        (lambda: DigitalPath(low_pass="5k"), "digital path: low_pass = '5k' must be a positive number"),
        (lambda: AnalogPath(quality=float("nan")), "analog path: quality = nan must be a positive number"),
        (lambda: DigitalPath(high_pass=125e3).sections(250e3), "125000 Hz is not below half of the 250000 Hz sampled"),
        (lambda: DigitalPath(low_pass=130e3).sections(250e3), "130000 Hz is not below half of the 250000 Hz sampled"),
        (lambda: sensor(AnalogPath(), 50e3), "25000 Hz is not below half of the 50000 Hz sampled; sample faster"),
    ],
)
def test_bad_paths_are_refused(make, message):
    with pytest.raises(ValueError, match=message):
        make()
