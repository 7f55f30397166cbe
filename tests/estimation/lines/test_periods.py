"""Line statistics against two-pass formulas, the hold against an exact mass-spring, transients by simulation."""

import tracemalloc

import numpy as np
import pytest
from drawn_spectra import two_channels
from scipy.linalg import expm

from estimation.lines.periods import (
    held,
    line_statistics,
    period_drift,
    period_spectra,
    split_periods,
    transient_periods,
    two_unsteady,
)


def noise(rng, shape):
    return (rng.standard_normal(shape) + 1j * rng.standard_normal(shape)) / np.sqrt(2)


def test_split_periods_keeps_whole_periods_in_order():
    signals = np.arange(2 * 11).reshape(2, 11)
    split = split_periods(signals, 4)
    assert split.shape == (2, 2, 4)
    assert np.array_equal(split[1, 0], [4, 5, 6, 7]) and np.array_equal(split[0, 1], [11, 12, 13, 14])


@pytest.mark.parametrize("samples", [0, 3, 7])
def test_split_periods_needs_two(samples):
    with pytest.raises(ValueError, match=f"{samples} samples hold {samples / 4:.2f} periods"):
        split_periods(np.zeros((2, samples)), 4)


def test_spectra_are_peak_amplitudes_in_the_cosine_convention():
    t = np.arange(200) / 200
    signals = np.array([3 * np.cos(2 * np.pi * 7 * t + 0.4), np.sin(2 * np.pi * 9 * t)])
    spectra = period_spectra(signals, np.array([7, 9]))
    assert np.allclose(spectra, [[3 * np.exp(0.4j), 0], [0, -1j]], atol=1e-13)


def test_line_statistics_equal_the_two_pass_formulas():
    rng = np.random.default_rng(0)
    z = noise(rng, (7, 4, 3, 5)) + 1e6 * noise(rng, (4, 3, 5))  # a large mean: cancellation would show
    s = line_statistics(iter(z), 0.5, np.arange(2, 7), ("a", "b", "c"))
    assert s.periods == 7 and np.array_equal(s.frequency, [1, 1.5, 2, 2.5, 3])
    assert np.allclose(s.mean, z.mean(axis=0), rtol=1e-14)
    for lane in range(4):
        for line in range(5):
            expected = np.cov(z[:, lane, :, line], rowvar=False) / 7
            assert np.allclose(s.covariance[lane, :, :, line], expected, rtol=1e-8, atol=1e-9)


def test_cross_covariance_is_of_a_times_conjugate_b_over_periods():
    rng = np.random.default_rng(1)
    b = noise(rng, (20000, 1, 1))
    z = np.concatenate([(0.3 + 2j) * b, b], axis=1)
    s = line_statistics(z, 1.0, [1], ("a", "b"))
    scale = np.abs(b).var() + np.abs(b).mean() ** 2
    assert s.cross("a", "b")[0] * 20000 == pytest.approx((0.3 + 2j) * scale, rel=1e-3)
    assert s.cross("b", "a")[0] == pytest.approx(np.conj(s.cross("a", "b")[0]))
    assert s.cross("a", "a").dtype == float
    with pytest.raises(ValueError, match="'c' is missing"):
        s.cross("a", "c")


def test_covariance_is_that_of_the_mean():
    z = noise(np.random.default_rng(2), (6, 3000, 1, 4))
    s = line_statistics(z, 1.0, np.arange(4), ("a",))
    assert s.cross("a", "a").mean() == pytest.approx(np.mean(np.abs(s.amplitude("a")) ** 2), rel=0.05)
    assert s.cross("a", "a").mean() == pytest.approx(1 / 6, rel=0.03)


@pytest.mark.parametrize("periods", [0, 1])
def test_a_covariance_needs_two_periods(periods):
    with pytest.raises(ValueError, match=f"{periods} whole periods"):
        line_statistics(iter(np.zeros((periods, 1, 2), complex)), 1.0, [1, 2], ("a",))


def test_periods_stream_through_one_reused_buffer_in_constant_memory():
    rng, buffer, lines = np.random.default_rng(3), np.empty((2, 20000), complex), np.arange(20000)

    def periods(count):
        for _ in range(count):
            buffer[...] = rng.standard_normal((2, 1))
            yield buffer

    def peak(count):
        tracemalloc.start()
        line_statistics(periods(count), 1.0, lines, ("a", "b"))
        peak = tracemalloc.get_traced_memory()[1]
        tracemalloc.stop()
        return peak

    assert peak(40) < peak(4) + buffer.nbytes / 2
    reused = np.array([1.0, 2.0, 6.0])
    one = np.empty((1, 1), complex)
    s = line_statistics((one.__setitem__(..., x) or one for x in reused), 1.0, [1], ("a",))
    assert s.mean[0, 0] == pytest.approx(3.0) and s.covariance[0, 0, 0].real == pytest.approx(7 / 3)


def held_response(force, rate, m, k, c, lines):
    """Steady period of a mass-spring under a held force; Fourier coefficients of its continuous position at `lines`.

    The modal integral of each sample interval is exact, by the matrix exponential: no sampling, so no aliasing.
    """
    dt, n = 1 / rate, len(force)
    a = np.array([[0, 1], [-k / m, -c / m]])
    phi = expm(a * dt)
    gamma = np.linalg.solve(a, (phi - np.eye(2)) @ np.array([0, 1 / m]))
    whole, driven = np.linalg.matrix_power(phi, n), np.zeros(2)
    for f in force:
        driven = phi @ driven + gamma * f
    state, coefficient = np.linalg.solve(np.eye(2) - whole, driven), np.zeros(len(lines), complex)
    s = 2j * np.pi * np.asarray(lines) * rate / n
    maps = []
    for si in s:
        big = np.zeros((4, 4), complex)  # position, velocity, force, integral of position * exp(-s t)
        big[:2, :2], big[1, 2] = a - si * np.eye(2), 1 / m
        big[2, 2] = -si
        big[3, 0] = 1
        maps.append(expm(big * dt)[3, :3])
    for i, f in enumerate(force):
        here = np.array([*state, f])
        coefficient += [row @ here * np.exp(-si * i * dt) for row, si in zip(maps, s, strict=True)]
        state = phi @ state + gamma * f
    return 2 * coefficient * rate / n


def test_held_force_is_exact_for_a_mass_spring():
    m, k, c, rate, n = 0.13, 2471.0, 3.1, 2000.0, 500
    lines = np.array([1, 5, 11, 40, 62])  # to 248 Hz: an eighth of the rate, half a sample is 22 degrees
    t = np.arange(n) / n
    force = np.cos(2 * np.pi * np.outer(lines, t) + np.arange(5)[:, None]).sum(axis=0)
    f = lines * rate / n
    y = held_response(force, rate, m, k, c, lines)
    measured = two_channels(f, period_spectra(force[None], lines)[0], y, np.array([[1, 2j], [-2j, 9]]))
    corrected = held(measured, "force", rate)
    w = 2 * np.pi * f
    exact = k - m * w**2 + 1j * w * c
    ratio = corrected.amplitude("force") / corrected.amplitude("displacement")
    assert np.abs(ratio / exact - 1).max() < 1e-9
    plain = measured.amplitude("force") / measured.amplitude("displacement")
    assert (plain - exact).imag[0] / w[0] == pytest.approx(k / rate / 2, rel=0.05)  # what the docstring warns of
    factor = corrected.amplitude("force") / measured.amplitude("force")
    assert np.allclose(corrected.cross("force", "force"), 9 * np.abs(factor) ** 2)
    assert np.allclose(corrected.cross("force", "displacement"), -2j * factor)
    assert np.allclose(corrected.cross("displacement", "displacement"), 1)


@pytest.mark.parametrize("periods", [3, 6])
def test_pure_noise_is_rarely_called_a_transient(periods):
    rng, level = np.random.default_rng(4), 0.02
    signal = noise(rng, 12) * 10
    dropped = np.array([transient_periods(signal + noise(rng, (periods, 12)), level) for _ in range(2500)])
    assert abs((dropped > 0).mean() - level) < 3.5 * np.sqrt(level * (1 - level) / dropped.size)
    assert (dropped > 1).mean() < level / 2


def transient_record(rng, size, decay, periods=8):
    """Spectra of a steady multisine with white noise and a transient of `size` that decays by `decay` per period."""
    n, lines = 400, np.arange(1, 31)
    t = np.arange(n * periods) / n
    steady = np.cos(2 * np.pi * np.outer(lines, t) + rng.uniform(0, 2 * np.pi, (30, 1))).sum(axis=0)
    x = steady + size * decay**t * np.cos(2 * np.pi * 8.3 * t) + 0.5 * rng.standard_normal(t.size)
    return np.array([period_spectra(p, lines)[0] for p in split_periods(x[None], n)])


@pytest.mark.parametrize(
    ("size", "decay", "low", "high"),
    [(3.0, 1e-3, 1, 1), (30.0, 0.1, 2, 2), (30.0, 0.5, 4, 5)],  # the last also swells the later periods' variance
)
def test_an_exponential_transient_is_found(size, decay, low, high):
    rng = np.random.default_rng(5)
    found = np.array([transient_periods(transient_record(rng, size, decay)) for _ in range(100)])
    assert ((found >= low) & (found <= high)).mean() > 0.95


def test_a_transient_of_a_few_lines_among_many_is_found():
    """A sharp mode rings on four of 240 lines: three standard deviations there are nothing in the sum of them all."""
    rng, ringing = np.random.default_rng(8), np.zeros(240)
    ringing[100:104] = 4.0
    found = [transient_periods(noise(rng, (8, 240)) + ringing * (np.arange(8) == 0)[:, None]) for _ in range(60)]
    assert np.mean(np.equal(found, 1)) > 0.9


def test_three_periods_are_kept_and_two_of_three():
    rng = np.random.default_rng(6)
    for periods in range(1, 8):
        drifting = 50.0 * 0.2 ** np.arange(periods)[:, None] + 1e-6 * noise(rng, (periods, 10))
        assert transient_periods(drifting) == {1: 0, 2: 0, 3: 1}.get(periods, periods - 3)
    assert transient_periods(np.ones((6, 10), complex)) == 0  # no noise and no transient


def test_of_three_periods_the_start_of_the_excitation_is_dropped():
    rng = np.random.default_rng(7)
    assert [transient_periods(transient_record(rng, 10.0, 1e-3, periods=3)) for _ in range(20)] == [1] * 20


def test_two_periods_that_only_noise_tells_apart_are_steady():
    rng = np.random.default_rng(11)
    pairs = noise(rng, (20_000, 2, 20)) / np.arange(1, 21)  # coloured, as the noise of a loop is
    assert not any(two_unsteady(100 + pair) for pair in pairs)
    assert not two_unsteady(np.ones((2, 20), complex)) and not two_unsteady(noise(rng, (2, 1)))


def test_of_two_periods_a_transient_counts_that_is_more_than_the_noise():
    rng = np.random.default_rng(12)
    found = [two_unsteady(transient_record(rng, size, 1e-3, periods=2)) for size in (10.0, 0.1) for _ in range(40)]
    assert all(found[:40]) and not any(found[40:])
    decay = 1 / (1 + 1j * np.arange(1, 30))
    assert two_unsteady(np.stack([1 + 0.01 * decay, np.ones(29)]))
    assert not two_unsteady(np.stack([1 + 1e-4 * decay, np.ones(29)]))  # too small to matter


def shifted(samples, periods, lines):
    """Spectra of periods of a signal of some lines that run ahead by so many samples each."""
    w = 2 * np.pi * lines / 1000
    clean = np.exp(0.7j * lines**2) * np.exp(1j * np.outer(np.arange(periods) * samples, w))
    return clean, w


@pytest.mark.parametrize("samples", [0.0, 0.02, -0.9])
def test_a_clock_that_runs_ahead_is_told_by_its_periods(samples):
    spectra, w = shifted(samples, 12, np.arange(5, 300, 7))  # the highest line turns by ten radians in all
    slope, error = period_drift(spectra + 1e-3 * noise(np.random.default_rng(3), spectra.shape), w)
    assert abs(slope - samples) < 4 * error < 1e-3


@pytest.mark.parametrize("kept", [[1, 3, 5, 7, 9], [1, 2, 3, 4, 8, 9], [0, 2, 3, 9]])
def test_periods_that_are_left_out_leave_the_drift_of_the_others_as_it_is(kept):
    spectra, w = shifted(0.05, 10, np.arange(5, 300, 7))
    rng = np.random.default_rng(4)
    found = np.array([
        period_drift((spectra + 1e-3 * noise(rng, spectra.shape))[kept], w, kept) for _ in range(100)
    ])  # fmt: skip
    assert np.mean(abs(found[:, 0] - 0.05) < 3 * found[:, 1]) > 0.9
    assert abs(found[:, 0].mean() - 0.05) < 4 * found[:, 0].std() / 10 and found[:, 1].max() < 1e-3


def test_the_error_of_a_drift_is_never_far_below_its_scatter():
    """Of few periods the scatter about a line may be nothing by chance; the noise of the lines still is there."""
    spectra, w = shifted(0.1, 4, np.arange(5, 105, 5))
    rng = np.random.default_rng(5)
    found = np.array([period_drift(spectra + 0.02 * noise(rng, spectra.shape), w) for _ in range(600)])
    scatter = found[:, 0].std()
    assert abs(found[:, 0].mean() - 0.1) < 4 * scatter / np.sqrt(600)
    # The noise of the middle period, of which all shifts are taken, counts with each of the others'.
    assert 0.8 * scatter < np.quantile(found[:, 1], 0.01) < 1.5 * scatter
    assert np.median(found[:, 1]) < 2 * scatter


def test_few_periods_or_signals_that_are_no_copies_tell_no_drift():
    spectra, w = shifted(0.1, 4, np.arange(5, 105, 5))
    assert period_drift(spectra[:3], w) is None and period_drift(0 * spectra, w) is None
    rng = np.random.default_rng(6)
    assert period_drift(spectra + noise(rng, spectra.shape), w) is None
