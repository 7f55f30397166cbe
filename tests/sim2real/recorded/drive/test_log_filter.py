"""A low-pass in front of a log is told from noise that another program filtered."""

import numpy as np
import pytest
import scipy.signal

from sim2real.recorded.drive.log_filter import TERMS, log_corner

FINER, NOISE = 16, 1e-6
LEVEL = 2 * NOISE**2 / FINER  # of white noise at the finer rate, per cycle per sample of the log


def log(poles: int, corner: float, seed: int) -> np.ndarray:
    """A slow motion with white noise, behind an analog Butterworth filter, sampled every FINER-th time."""
    rng, n = np.random.default_rng(seed), 8000 * FINER
    moved = 1e-4 * np.sin(2 * np.pi * 0.01 / FINER * np.arange(n)) + NOISE * rng.standard_normal(n)
    if not poles:
        return moved[::FINER]
    return scipy.signal.sosfilt(scipy.signal.butter(poles, corner / FINER, fs=1.0, output="sos"), moved)[::FINER]


@pytest.mark.parametrize(("poles", "corner"), [(1, 0.06), (2, 0.1), (4, 0.08), (6, 0.2)])
def test_a_filter_is_told_from_the_noise(poles, corner):
    assert log_corner(log(poles, corner, poles), 0.05, LEVEL) == pytest.approx(corner, rel=0.25)


def test_without_its_level_a_steep_filter_is_told_too():
    assert log_corner(log(6, 0.2, 1), 0.05, 0.0) == pytest.approx(0.2, rel=0.25)


def test_white_noise_and_a_motion_up_to_the_highest_frequency_show_no_filter():
    assert log_corner(log(0, 0.0, 1), 0.05, LEVEL) is None
    assert log_corner(log(4, 0.08, 1), 0.46, LEVEL) is None


@pytest.mark.parametrize("poles", [1, 2, 4, 6, 8])
def test_no_filter_has_larger_terms_than_are_allowed_for(poles):
    s = 0.05  # of the corner; the inverse filter without its delay is 1 plus its terms
    b, a = scipy.signal.butter(poles, 1.0, analog=True)
    delay = a[-2] / a[-1]
    left = np.exp(-delay * s) * np.polyval(a, s) / b[-1] - 1
    assert abs(left) < sum(size * s**order for order, size in TERMS.items())
