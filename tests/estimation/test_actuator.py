"""Actuator gain and negative stiffness from the current through a magnet, by simulation."""

from dataclasses import replace

import numpy as np
import pytest
from drawn_spectra import draw, record, two_channels

from estimation.actuator import actuator_estimate, as_force
from estimation.modal import global_fit

F = np.arange(2.0, 121.0, 2.0)
W = 2 * np.pi * F
MASS = 0.08012
FALLING = (5.7, -12.5e3, 0.4)


def statistics(gain, k, c, noise=0.0):
    """The current and displacement that an injection of equal lines makes, with noise that the two share."""
    displacement = 2e-6 * np.exp(0.2j * F**1.5) / (1 + (F / 80) ** 2)
    current = (k - MASS * W**2 + 1j * W * c) * displacement / gain
    root = noise * np.array([[1e-8, 0.0], [-60e-6, 40e-6]])  # displacement, then what the controller makes of it
    s = two_channels(F, current, displacement, root @ root.T)
    return replace(s, channels=("displacement", "current"))


@pytest.mark.parametrize("truth", [FALLING, (-1.3, 4e3, -0.2)])
def test_exact_without_noise(truth):
    found = actuator_estimate(statistics(*truth), MASS)
    assert (found.gain, found.stiffness, found.damping) == pytest.approx(truth, rel=1e-7)


def test_standard_errors_cover():
    records = 400
    drawn = draw(statistics(*FALLING, noise=1.0), records, seed=3)
    found = [actuator_estimate(record(drawn, i), MASS) for i in range(records)]
    for name, true in zip(("gain", "stiffness", "damping"), FALLING, strict=True):
        value, se = (np.array([getattr(e, name + s) for e in found]) for s in ("", "_se"))
        assert abs(value.mean() - true) < 4 * value.std() / np.sqrt(records)
        assert value.std() / np.sqrt(np.mean(se**2)) == pytest.approx(1, abs=0.12)
        assert abs(np.mean(np.abs(value - true) < 1.96 * se) - 0.95) < 3 * np.sqrt(0.95 * 0.05 / records)
        assert value.std() < 0.1 * abs(true) + 0.2, "a record that says nothing would cover too"


def test_standard_errors_follow_from_those_of_the_fit():
    """By differences, with a damping large enough for the error of the scale to matter in it."""
    one = record(draw(statistics(5.7, -12.5e3, 60.0, noise=3.0), 1, seed=4), 0)
    fit, found = global_fit(as_force(one, "current", 1.0)), actuator_estimate(one, MASS)

    def scaled(p):
        return MASS / p[2] * np.array([1.0, p[0], p[1]])

    steps = np.diag(1e-5 * np.abs(fit.values))
    slopes = np.array([(scaled(fit.values + h) - scaled(fit.values - h)) / (2 * h.sum()) for h in steps]).T
    se = np.sqrt(np.diag(slopes @ fit.covariance @ slopes.T))
    assert (found.gain_se, found.stiffness_se, found.damping_se) == pytest.approx(se, rel=1e-4)


def test_the_mass_sets_the_scale_and_must_be_known():
    s = statistics(*FALLING)
    twice = actuator_estimate(s, 2 * MASS)
    assert (twice.gain, twice.stiffness) == pytest.approx((2 * FALLING[0], 2 * FALLING[1]), rel=1e-6)
    with pytest.raises(ValueError, match="mass = 0 kg must be positive"):
        actuator_estimate(s, 0)


def test_as_force_renames_scales_and_drops_the_recorded_force():
    s = statistics(*FALLING, noise=1.0)
    s = replace(s, channels=("force", "current"))
    f = as_force(s, "current", 3.0)
    assert f.channels == ("force",)
    np.testing.assert_allclose(f.amplitude("force"), 3 * s.amplitude("current"))
    np.testing.assert_allclose(f.cross("force", "force"), 9 * s.cross("current", "current"))
