"""The tracker against other optimisers and filters, and by simulation: bias, coverage, changes, spin, bad input."""

from dataclasses import replace

import numpy as np
import pytest
from filterpy.kalman import ExtendedKalmanFilter
from scipy.optimize import least_squares

from estimation.lines.periods import period_spectra
from estimation.lines.spin import lines_beside_spin
from estimation.multisine.line_choice import lines_off_spin
from estimation.multisine.low_crest import low_crest
from estimation.online.tracking import Block, Tracker, TrackerSettings, noise_from_scatter, track

MASS, STIFFNESS, DAMPING = 0.08012, 34e3, 28.0
RATE, SAMPLES, PROBE = 20e3, 5000, 0.5e-6
TIME_STEP = SAMPLES / RATE
LINES = np.arange(5, 101, 4)
FREQUENCY = LINES * RATE / SAMPLES
W = 2 * np.pi * FREQUENCY
NOISE = 4 * PROBE**2 / SAMPLES
SETTINGS = TrackerSettings(STIFFNESS, DAMPING, MASS, 0.002, 0.01)


def force(peak=0.075):
    multisine = low_crest(LINES, SAMPLES, peak)
    return multisine.amplitudes * np.exp(1j * multisine.phases)


FORCE = force()


def response(stiffness, damping, force=FORCE):
    stiffness, damping = (np.atleast_1d(a)[:, None] for a in (stiffness, damping))
    return force / (stiffness - MASS * W**2 + 1j * W * damping)


def complex_noise(rng, shape, variance):
    return np.sqrt(variance / 2) * (rng.normal(size=shape) + 1j * rng.normal(size=shape))


def wandering(rng, blocks):
    walk = rng.normal(0, np.sqrt(TIME_STEP), (2, blocks)).cumsum(axis=1)
    return STIFFNESS * (1 + 0.002 * walk[0]), DAMPING * (1 + 0.01 * walk[1])


def tracked(rng, stiffness, damping, strength=1.0, settings=SETTINGS, noise=NOISE):
    y = response(stiffness, damping, strength * FORCE)
    y = y + complex_noise(rng, y.shape, NOISE)
    return track(settings, FREQUENCY, TIME_STEP * np.arange(1, len(y) + 1), strength * FORCE, y, noise)


def scores(found, stiffness, damping):
    return np.array([(found.stiffness - stiffness) / found.stiffness_se, (found.damping - damping) / found.damping_se])


@pytest.mark.parametrize("stiffness, guess", [(36e3, 34e3), (12e3, 33e3), (-8e3, 34e3), (90e3, -20e3)])
@pytest.mark.parametrize("force_noise", [0.0, (3e-4) ** 2])
def test_one_block_is_the_posterior_mode(stiffness, guess, force_noise):
    """Minimum of the errors-in-variables cost plus the prior, by another optimiser; errors from its curvature."""
    rng = np.random.default_rng(3)
    settings = TrackerSettings(guess, 20.0, MASS, 0.0, 0.0, start=0.8, opening=1e-9)
    y = response(stiffness, 28.0)[0] + complex_noise(rng, W.size, NOISE)
    f = FORCE + complex_noise(rng, W.size, force_noise)
    prior, spread = np.array([guess, 20.0]), 0.8 * np.array([abs(guess), 20.0])

    def cost(x):
        z = x[0] * spread[0] - MASS * W**2 + 1j * W * x[1] * spread[1]
        r = (y - f / z) / np.sqrt((NOISE + force_noise / np.abs(z) ** 2) / 2)
        return np.concatenate([r.real, r.imag, x - prior / spread])

    best = least_squares(cost, [stiffness / spread[0], 28.0 / spread[1]], xtol=1e-14, ftol=1e-14, gtol=1e-14)
    found = Tracker(settings, FREQUENCY).update(Block(0.0, f, y, NOISE, force_noise))
    errors = spread * np.sqrt(np.diag(np.linalg.inv(best.jac.T @ best.jac)))
    state = np.array([found.stiffness, found.damping])
    assert np.all(np.abs(state - best.x * spread) < 0.01 * errors)
    assert np.allclose([found.stiffness_se, found.damping_se], errors, rtol=0.02 if force_noise else 1e-3)


def test_near_the_truth_equals_the_plain_extended_filter_on_all_lines():
    """filterpy's filter with the 2 n real and imaginary parts as its measurement: state, errors and chi-square."""
    rng = np.random.default_rng(4)
    settings = replace(SETTINGS, start=1e-3)
    stiffness, damping = np.full(12, STIFFNESS), np.full(12, DAMPING)
    y = response(stiffness, damping) + complex_noise(rng, (12, W.size), NOISE)
    found = track(settings, FREQUENCY, TIME_STEP * np.arange(12), FORCE, y, NOISE)
    plain = ExtendedKalmanFilter(2, 2 * W.size)
    plain.x, plain.P = np.array([STIFFNESS, DAMPING]), np.diag([(1e-3 * STIFFNESS) ** 2, (1e-3 * DAMPING) ** 2])
    plain.R = NOISE / 2 * np.eye(2 * W.size)
    walk = np.diag([(0.002 * STIFFNESS) ** 2, (0.01 * DAMPING) ** 2]) * TIME_STEP

    def predicted(x):
        h = response(*x)[0]
        return np.concatenate([h.real, h.imag])

    def slopes(x):
        by_k = -(response(*x)[0] ** 2) / FORCE
        return np.array([np.concatenate([s.real, s.imag]) for s in (by_k, 1j * W * by_k)]).T

    for b in range(12):
        plain.Q = walk if b else 0 * walk
        plain.predict()
        plain.update(np.concatenate([y[b].real, y[b].imag]), slopes, predicted)
        state, errors = [found.stiffness[b], found.damping[b]], [found.stiffness_se[b], found.damping_se[b]]
        assert np.all(np.abs(state - plain.x) < 0.03 * np.sqrt(np.diag(plain.P)))
        assert np.allclose(errors, np.sqrt(np.diag(plain.P)), rtol=0.01)
        assert found.chi_square[b] == pytest.approx(plain.y @ plain.SI @ plain.y, rel=0.01)
        assert found.freedom[b] == 2 * W.size


def test_the_record_is_a_loop_over_the_online_tracker():
    rng = np.random.default_rng(5)
    y = response(np.full(6, STIFFNESS), np.full(6, DAMPING)) + complex_noise(rng, (6, W.size), NOISE)
    found = track(SETTINGS, FREQUENCY, np.arange(6.0), FORCE, y, NOISE)
    tracker = Tracker(SETTINGS, FREQUENCY)
    for b in range(6):
        one = tracker.update(Block(float(b), FORCE, y[b], np.full(W.size, NOISE)))
        assert one.stiffness == found.stiffness[b] and one.damping_se == found.damping_se[b]
        assert np.array_equal(one.innovation, found.innovation[b]) and one.chi_square == found.chi_square[b]


def test_a_line_without_weight_is_a_line_left_out():
    y = response(STIFFNESS, DAMPING)[0]
    spoilt, noise = y.copy(), np.full(W.size, NOISE)
    spoilt[3], noise[3] = 1.0, np.inf
    found = Tracker(SETTINGS, FREQUENCY).update(Block(0.0, FORCE, spoilt, noise))
    keep = np.arange(W.size) != 3
    expected = Tracker(SETTINGS, FREQUENCY[keep]).update(Block(0.0, FORCE[keep], y[keep], NOISE))
    assert found.stiffness == pytest.approx(expected.stiffness, rel=1e-12)
    assert found.stiffness_se == pytest.approx(expected.stiffness_se, rel=1e-12)
    assert found.freedom == expected.freedom == 2 * W.size - 2


@pytest.mark.slow
def test_unbiased_where_half_the_power_is_noise():
    """Least squares on the receptance would miss the stiffness by tens of per cent there (D eq 4.19 and noise)."""
    rng, strength = np.random.default_rng(6), 0.06
    y = response(STIFFNESS, DAMPING, strength * FORCE)[0]
    noisy = np.abs(y) ** 2 + NOISE
    drawn = np.sum(noisy * MASS * W**2 + (STIFFNESS - MASS * W**2) * np.abs(y) ** 2) / np.sum(noisy)
    assert abs(drawn / STIFFNESS - 1) > 0.5  # the limit of least squares
    last = []
    for _ in range(60):
        found = tracked(rng, np.full(120, STIFFNESS), np.full(120, DAMPING), strength, replace(SETTINGS, start=0.3))
        last.append([found.stiffness[40:].mean() / STIFFNESS - 1, found.damping[40:].mean() / DAMPING - 1])
    mean, error = np.mean(last, axis=0), np.std(last, axis=0) / np.sqrt(60)
    assert error[0] < 0.002 and abs(mean[0]) < 3 * error[0]
    assert error[1] < 0.005 and abs(mean[1]) < 0.015


def test_noise_of_the_force_counts_once_where_that_of_the_displacement_is_told_by_the_scatter():
    rng, blocks, variance = np.random.default_rng(17), 200, 1e-3**2
    y = response(np.full(blocks, STIFFNESS), DAMPING) + complex_noise(rng, (blocks, W.size), 1e-18)
    read = FORCE + complex_noise(rng, y.shape, variance)
    time = TIME_STEP * np.arange(1, blocks + 1)
    found = track(SETTINGS, FREQUENCY, time, read, y, force_noise=variance)
    known = track(SETTINGS, FREQUENCY, time, read, y, noise=1e-18, force_noise=variance)
    assert np.mean(known.chi_square / known.freedom) == pytest.approx(1, abs=0.05)
    assert np.mean(found.chi_square / found.freedom) == pytest.approx(1, abs=0.1)
    assert found.stiffness_se[-1] == pytest.approx(known.stiffness_se[-1], rel=0.1)


@pytest.mark.parametrize("left_out", [0, 16, 20])
def test_a_far_stiffness_is_found_beside_lines_that_are_left_out(left_out):
    """Noise of infinite variance is as if the lines were not there: they make no fit better."""
    used = np.arange(W.size) < W.size - left_out
    noise, rng, off = np.where(used, NOISE, np.inf), np.random.default_rng(18), []
    for stiffness in (9e4, 6e4, 1.5e4, -1e4, -3e4):
        y = response(stiffness, DAMPING, 0.03 * FORCE)[0]
        y = y + complex_noise(rng, W.size, NOISE)
        all_lines = Tracker(SETTINGS, FREQUENCY).update(Block(0.0, 0.03 * FORCE, y, noise))
        alone = Tracker(SETTINGS, FREQUENCY[used]).update(Block(0.0, 0.03 * FORCE[used], y[used], NOISE))
        off.append(all_lines.stiffness / alone.stiffness - 1)
    assert off == pytest.approx(np.zeros(5), abs=1e-3)


@pytest.mark.slow
@pytest.mark.parametrize("strength, known", [(1.0, True), (1.0, False), (0.1, True)])
def test_intervals_cover_a_wandering_truth(strength, known):
    rng, z, squares, chi = np.random.default_rng(7), [], [], []
    for _ in range(8 if strength == 1 else 24):
        truth = wandering(rng, 400)
        found = tracked(rng, *truth, strength, noise=NOISE if known else None)
        z.append(scores(found, *truth)[:, 50:])
        squares.append(found.innovation[50:])
        chi.append(found.chi_square / found.freedom)
    covered = np.mean(np.abs(z) < 1.96, axis=(0, 2))
    assert np.all((covered > 0.93) & (covered < 0.97)), covered
    assert np.allclose(np.std(np.concatenate(squares), axis=0), 1, atol=0.05)
    assert np.mean(chi) == pytest.approx(1, abs=0.01 if known else 0.03)


@pytest.mark.slow
@pytest.mark.parametrize("strength, usual, longest", [(1.0, 1, 1), (0.3, 2, 4), (0.1, 6, 16)])
def test_a_step_of_a_tenth_is_found_and_followed(strength, usual, longest):
    """Delay in blocks, from the first one after the step; then the new value within its intervals."""
    rng, delays, onsets, z = np.random.default_rng(8), [], [], []
    for run in range(40):
        stiffness = np.where(np.arange(90) < 50, 1.0, 1.1 if run % 2 else 0.9) * STIFFNESS
        found = tracked(rng, stiffness, np.full(90, DAMPING), strength)
        assert not found.alarm[:50].any() and np.isnan(found.onset[:50]).all()
        first = np.flatnonzero(found.alarm[:, 0])[0]
        delays.append(first - 49)
        onsets.append(found.onset[first] / TIME_STEP - 51)
        z.append(scores(found, stiffness, DAMPING)[:, first + 2])
    assert np.median(delays) <= usual and max(delays) <= longest, np.sort(delays)
    assert np.median(np.abs(onsets)) <= 1
    assert np.mean(np.abs(z) < 1.96) > 0.87 and np.std(z) < 1.2


def test_a_step_inside_a_block_is_settled_in_the_next():
    rng, z = np.random.default_rng(9), []
    for _ in range(20):
        y = response(np.r_[np.full(20, 1.0), np.full(6, 1.2)] * STIFFNESS, np.full(26, DAMPING))
        y[20] = (y[19] + y[20]) / 2
        y = y + complex_noise(rng, y.shape, NOISE)
        found = track(SETTINGS, FREQUENCY, TIME_STEP * np.arange(26), FORCE, y, NOISE)
        assert found.alarm[20, 0] and not found.alarm[21:].any()
        z.append((found.stiffness[21] - 1.2 * STIFFNESS) / found.stiffness_se[21])
    assert np.std(z) < 1.5 and abs(np.mean(z)) < 1


@pytest.mark.slow
def test_false_alarms_of_the_whole_tracker_come_at_the_stated_rate():
    rng, alarms = np.random.default_rng(10), 0
    settings = replace(SETTINGS, false_alarm_blocks=100)
    for _ in range(20):
        found = tracked(rng, *wandering(rng, 600), 0.3, settings)
        alarms += found.alarm.any(axis=1).sum()
    assert 12000 / alarms == pytest.approx(100, rel=0.25)  # 120 +- 11 alarms


def test_stiffness_may_turn_negative():
    rng = np.random.default_rng(11)
    stiffness = np.r_[np.full(10, 8e3), np.full(10, -8e3)]
    found = tracked(rng, stiffness, np.full(20, DAMPING))
    z = scores(found, stiffness, DAMPING)[0]
    assert found.alarm[10, 0] and np.all(np.abs(z[12:]) < 4) and found.stiffness_se[-1] < 200


@pytest.mark.slow
def test_spin_of_a_hundred_times_the_response_does_not_bias():
    rng, spin_hz, orders, z, leaky = np.random.default_rng(12), 133.3, [1, 2, 3], [], []
    lines = lines_off_spin(LINES, RATE / SAMPLES, [60 * spin_hz], orders, 3.0)
    keep, strength = np.isin(LINES, lines), 0.25
    y = response(STIFFNESS, DAMPING, strength * FORCE)[0]
    assert 50 * np.abs(y).max() < 10e-6 and 100 * np.median(np.abs(y)) < 10e-6
    for _ in range(12):
        t = np.arange(20 * SAMPLES) / RATE
        x = np.real(y[keep] @ np.exp(1j * np.outer(W[keep], t))) + rng.normal(0, PROBE, t.size)
        for order, tone in zip(orders, (10e-6, 2e-6, 1e-6), strict=True):
            x += tone * np.cos(2 * np.pi * order * spin_hz * t + rng.uniform(0, 6.28))
        blocks = x.reshape(20, SAMPLES)
        found = lines_beside_spin(blocks, RATE, FREQUENCY[keep], spin_hz, orders)
        times = TIME_STEP * np.arange(1, 21)
        state = track(SETTINGS, FREQUENCY[keep], times, strength * FORCE[keep], found.amplitude, found.noise)
        z.append(scores(state, STIFFNESS, DAMPING)[:, -1])
        assert not state.alarm.any()
        spectra = period_spectra(blocks, LINES[keep])
        state = track(SETTINGS, FREQUENCY[keep], times, strength * FORCE[keep], spectra, found.noise)
        leaky.append(state.chi_square.mean() / state.freedom[0])
    assert np.all(np.abs(np.mean(z, axis=0)) < 3 / np.sqrt(12)) and np.abs(z).max() < 4
    assert np.min(leaky) > 10  # what would have come in without


def test_noise_from_scatter_survives_steps():
    rng = np.random.default_rng(13)
    levels = NOISE * np.linspace(0.5, 4, W.size)
    y = response(np.r_[np.full(300, 1.0), np.full(300, 2.0)] * STIFFNESS, np.full(600, DAMPING))
    scale = rng.uniform(0.5, 2, (600, 1))
    y = scale * y + complex_noise(rng, y.shape, levels)
    found = noise_from_scatter(scale * FORCE, y) / levels
    assert np.mean(found) == pytest.approx(1, abs=0.05) and np.std(found) == pytest.approx(1.7 / np.sqrt(600), rel=0.4)


@pytest.mark.parametrize(
    "change, text",
    [
        ({"mass": 0.0}, "mass = 0.0 must be positive"),
        ({"mass": -1.0}, "mass = -1.0 must be positive"),
        ({"stiffness": 0.0}, "stiffness = 0 cannot scale"),
        ({"damping": np.nan}, "damping = nan must be finite"),
        ({"stiffness_drift": -1e-3}, "stiffness_drift = -0.001 must be at least 0"),
        ({"opening": 0.0}, "opening = 0.0 must be positive"),
    ],
)
def test_bad_settings(change, text):
    with pytest.raises(ValueError, match=text):
        replace(SETTINGS, **change)


@pytest.mark.parametrize("frequency, text", [([], "at least one"), ([[1.0]], "shape"), ([5.0, -1.0], "not .-1")])
def test_bad_frequency(frequency, text):
    with pytest.raises(ValueError, match=text):
        Tracker(SETTINGS, frequency)


@pytest.mark.parametrize(
    "change, text",
    [
        ({"displacement": [1, np.nan]}, "block at 1.5 s: displacement must be finite; it is not at 40 Hz"),
        ({"force": [np.inf, 1]}, "force must be finite; it is not at 20 Hz"),
        ({"force": [1, 1, 1]}, r"force has the shape \(3,\); 2 lines are tracked"),
        ({"displacement": 1.0}, r"displacement has the shape \(\)"),
        ({"noise": [0, 1]}, "noise must be positive, inf to leave a line out; it is not at 20 Hz"),
        ({"noise": np.nan}, "noise must be positive.* at 20, 40 Hz"),
        ({"force_noise": -1.0}, "force_noise must be finite and at least 0"),
        ({"force": [0, 0]}, "no line has both a force and a finite noise"),
        ({"noise": np.inf}, "no line has both a force and a finite noise"),
        ({"time": 1.0}, "block at 1.0 s must come after the last one, at 1.0 s"),
        ({"time": np.nan}, "block at nan s"),
    ],
)
def test_bad_block_leaves_the_tracker_as_it_was(change, text):
    tracker, other = Tracker(SETTINGS, [20.0, 40.0]), Tracker(SETTINGS, [20.0, 40.0])
    first, second = (Block(t, [0.01, 0.01], [3e-7, 3e-7 - 1e-8j], NOISE) for t in (1.0, 1.5))
    tracker.update(first)
    other.update(first)
    with pytest.raises(ValueError, match=text):
        tracker.update(replace(second, **change))
    assert tracker.update(second).stiffness == other.update(second).stiffness


@pytest.mark.parametrize(
    "change, text",
    [
        ({"displacement": np.ones(3)}, r"displacement has the shape \(3,\)"),
        ({"time": [1.0, 2.0]}, r"time \(2,\)"),
        ({"force": np.ones(5)}, r"force has the shape \(5,\); it must broadcast with displacement \(3, 2\)"),
        ({"noise": None}, "at least 10 blocks"),
    ],
)
def test_bad_record(change, text):
    good = {"time": [1.0, 2.0, 3.0], "force": np.ones(2), "displacement": np.ones((3, 2)), "noise": NOISE}
    with pytest.raises(ValueError, match=text):
        track(SETTINGS, [20.0, 40.0], **(good | change))


def test_scatter_needs_a_force_at_every_line():
    with pytest.raises(ValueError, match="not zero"):
        noise_from_scatter(np.zeros((10, 2)), np.ones((10, 2)))
