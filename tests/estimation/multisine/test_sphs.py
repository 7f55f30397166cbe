import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from estimation.multisine.sphs import (
    Multisine,
    crest_factor,
    harmonic_range,
    impulse,
    odd_lines,
    odd_random_grid,
    random_phase,
    schroeder_phases,
    sphs,
    synthesise,
)

line_sets = st.lists(st.integers(1, 200), min_size=1, max_size=40, unique=True).map(sorted)


def flat_crest(lines, samples=8192):
    return crest_factor(synthesise(sphs(lines, samples), samples))


@pytest.mark.parametrize("count", [100, 150, 200, 250])
def test_flat_schroeder_crest_factor(count):
    assert 1.60 < flat_crest(harmonic_range(1, count)) < 1.75


def test_equal_spacing_keeps_the_low_crest_factor():
    assert 1.60 < flat_crest(odd_lines(1, 249)) < 1.75
    assert 1.60 < flat_crest(np.arange(5, 1001, 5)) < 1.75


def test_random_phases_have_a_high_crest_factor():
    crests = [crest_factor(synthesise(random_phase(np.arange(1, 251), 8192, seed), 8192)) for seed in range(20)]
    assert min(crests) > 2.6
    assert max(crests) < 4.2


def test_an_impulse_is_one_blow_a_period():
    """All lines in phase are a Dirichlet kernel, whose crest factor is sqrt(2 n)."""
    n, grid = 50, 4040
    wave = synthesise(impulse(np.arange(1, n + 1), grid, peak=3.0), grid)
    x = 2 * np.pi * np.arange(grid) / grid
    kernel = np.full(grid, float(n))
    kernel[1:] = (np.sin((n + 0.5) * x[1:]) / np.sin(x[1:] / 2) - 1) / 2
    assert wave == pytest.approx(3.0 * kernel / n, abs=1e-9)
    assert crest_factor(wave) == pytest.approx(np.sqrt(2 * n))


def test_phases_are_those_of_equation_a3():
    power = np.array([1.0, 3.0, 2.0, 4.0])
    share = power / 10
    expected = [0.0]
    for i in range(1, 4):
        expected.append(expected[-1] - 2 * np.pi * sum(share[:i]))
    np.testing.assert_allclose(schroeder_phases(power), expected)
    np.testing.assert_allclose(schroeder_phases(7 * power), expected)


@settings(max_examples=50, deadline=None)
@given(lines=line_sets, seed=st.integers(0, 1000), peak=st.floats(1e-3, 1e3))
def test_synthesis_is_the_cosine_sum_with_the_exact_peak(lines, seed, peak):
    power = np.random.default_rng(seed).uniform(0.1, 2.0, len(lines))
    signal = random_phase(lines, 512, seed, peak=peak, power=power)
    time = np.arange(512) / 512
    explicit = sum(
        a * np.cos(2 * np.pi * line * time + p)
        for a, line, p in zip(signal.amplitudes, signal.lines, signal.phases, strict=True)
    )
    period = synthesise(signal, 512)
    np.testing.assert_allclose(period, explicit, atol=1e-11 * peak)
    assert np.max(np.abs(period)) == pytest.approx(peak, rel=1e-12)


@settings(max_examples=30, deadline=None)
@given(lines=line_sets)
def test_power_follows_the_spectrum_and_parseval(lines):
    power = 1.0 / np.array(lines)
    signal = sphs(lines, 1024, peak=2.0, power=power)
    assert np.mean(synthesise(signal, 1024) ** 2) == pytest.approx(np.sum(signal.amplitudes**2) / 2, rel=1e-10)
    np.testing.assert_allclose(signal.amplitudes**2 / np.sum(signal.amplitudes**2), power / np.sum(power))


def test_suppressed_lines_are_absent():
    lines = harmonic_range(1, 250, suppressed=[50, 100, 400])
    assert lines.size == 248
    spectrum = np.abs(np.fft.rfft(synthesise(sphs(lines, 2000), 2000))) / 1000
    absent = np.setdiff1d(np.arange(spectrum.size), lines)
    assert {50, 100} <= set(absent.tolist())
    assert np.max(spectrum[absent]) < 1e-15
    assert np.min(spectrum[lines]) > 1e-2


def test_odd_random_grid_leaves_one_of_each_group():
    excited, odd, even = odd_random_grid(1, 250, seed=3)
    assert odd.size == 125 // 4
    assert np.all(excited % 2 == 1) and np.all(odd % 2 == 1) and np.all(even % 2 == 0)
    np.testing.assert_array_equal(np.sort(np.concatenate([excited, odd, even])), np.arange(1, 251))
    np.testing.assert_array_equal((odd - 1) // 8, np.arange(odd.size))


@given(first=st.integers(1, 50), span=st.integers(8, 100), seed=st.integers(0, 99), group=st.integers(2, 4))
def test_odd_random_grid_parts_the_range(first, span, seed, group):
    excited, odd, even = odd_random_grid(first, first + span, seed, group)
    joined = np.concatenate([excited, odd, even])
    np.testing.assert_array_equal(np.sort(joined), np.arange(first, first + span + 1))
    np.testing.assert_array_equal(np.sort(np.concatenate([excited, odd])), odd_lines(first, first + span))


def test_same_seed_same_signal():
    lines = np.arange(1, 50)
    first, again, other = (random_phase(lines, 256, seed).phases for seed in (1, 1, 2))
    np.testing.assert_array_equal(first, again)
    assert not np.allclose(first, other)
    np.testing.assert_array_equal(odd_random_grid(1, 99, 5)[0], odd_random_grid(1, 99, 5)[0])


def test_a_multisine_cannot_be_changed():
    amplitudes = np.ones(2)
    signal = Multisine([1, 2], amplitudes, [0.0, 0.0])
    amplitudes[0] = 5.0
    assert signal.amplitudes[0] == 1.0
    with pytest.raises(ValueError):
        signal.phases[0] = 1.0


@pytest.mark.parametrize(
    ("call", "name"),
    [
        (lambda: sphs([1, 2, 50], 100), "samples_per_period"),
        (lambda: synthesise(Multisine([4], [1.0], [0.0]), 8), "samples_per_period"),
        (lambda: sphs([0, 1], 100), "lines"),
        (lambda: sphs([3, 2], 100), "lines"),
        (lambda: sphs([], 100), "lines"),
        (lambda: sphs([1.5, 2.5], 100), "lines"),
        (lambda: sphs([1, 2], 100, peak=0.0), "peak"),
        (lambda: sphs([1, 2], 100, power=[1.0, -1.0]), "power"),
        (lambda: sphs([1, 2], 100, power=[1.0]), "power"),
        (lambda: schroeder_phases([]), "power"),
        (lambda: Multisine([1, 2], [1.0], [0.0, 0.0]), "amplitudes"),
        (lambda: Multisine([1], [-1.0], [0.0]), "amplitudes"),
        (lambda: Multisine([1], [1.0], [np.nan]), "phases"),
        (lambda: harmonic_range(0, 5), "first"),
        (lambda: harmonic_range(1, 2, [1, 2]), "suppressed"),
        (lambda: odd_lines(2, 2), "odd"),
        (lambda: odd_random_grid(1, 5, 0), "first"),
        (lambda: odd_random_grid(1, 50, 0, group=1), "group"),
        (lambda: crest_factor(np.zeros(4)), "signal"),
    ],
)
def test_bad_input_is_named(call, name):
    with pytest.raises(ValueError, match=name):
        call()


def test_suppressed_harmonics_keep_the_crest_lower_than_closing_ranks_would():
    lines = harmonic_range(1, 250, range(5, 251, 5))
    positions = sphs(lines, 20_000)
    ranks = Multisine(lines, positions.amplitudes, schroeder_phases(np.ones(lines.size)))
    assert crest_factor(synthesise(positions, 20_000)) < 2.1 < crest_factor(synthesise(ranks, 20_000))
