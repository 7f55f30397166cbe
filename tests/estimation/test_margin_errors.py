"""Errors of margins to first order, against the scatter of margins over drawn noise."""

import numpy as np
import pytest

from estimation.margin_errors import margin_errors
from estimation.stability_margins import margin_arrays

LINES = np.geomspace(8.0, 2000.0, 160)
NAMES = ("peak_sensitivity", "disk_margin", "phase_margin", "gain_margin_high", "gain_margin_low")


def sensitivity(kp, kd, ki, delay):
    """A magnet's loop under PID with a leaking integral, behind a lag and a delay."""
    s = 2j * np.pi * LINES
    pid = kp + kd * s / (1 + 1e-4 * s) + ki / (0.002 + s)
    return 1 / (1 + 5.7 * pid * np.exp(-delay * s) / ((0.08 * s**2 - 12.5e3) * (1 + 1e-4 * s)))


@pytest.mark.parametrize(
    "gains",
    [(6000.0, 4.0, 4e5, 1e-4), (4500.0, 8.0, 5e5, 1.5e-4), (9000.0, 9.0, 8e5, 0.0)],
    ids=["near", "slow", "far"],
)
@pytest.mark.parametrize("tilt", [0.0, 1.0])
def test_margins_scatter_as_their_errors_say(gains, tilt):
    """A crossing between two lines has the noise of both, up to a root of two less than the nearest line alone."""
    clean = sensitivity(*gains)
    variance = 1e-7 * np.abs(clean) ** 2 * (LINES / 100.0) ** tilt
    rng = np.random.default_rng(4)
    white = rng.standard_normal((2, 3000, LINES.size)) * np.sqrt(variance / 2)
    drawn = margin_arrays(LINES, clean + white[0] + 1j * white[1])
    errors = margin_errors(LINES, clean[None], variance[None], margin_arrays(LINES, clean[None]))
    for name in NAMES:
        assert 0.95 * drawn[name].std() < errors[name][0] < 1.5 * drawn[name].std(), name


def test_a_margin_that_is_missing_has_no_error():
    s = 2j * np.pi * LINES
    clean = 1 / (1 + 1e4 / (s + 10.0))[None]  # its phase reaches no half turn
    margins = margin_arrays(LINES, clean)
    assert np.isnan(margins["gain_margin_high"][0])
    errors = margin_errors(LINES, clean, np.full(clean.shape, 1e-6), margins)
    assert np.isnan(errors["gain_margin_high"][0]) and np.isfinite(errors["peak_sensitivity"][0])
