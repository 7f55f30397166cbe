"""Smooth curves through noisy loops: against dense matrices, and what their variances hold."""

import numpy as np
import pytest

from estimation.lines.curves import smooth_response
from estimation.lines.smooth_loop import smooth_closed_loop, smooth_responses
from estimation.stability_margins import margin_arrays

FREQUENCY = np.unique(np.r_[np.arange(5.0, 250.0, 5.0), np.geomspace(260.0, 2000.0, 42)])
RNG = np.random.default_rng(5)


def loop_gain(f=FREQUENCY):
    """An unstable plant under PD with a delay, as of a magnetic bearing: kp and kd of 1.8 and 0.8 / 90 Hz."""
    s = 2j * np.pi * f
    w = 2 * np.pi * 60.0
    return (2.2 + 1.6 * s / w) / ((s / w) ** 2 - 1) * np.exp(-3e-4 * s)


def noise(shape, variance):
    return np.sqrt(variance / 2) * (RNG.standard_normal(shape) + 1j * RNG.standard_normal(shape))


def test_the_curve_is_that_of_the_dense_smoother():
    true, variance = loop_gain(), (0.03 * np.abs(loop_gain()) + 0.02) ** 2
    noisy = true + noise(true.shape, variance)
    curve, spread = smooth_responses(FREQUENCY, noisy[None], variance[None])
    # Both choose among a number of smoothnesses: far less than the noise lies between two of these.
    apart = np.abs(curve[0] - smooth_response(FREQUENCY, noisy, variance)) / np.sqrt(variance)
    assert apart.max() < 0.3 < np.abs(curve[0] - noisy).max() / np.sqrt(variance).max()
    # The smoother is a matrix; its diagonal is the variance over that of the noise, and its trace that of a fit.
    assert (spread > 0).all() and (spread[0] <= variance).all()
    assert 4 < (spread[0] / variance).sum() < 45


def test_variances_hold_what_curves_miss():
    true, variance = loop_gain(), (0.03 * np.abs(loop_gain()) + 0.02) ** 2
    noisy = true + noise((300, true.size), variance)
    curve, spread = smooth_responses(FREQUENCY, noisy, np.broadcast_to(variance, noisy.shape))
    missed = np.abs(curve - true) ** 2 / spread
    assert 0.7 < missed.mean() < 1.3
    assert np.abs(curve - true).mean() < 0.7 * np.abs(noisy - true).mean()


def test_peaks_and_gain_margins_are_not_those_of_the_noise():
    true = 1 / (1 + loop_gain())
    wanted = {name: float(v) for name, v in margin_arrays(FREQUENCY, true).items()}
    noisy = true + noise((200, true.size), 0.02**2 * np.abs(true) ** 2)
    smooth, _ = smooth_closed_loop(FREQUENCY, noisy, np.broadcast_to(0.02**2 * np.abs(true) ** 2, noisy.shape))
    before, after = (margin_arrays(FREQUENCY, s) for s in (noisy, smooth))
    for name, worse in (("peak_sensitivity", 0.01), ("disk_margin", 0.008)):
        assert abs(before[name].mean() / wanted[name] - 1) > worse
        assert after[name].mean() == pytest.approx(wanted[name], rel=worse / 2)
    own = wanted["gain_margin_high"]
    missed = [np.median(np.abs(found["gain_margin_high"] / own - 1)) for found in (before, after)]
    assert missed[1] < 0.8 * missed[0]
    assert np.median(after["gain_margin_high"]) == pytest.approx(own, rel=0.03)


def test_what_scatters_between_lines_without_being_noise_widens_the_variance():
    true = 1 / (1 + loop_gain())
    variance = np.broadcast_to(0.002**2 * np.abs(true) ** 2, (200, true.size))  # a tenth of the scatter
    scatter = 0.02**2 * np.abs(true) ** 2
    _, wide = smooth_closed_loop(FREQUENCY, true + noise((200, true.size), scatter), variance)
    assert 0.7 < np.median(wide / scatter) < 1.6
    _, plain = smooth_closed_loop(FREQUENCY, true + noise((200, true.size), variance[0]), variance)
    assert np.median(plain / variance) < 0.5


def test_any_layout_of_the_arrays_gives_the_same_and_no_noise_changes_nothing():
    true = loop_gain()
    noisy = true + noise((3, true.size), 1e-3)
    variance = np.full(noisy.shape, 1e-3)
    wanted, _ = smooth_responses(FREQUENCY, noisy, variance)
    turned, _ = smooth_responses(FREQUENCY, np.asfortranarray(noisy), np.asfortranarray(variance))
    assert np.array_equal(turned, wanted) and not np.array_equal(wanted, noisy)
    variance[1] = 0.0
    same, spread = smooth_responses(FREQUENCY, noisy, variance)
    assert np.array_equal(same[1], noisy[1]) and not spread[1].any()
    assert np.array_equal(same[[0, 2]], wanted[[0, 2]])


def test_a_response_that_is_not_finite_has_no_curve_and_leaves_the_others_theirs():
    variance = np.full((3, FREQUENCY.size), 1e-4)
    noisy = np.stack([loop_gain(), 2 * loop_gain(), 3 * loop_gain()]) + noise(variance.shape, variance)
    broken = noisy.copy()
    broken[1, 7] = np.nan
    expected, curves = smooth_responses(FREQUENCY, noisy, variance), smooth_responses(FREQUENCY, broken, variance)
    np.testing.assert_array_equal(curves[0][1], broken[1])
    assert np.isnan(curves[1][1]).all()
    for found, whole in zip(curves, expected, strict=True):
        np.testing.assert_array_equal(found[[0, 2]], whole[[0, 2]])


def test_the_uncertainty_of_the_softest_line_is_its_own():
    """The dynamic stiffness of a slow loop spans three decades, and noise hides its stiff end."""
    f = np.arange(2.0, 250.0)
    w, rng = 2 * np.pi * f, np.random.default_rng(3)
    true = 1 / (60.0 - 0.046 * w**2 + 2j * w)
    variance = np.full((60, f.size), 4e-5**2)
    noisy = true + 4e-5 / np.sqrt(2) * (rng.standard_normal((60, f.size, 2)) @ [1, 1j])
    curve, spread = smooth_closed_loop(f, noisy, variance)
    error, claimed = np.abs(curve[:, 0]) - np.abs(true[0]), np.sqrt(spread[:, 0] / 2)
    assert claimed.min() > 0.5 * error.std() and claimed.max() < 2 * error.std()
