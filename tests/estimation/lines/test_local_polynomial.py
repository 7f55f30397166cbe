"""Responses to excitations that never repeat: against exactly discretised systems, brute force, and by coverage."""

import tracemalloc

import numpy as np
import pytest
from scipy import signal, stats
from scipy.fft import irfft, rfft

from estimation.lines.frequency_response import coherence, frequency_response
from estimation.lines.local_polynomial import local_polynomial
from estimation.lines.periods import held
from estimation.max_likelihood import maximum_likelihood
from estimation.modal import modal_estimate
from estimation.stability_margins import margin_arrays, margins

M, K, C = 0.13, 2471.0, 3.1  # 22 Hz, 3.8 Hz wide at half power
RATE = 1000.0
CHANNELS = ("displacement", "force")
BAND = (2.0, 100.0)
NUMERATOR, DENOMINATOR, _ = signal.cont2discrete(([1], [M, C, K]), 1 / RATE)  # the force is held over each sample
NUMERATOR = NUMERATOR.ravel()


def move(force, start=(0.0, 0.0)):
    """Displacement under a held force, exact at the samples; start: filter state, zero at rest."""
    return signal.lfilter(NUMERATOR, DENOMINATOR, force, zi=np.array(start))[0]


def response(frequency):
    return signal.freqz(NUMERATOR, DENOMINATOR, 2 * np.pi * frequency / RATE)[1]


def moving_record(rng, samples, noise, start=2.0):
    """(displacement, force) of white force on a mass already moving; noise: of the reading, over the rms movement."""
    force = rng.standard_normal(samples)
    y = move(force, start * NUMERATOR[1] * 10 * rng.standard_normal(2))
    return np.array([y + noise * 2.44e-4 * rng.standard_normal(samples), force])


def force_response(statistics):
    return frequency_response(statistics, "displacement", "force")


def held_within(shares, expected, size, sigmas=3.5):
    """Coverage `shares` of `size` records agree with the expected one."""
    assert np.abs(np.asarray(shares) - expected).max() < sigmas * np.sqrt(expected * (1 - expected) / size)


def test_noise_free_response_is_exact_where_the_plain_ratio_leaks():
    record = moving_record(np.random.default_rng(0), 16000, noise=0.0, start=0.0)
    s = local_polynomial(record, CHANNELS, RATE, "force", BAND)
    g, truth = force_response(s)[0], response(s.frequency)
    error = np.abs(g / truth - 1)
    plain = np.abs((rfft(record[0]) / rfft(record[1]))[s.lines] / truth - 1)
    assert np.sqrt(np.mean(error**2)) < 1e-3 and error.max() < 8e-3
    assert np.sqrt(np.mean(plain**2)) > 100 * np.sqrt(np.mean(error**2))
    wide = local_polynomial(record, CHANNELS, RATE, "force", BAND, resolution=1.3)  # a window as wide as the resonance
    error = np.abs(force_response(wide)[0] / response(wide.frequency) - 1)[np.abs(wide.frequency - 22) < 4]
    assert 0.004 < np.sqrt(np.mean(error**2)) < 0.02


def test_error_falls_with_the_fourth_power_of_the_window():
    """Of the Taylor series of G three terms are fitted, and the zeros of the Legendre polynomial cancel the fourth.

    For constant |U|, without transient: a steady period. Any other three bins would leave the third power.
    """
    n = 64000
    u = np.exp(2j * np.pi * np.random.default_rng(1).uniform(size=n // 2 + 1))
    record = np.array([irfft(response(np.arange(n // 2 + 1) * RATE / n) * u, n), irfft(u, n)])
    rms = []
    for width in (93, 183):  # 1.5 and 2.9 Hz
        s = local_polynomial(record, CHANNELS, RATE, "force", (5, 50), resolution=width / 192)
        assert s.periods == width // 3 - 1 and s.lines[1] - s.lines[0] == round(np.sqrt(0.15) * width)
        rms.append(np.sqrt(np.mean(np.abs(force_response(s)[0] / response(s.frequency) - 1) ** 2)))
    assert np.log2(rms[1] / rms[0]) / np.log2(183 / 93) > 3.6


def test_agrees_with_least_squares_window_by_window():
    rng = np.random.default_rng(2)
    record = rng.standard_normal((3, 2000)) + np.array([[0.0], [1.0], [0.5]]) * rng.standard_normal(2000)
    s = local_polynomial(record, ("a", "b", "c"), 100.0, "b", (5.0, 20.0))
    spectra, spacing, width = rfft(record) / 1000, 0.05, 21
    assert np.array_equal(s.frequency, s.lines * spacing) and s.periods == 6
    centres = s.lines[1::3]
    assert len(s.lines) == 42 and np.array_equal(np.diff(centres), np.full(13, width))
    assert centres[0] - 10 >= 100 and centres[-1] + 10 <= 400
    for i, centre in enumerate(centres):
        r = np.arange(-10, 11)
        y, u = spectra[:, centre + r], spectra[1, centre + r]
        design = np.stack([u, u * r, u * r**2, np.ones(width), r, r**2], axis=1)
        inverse = np.linalg.inv(design.conj().T @ design)
        theta = inverse @ design.conj().T @ y.T
        residual = y - (design @ theta).T
        noise = residual @ residual.conj().T / 15
        for j, at in enumerate((-8, 0, 8)):
            row, line = np.array([1, at, at**2, 0, 0, 0]), 3 * i + j
            size = s.amplitude("b")[line]
            assert size.imag == 0 and size.real > 0 and s.lines[line] == centre + at
            assert np.allclose(s.mean[:, line] / size, row @ theta, rtol=1e-9, atol=1e-9)
            variance = (row @ inverse @ row).real * noise
            assert size.real**2 * 6 * (row @ inverse @ row).real == pytest.approx(1)
            keep = np.ix_([0, 2], [0, 2])
            assert np.allclose(s.covariance[:, :, line][keep] / size.real**2, variance[keep], rtol=1e-9, atol=0)
            assert not s.covariance[1, :, line].any() and not s.covariance[:, 1, line].any()


def test_covariance_between_channels_is_that_of_the_means_over_records():
    """One excitation, many draws of coloured noise common to two channels, in one of them delayed."""
    rng, n = np.random.default_rng(3), 3000
    u = rng.standard_normal(n)
    clean = np.array([signal.lfilter([1], [1, -0.7], u), signal.lfilter([0, 2], [1, 0.4], u)])
    means, covariances = [], []
    for _ in range(600):
        common = signal.lfilter([1], [1, -0.8], rng.standard_normal(n + 100))
        noise = np.array([common[100:], 0.5 * common[97:-3]]) + 0.3 * rng.standard_normal((2, n))
        s = local_polynomial(clean + noise, ("a", "b"), 1.0, u, (0.02, 0.4))
        means.append(s.mean)
        covariances.append(s.covariance)
    rest = means - np.mean(means, axis=0)
    sample = np.einsum("rin,rjn->ijn", rest, rest.conj()) / (len(means) - 1)
    claimed = np.mean(covariances, axis=0)
    w = 2 * np.pi * (s.lines[1::3] + np.arange(-10, 11)[:, None]) / n  # noise is averaged over each window
    density = 1 / np.abs(1 - 0.8 * np.exp(-1j * w)) ** 2
    cross = 0.5 * density * np.exp(3j * w)
    exact = np.repeat(np.array([[density, cross], [cross.conj(), 0.25 * density]]).mean(axis=2), 3, axis=-1)
    exact[[0, 1], [0, 1]] += 0.09
    exact *= 4 / n / s.periods
    scale = np.sqrt(exact[0, 0] * exact[1, 1]).real
    for found, tolerance in ((sample, 0.25), (claimed, 0.05)):
        assert np.abs((found - exact) / scale)[0, 1].max() < tolerance
        assert np.abs(found / exact - 1)[[0, 1], [0, 1]].max() < tolerance
        assert np.abs(np.mean((found - exact) / scale, axis=-1)).max() < 0.02
    # Lines are independent but for the unevenness of one excitation, which has no direction.
    root = np.sqrt(sample[[0, 1], [0, 1]].real)
    between = np.einsum("rin,rin->in", rest[:, :, :-1], rest[:, :, 1:].conj()) / len(means)
    between /= root[:, :-1] * root[:, 1:]
    assert np.sqrt(np.mean(np.abs(between) ** 2)) < 0.2 and np.abs(between.mean()) < 0.06


@pytest.mark.parametrize("pole", [0.0, 0.9])
def test_ellipses_and_intervals_of_the_response_cover(pole):
    rng, shares = np.random.default_rng(4), []
    for _ in range(120):
        record = moving_record(rng, 6000, noise=0.0)
        noise = signal.lfilter([1], [1, -pole], rng.standard_normal(6000))
        s = local_polynomial(record + np.array([3e-4 * noise, 0 * noise]), CHANNELS, RATE, "force", BAND)
        g, variance = force_response(s)
        off, freedom = g - response(s.frequency), 6 * (s.periods - 1)
        limit = stats.t.ppf(0.975, freedom) * np.sqrt(variance / 2)
        ellipse = np.abs(off) ** 2 / variance < stats.f.ppf(0.95, 2, freedom)
        shares.append([np.mean(np.abs(off.real) < limit), np.mean(np.abs(off.imag) < limit), np.mean(ellipse)])
    assert freedom == 30 and len(g) == 84
    # The three lines of a window share its noise estimate: fewer independent trials.
    held_within(np.mean(shares, axis=0), 0.95, 120 * 28)


def parameters(record, bands=((15.0, 30.0),), **options):
    s = held(local_polynomial(record, CHANNELS, RATE, "force", **options), "force", RATE)
    return s, maximum_likelihood(s, np.array(bands), M)


def assert_parameters_cover(estimates, records):
    k, c = (np.array([getattr(e, name)[0] for e in estimates]) for name in ("stiffness", "damping"))
    held_k = np.mean([e.stiffness_low[0] <= K <= e.stiffness_high[0] for e in estimates])
    held_c = np.mean([e.damping_low[0] <= C <= e.damping_high[0] for e in estimates])
    assert 0.93 <= held_k <= 0.97 and 0.93 <= held_c <= 0.97
    held_within([held_k, held_c], 0.95, records, sigmas=3)
    for value, truth in ((k, K), (c, C)):
        assert abs(value.mean() - truth) < 3.5 * value.std() / np.sqrt(records)
    return k, c


def white_bound(record_length, noise):
    """Cramer-Rao standard deviations of k and c from every bin of 15 .. 30 Hz, force spectrum white and known."""
    f = np.arange(15 * record_length, 30 * record_length) / record_length
    w = 2 * np.pi * f
    g = np.abs(1 / (K - M * w**2 + 1j * C * w)) ** 2
    share = 2 / (noise * 2.44e-4) ** 2
    return 1 / np.sqrt(share * np.sum(g**2)), 1 / np.sqrt(share * np.sum(g**2 * w**2))


@pytest.mark.slow
def test_stiffness_and_damping_cover_and_are_nearly_efficient():
    rng, records, noise = np.random.default_rng(5), 450, 0.8
    found = [parameters(moving_record(rng, 30000, noise), band=BAND)[1] for _ in range(records)]
    k, c = assert_parameters_cover(found, records)
    # Of 21 bins in a window the transient takes 3; the centre of each window alone would miss by 1.7.
    for value, bound in zip((k, c), white_bound(30, noise), strict=True):
        assert 0.93 < value.std() / bound < 1.25
    assert np.mean([e.fit_p[0] < 0.05 for e in found]) < 0.05 + 3 * np.sqrt(0.05 * 0.95 / records)
    assert stats.kstest([e.fit_p[0] for e in found], "uniform").pvalue > 0.01


def blows(rng, samples, count):
    force = np.zeros(samples)
    for start in rng.integers(samples // 50, samples - samples // 50, count):
        force[start : start + 6] += 20 * rng.uniform(0.5, 1.5) * np.hanning(8)[1:-1]
    return force


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["chirp", "blows"])
def test_a_chirp_or_hammer_blows_give_stiffness_and_damping(kind):
    rng, n, found = np.random.default_rng(6), 30000, []
    for _ in range(800):
        force = signal.chirp(np.arange(n) / RATE, 2, 30, 100) if kind == "chirp" else blows(rng, n, 12)
        y = move(force)
        record = np.array([y + 0.3 * y.std() * rng.standard_normal(n), force])
        s, estimate = parameters(record, band=(1.0, 110.0))
        found.append(estimate)
    assert_parameters_cover(found, 800)
    # What the chirp does at the ends of the record cannot be told from a transient, and outside it there is nothing.
    ends = s.frequency[[0, -1]]
    assert (8 < ends[0] < 13 and 85 < ends[1] < 95) if kind == "chirp" else (ends[0] < 1.5 and ends[1] > 109)


def test_one_blow_near_an_end_is_refused_until_the_window_tells_it_from_a_transient():
    force = np.zeros(10000)
    force[600:604] = 1.0  # 6 % in: its phase turns 1.3 times in 21 bins
    with pytest.raises(ValueError, match="none that differs from a transient"):
        local_polynomial(np.array([move(force), force]), CHANNELS, RATE, "force", BAND)
    s = local_polynomial(np.array([move(force), force]), CHANNELS, RATE, "force", BAND, resolution=1.5)
    assert len(s.frequency) > 30 and np.abs(force_response(s)[0] / response(s.frequency) - 1).max() < 0.05


def looped(rng, samples):
    """Closed loop around an unstable plant, injection r and sensor noise: (command, displacement), S and the plant.

    u = r - C y, y = P u + n, with P = b / a and a lead controller C = f / e; so u = S (r - C n), y = S (P r + n).
    """
    b, a, _ = signal.cont2discrete(([1], [M, 0, -2000.0]), 1 / RATE)
    f, e = np.array([19333, -14000]), np.array([1, -1 / 3])
    b = b.ravel()
    poles = np.convolve(a, e) + np.convolve(b, f)
    assert np.abs(np.roots(poles)).max() < 0.999 < np.abs(np.roots(a)).max()
    r, n = rng.standard_normal(samples), 1e-5 * rng.standard_normal(samples)
    u = signal.lfilter(np.convolve(a, e), poles, r) - signal.lfilter(np.convolve(a, f), poles, n)
    y = signal.lfilter(np.convolve(b, e), poles, r) + signal.lfilter(np.convolve(a, e), poles, n)

    def truth(frequency):
        z = np.exp(2j * np.pi * frequency / RATE)
        plant = np.polyval(b, z) / np.polyval(a, z)
        return np.polyval(np.convolve(a, e), z) / np.polyval(poles, z), plant

    return np.array([u, y, r]), truth


LOOP = ("command", "displacement", "injection")


@pytest.mark.slow
def test_noise_that_runs_around_a_loop_does_not_bias_responses_to_its_injection():
    rng, off, inside, ratios = np.random.default_rng(7), [], [], []
    for _ in range(100):
        record, truth = looped(rng, 8000)
        s = local_polynomial(record, LOOP, RATE, "injection", (2.0, 200.0))
        sensitivity, plant = truth(s.frequency)
        limit = stats.f.ppf(0.95, 2, 6 * (s.periods - 1))
        found, spread = frequency_response(s, "command", "injection")
        indirect, variance = frequency_response(s, "displacement", "command")
        inside.append([np.mean(np.abs(found - sensitivity) ** 2 < limit * spread),
                       np.mean(np.abs(indirect - plant) ** 2 < limit * variance)])  # fmt: skip
        off.append(np.mean((found - sensitivity) / np.sqrt(spread)))
        # The same bins with the command as reference: the noise in it comes from the displacement.
        direct = local_polynomial(record, LOOP, RATE, "command", (2.0, 200.0))
        ratios.append([r[1::3] for r in (indirect / plant, frequency_response(direct, *LOOP[1::-1])[0] / plant)])
    assert len(s.frequency) == 225 and np.array_equal(direct.lines, s.lines)
    held_within(np.mean(inside, axis=0), 0.95, 100 * 75)
    assert np.abs(np.mean(off)) < 4 / np.sqrt(100 * 225)
    indirect, direct = np.abs(np.mean(np.mean(ratios, axis=0)[:, 50:], axis=-1) - 1)  # above 130 Hz
    assert indirect < 0.02 and direct > 0.1


def test_margins_of_the_loop_from_its_injection():
    record, truth = looped(np.random.default_rng(8), 20000)
    s = local_polynomial(record, LOOP, RATE, "injection", (2.0, 300.0), resolution=1.5)
    sensitivity, variance = frequency_response(s, "command", "injection")
    found = margins(s.frequency, sensitivity, variance)
    f = np.geomspace(2, 300, 3000)
    exact = margin_arrays(f, truth(f)[0])
    for name in ("peak_sensitivity", "phase_margin", "delay_margin", "disk_margin"):
        low, high = found.intervals[name]
        assert 0.97 * low <= exact[name] <= 1.03 * high and high < 1.1 * low
        assert getattr(found, name) == pytest.approx(float(exact[name]), rel=0.05)


def test_an_array_as_reference_makes_every_channel_an_output():
    rng = np.random.default_rng(9)
    angle, record = 0.6, moving_record(rng, 8000, 0.1)
    force = np.array([np.cos(angle), np.sin(angle)])[:, None] * record[1]
    seen = np.cos(angle) * force[0] + np.sin(angle) * force[1]
    s = local_polynomial(np.array([record[0], *force]), ("displacement", "force_x", "force_y"), RATE, seen, BAND)
    one = local_polynomial(record, CHANNELS, RATE, "force", BAND)
    for name, share in (("force_x", np.cos(angle)), ("force_y", np.sin(angle))):
        assert np.allclose(s.amplitude(name), share * one.amplitude("force"), rtol=1e-9)
        assert s.cross(name, name).max() < 1e-20 * np.abs(s.amplitude(name)).min() ** 2
    assert np.allclose(s.amplitude("displacement"), one.amplitude("displacement"), rtol=1e-9)
    assert np.allclose(s.cross("displacement", "displacement"), one.cross("displacement", "displacement"))


def test_noise_in_the_reading_of_the_force_scales_everything_unless_the_command_is_the_reference():
    """By 1 + n for noise of n times the force: nothing shows it but a coherence of 1 / (1 + n) and a known mass."""
    rng, n, samples, share = np.random.default_rng(10), 0.25, 30000, []
    ratios, masses, instrument = [], [], []
    for _ in range(12):
        command = rng.standard_normal(samples)
        reading = command + np.sqrt(n) * rng.standard_normal(samples)
        names, record = (*CHANNELS, "command"), np.array([move(command), reading, command])
        s = local_polynomial(record, names, RATE, "force", BAND)
        ratios.append(np.mean(force_response(s)[0] / response(s.frequency)).real)
        share.append(np.median(coherence(s, "displacement")))
        modal = modal_estimate(held(s, "force", RATE))
        masses.append([modal.mass / M, modal.stiffness / K, modal.natural_frequency / np.sqrt(K / M) * 2 * np.pi])
        g = force_response(local_polynomial(record, names, RATE, "command", BAND))[0]
        instrument.append(np.mean(g / response(s.frequency)).real)
    assert np.mean(ratios) == pytest.approx(1 / (1 + n), abs=0.01)
    assert np.mean(share) == pytest.approx(1 / (1 + n), abs=0.03)
    assert np.mean(masses, axis=0) == pytest.approx([1 + n, 1 + n, 1.0], abs=0.01)
    assert np.mean(instrument) == pytest.approx(1.0, abs=0.01)


def test_an_offset_does_no_harm_and_a_drift_only_at_the_lowest_lines():
    rng = np.random.default_rng(11)
    record = moving_record(rng, 10000, 0.3)
    s = local_polynomial(record, CHANNELS, RATE, "force", (0.0, 98.7))
    shifted = local_polynomial(record + np.array([[2.44], [1e5]]), CHANNELS, RATE, "force", (0.0, 98.7))
    assert s.lines[0] == 3  # the window starts at bin 1
    assert np.allclose(shifted.mean, s.mean, rtol=1e-7) and np.allclose(shifted.covariance, s.covariance, rtol=1e-6)
    ramp = np.array([2 * 2.44e-4 * np.linspace(-1, 1, 10000), np.zeros(10000)])
    drifted = local_polynomial(record + ramp, CHANNELS, RATE, "force", (0.0, 98.7))
    change = np.abs(force_response(drifted)[0] - force_response(s)[0]) / np.sqrt(force_response(s)[1])
    assert change[:3].max() > 1 and change[3:].max() < 0.2


def test_lines_default_to_where_the_reference_has_power():
    rng, n = np.random.default_rng(12), 20000
    sections = signal.butter(8, [20, 120], "bandpass", fs=RATE, output="sos")
    force = signal.sosfilt(sections, rng.standard_normal(n))
    s = local_polynomial(np.array([move(force), force]), CHANNELS, RATE, "force")
    passed = np.abs(signal.sosfreqz(sections, np.arange(1, 500), fs=RATE)[1]) ** 2 > 1e-4
    low, high = np.flatnonzero(passed)[[0, -1]] + 1
    assert s.frequency[0] == pytest.approx(low, abs=4) and s.frequency[-1] == pytest.approx(high, abs=4)
    assert s.periods == 6
    wide = local_polynomial(rng.standard_normal((1, n)), ("a",), RATE, "a")
    assert 900 < len(wide.lines) <= 1000 and wide.lines[0] < wide.lines[1] and wide.lines[-1] < n // 2
    assert wide.periods == 10  # windows of 33 bins, 10 000 of them in 303
    asked = local_polynomial(rng.standard_normal((1, n)), ("a",), RATE, "a", (100, 400), resolution=2.0)
    assert np.mean(np.diff(asked.frequency)) == pytest.approx(2.0, rel=0.05)
    # Of three stretches with nothing between, the strongest alone.
    shares = np.zeros(n // 2 + 1)
    shares[400:1000], shares[2000:3000], shares[4000:5000] = 0.2, 1, 0.5
    parts = irfft(shares * rfft(rng.standard_normal(n)), n)
    one = local_polynomial(parts[None], ("a",), RATE, "a")
    assert one.lines[0] == pytest.approx(2000, abs=25) and one.lines[-1] == pytest.approx(3000, abs=25)
    # Nyquist's bin, real as bin 0, would make another window.
    assert len(local_polynomial(rng.standard_normal((1, 4200)), ("a",), RATE, "a", (0, RATE / 2)).lines) == 3 * 99


def test_a_window_without_power_is_left_out():
    n, rng = 8000, np.random.default_rng(13)
    spectrum = rfft(rng.standard_normal(n))
    spectrum[400:800] = 0  # 50 .. 100 Hz
    force = irfft(spectrum, n)
    s = local_polynomial(np.array([rng.standard_normal(n), force]), CHANNELS, RATE, "force", (10.0, 200.0))
    assert not ((s.frequency > 53) & (s.frequency < 97)).any()
    assert ((s.frequency > 45) & (s.frequency < 55)).any() and np.isfinite(s.mean).all()
    with pytest.raises(ValueError, match=r"no power between 5\d(\.\d+)? and 9\d(\.\d+)? Hz"):
        local_polynomial(np.array([rng.standard_normal(n), force]), CHANNELS, RATE, "force", (52.0, 98.0))


@pytest.mark.slow
def test_a_long_record_takes_little_memory():
    record = np.random.default_rng(14).standard_normal((2, 1_200_000))
    tracemalloc.start()
    s = local_polynomial(record, CHANNELS, 20e3, "force")
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < 4 * record.nbytes
    assert len(s.lines) == 996 and np.all(np.diff(s.lines[1::3]) == 1803) and s.periods == 600


def noise_record(samples=400, channels=2):
    return np.random.default_rng(15).standard_normal((channels, samples))


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"signals": noise_record(42)}, "42 samples are too short a record: one window takes 43"),
        ({"signals": noise_record(channels=3)}, r"signals must be \(2 channels, samples\), not \(3, 400\)"),
        ({"signals": np.where(np.arange(400) == 7, np.nan, noise_record())}, "'displacement' has values"),
        ({"sample_rate": 0.0}, "sample_rate = 0.0 must be positive"),
        ({"reference": "torque"}, "'torque' is missing; the record has displacement, force"),
        ({"reference": np.ones(399)}, "must hold 400 finite values"),
        ({"reference": np.full(400, np.inf)}, "must hold 400 finite values"),
        ({"reference": np.full(400, 3.0)}, "reference is constant"),
        ({"band": (-1.0, 40.0)}, r"band -1 .. 40 Hz must increase and lie within 0 .. 50 Hz"),
        ({"band": (10.0, 51.0)}, "must increase and lie within"),
        ({"band": (30.0, 20.0)}, "must increase and lie within"),
        ({"band": (10.0, 14.0)}, "holds 17 DFT bins 0.25 Hz apart, and one window takes 21"),
        ({"resolution": 1.0}, "resolution 1 Hz: the record allows 1.75 Hz at best"),
        ({"resolution": float("nan")}, "resolution nan Hz"),
        ({"resolution": 20.0}, "one window takes 237"),
        ({"reference": np.cos(np.arange(400) * np.pi / 4)}, "has no power between"),
    ],
)
def test_bad_input_is_named(change, message):
    given = {"signals": noise_record(), "channels": CHANNELS, "sample_rate": 100.0, "reference": "force", **change}
    with pytest.raises(ValueError, match=message):
        local_polynomial(**given)
