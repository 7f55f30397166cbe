"""Lines beside spin tones that do not fit the block: exact without noise, unbiased and of the stated variance with."""

import numpy as np
import pytest

from estimation.lines.spin import lines_beside_spin, spin_speed

RATE, COUNT, SPIN, ORDERS = 20e3, 5000, 133.3, [1, 2, 3]
LINES = np.array([20.0, 48, 92, 120, 140, 180, 260, 272, 320, 388, 408])
TIME = np.arange(COUNT) / RATE
TRUTH = 1e-7 * np.exp(1j * np.arange(LINES.size) ** 2)
TONES = np.array([10e-6, 2e-6 * 1j, -1e-6])  # up to 100 times the lines


def waves(frequency, amplitude, time=TIME):
    return np.real(np.asarray(amplitude) @ np.exp(2j * np.pi * np.outer(frequency, time)))


def block(spin_hz=SPIN):
    return waves(LINES, TRUTH) + waves(spin_hz * np.array(ORDERS), TONES) + 3e-5


def test_exact_without_noise_where_the_transform_and_spin_alone_are_not():
    found = lines_beside_spin(block(), RATE, LINES, SPIN, ORDERS)
    assert np.abs(found.amplitude - TRUTH).max() < 1e-12 * 10e-6
    assert np.abs(found.spin - TONES).max() < 1e-12 * 10e-6
    spectrum = np.fft.rfft(block())[np.round(LINES * COUNT / RATE).astype(int)] * 2 / COUNT
    assert np.abs(spectrum - TRUTH).max() > 1e-7
    design = np.exp(2j * np.pi * np.outer(TIME, SPIN * np.array(ORDERS)))
    design = np.hstack([np.ones((COUNT, 1)), design.real, design.imag])
    cleaned = block() - design @ np.linalg.lstsq(design, block(), rcond=None)[0]
    alone = np.fft.rfft(cleaned)[np.round(LINES * COUNT / RATE).astype(int)] * 2 / COUNT
    assert np.abs(alone - TRUTH).max() > 0.02e-7


def test_unbiased_and_of_the_stated_variance():
    rng = np.random.default_rng(0)
    found = lines_beside_spin(block() + rng.normal(0, 0.5e-6, (3, 100, COUNT)), RATE, LINES, SPIN, ORDERS)
    assert found.amplitude.shape == (3, 100, 11) and found.spin.shape == (3, 100, 3)
    error = (found.amplitude - TRUTH).reshape(300, -1)
    variance = 4 * 0.25e-12 / COUNT * found.inflation
    assert np.all(np.abs(error.mean(axis=0)) < 3.5 * np.sqrt(variance / 300))
    assert np.mean(np.abs(error) ** 2 / variance) == pytest.approx(1, abs=0.06)
    assert np.allclose(found.noise, variance, rtol=0.12)


def test_inflation_is_that_of_two_tones_when_one_is_near():
    """1 / (1 - sinc^2) of their distance in bins, when all else is far."""
    for bins in (0.5, 0.8):
        line = 4000.0
        found = lines_beside_spin(np.zeros(COUNT), RATE, [line], line + bins * RATE / COUNT, [1])
        assert found.inflation[0] == pytest.approx(1 / (1 - np.sinc(bins) ** 2), rel=2e-3)


def test_speed_found_from_a_rough_one():
    assert spin_speed(block(), RATE, LINES, SPIN + 0.8, ORDERS) == pytest.approx(SPIN, rel=1e-10)
    rng = np.random.default_rng(1)
    errors, scores = [], []
    for _ in range(20):
        samples = block() + rng.normal(0, 0.5e-6, COUNT)
        speed = spin_speed(samples, RATE, LINES, SPIN + 0.2, ORDERS)
        found = lines_beside_spin(samples, RATE, LINES, speed, ORDERS)
        errors.append(speed - SPIN)
        scores.append(np.abs(found.amplitude - TRUTH) ** 2 / found.noise)
    # Cramer-Rao: var(2 pi f) = 24 s^2 / (a^2 N T^2) of a single tone; orders n add up as (n a_n)^2.
    bound = np.sqrt(24 * 0.25e-12 / (10e-6**2 + (2 * 2e-6) ** 2 + (3 * 1e-6) ** 2) / COUNT) / (2 * np.pi * COUNT / RATE)
    assert np.std(errors) == pytest.approx(bound, rel=0.4)
    assert np.mean(scores) == pytest.approx(1, abs=0.25)
    with pytest.raises(ValueError, match="no speed within half a bin"):
        spin_speed(block(), RATE, LINES, SPIN + 2.3, ORDERS)


@pytest.mark.parametrize(
    "change, text",
    [
        ({"samples": [[np.nan] * 100]}, "samples"),
        ({"samples": np.zeros(20)}, "20 samples do not hold 12 tones"),
        ({"rate": 0.0}, "rate = 0.0"),
        ({"spin_hz": np.inf}, "spin_hz = inf"),
        ({"frequency": []}, "frequency must be"),
        ({"harmonics": [0, 1]}, "harmonics must be"),
        ({"harmonics": [80]}, "10664 Hz is not below half the rate, 10000 Hz"),
        ({"spin_hz": 139.9}, "139.9 and 140 Hz are 0.025 bins apart"),
    ],
)
def test_bad_input(change, text):
    good = {"samples": block(), "rate": RATE, "frequency": LINES, "spin_hz": SPIN, "harmonics": [1]}
    with pytest.raises(ValueError, match=text):
        lines_beside_spin(**(good | change))


def test_speed_takes_one_block():
    with pytest.raises(ValueError, match="one block"):
        spin_speed(np.zeros((2, COUNT)), RATE, LINES, SPIN, ORDERS)
