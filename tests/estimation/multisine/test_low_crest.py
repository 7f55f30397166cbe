import time

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from estimation.multisine.low_crest import _log_norm, low_crest
from estimation.multisine.sphs import crest_factor, harmonic_range, odd_lines, odd_random_grid, sphs, synthesise

SAMPLES = 20_000


def crests(multisine, samples=SAMPLES):
    """On the grid asked for, and on one of more than 32 points per cycle of the highest line."""
    fine = max(1 << 15, 32 * int(multisine.lines[-1]))
    return crest_factor(synthesise(multisine, samples)), crest_factor(synthesise(multisine, fine))


@pytest.mark.parametrize("count", [100, 128, 150, 200, 250])
def test_flat_lines_reach_the_crest_of_the_literature(count):
    lines = harmonic_range(1, count)
    assert max(crests(low_crest(lines, SAMPLES))) < 1.41
    assert crests(sphs(lines, SAMPLES))[0] > 1.6


@pytest.mark.parametrize("exponent", [4, 32])
def test_the_search_follows_the_gradient_of_the_norm_of_a_sum_of_cosines(exponent):
    rng = np.random.default_rng(3)
    lines, points = np.array([1, 3, 4, 9]), 400
    amplitudes, phases = rng.uniform(0.5, 1, 4), rng.uniform(0, 2 * np.pi, 4)

    def norm(phases):
        turns = 2 * np.pi * np.outer(np.arange(points) / points, lines)
        signal = (amplitudes * np.cos(turns + phases)).sum(axis=1)
        return np.log(np.mean(np.abs(signal) ** exponent)) / exponent

    value, gradient = _log_norm(phases, lines, amplitudes, points, exponent)
    assert value == pytest.approx(norm(phases), rel=1e-9)
    step = 1e-5 * np.eye(4)
    expected = [(norm(phases + h) - norm(phases - h)) / 2e-5 for h in step]
    assert gradient == pytest.approx(expected, abs=1e-7)


@pytest.mark.slow
def test_any_number_of_flat_lines_reaches_it():
    assert max(max(crests(low_crest(harmonic_range(1, n), SAMPLES))) for n in range(105, 251, 29)) < 1.42


@pytest.mark.parametrize("seed", range(1, 6))
def test_every_seed_reaches_it_by_phases_of_its_own(seed):
    lines = odd_lines(1, 249)
    first, other = low_crest(lines, SAMPLES), low_crest(lines, SAMPLES, seed=seed)
    assert max(crests(other)) < 1.42
    assert np.abs(np.mean(np.exp(1j * (first.phases - other.phases)))) < 4 / np.sqrt(lines.size)


def test_a_usual_design_is_quick():
    start = time.process_time()
    low_crest(harmonic_range(1, 250), SAMPLES)
    assert time.process_time() - start < 5.0


def test_same_seed_same_multisine():
    first, again = (low_crest(harmonic_range(1, 60), 4096, seed=3) for _ in range(2))
    np.testing.assert_array_equal(first.phases, again.phases)
    np.testing.assert_array_equal(first.amplitudes, again.amplitudes)


def test_neither_the_peak_nor_the_grid_changes_the_phases():
    lines = harmonic_range(1, 60)
    one = low_crest(lines, 4096)
    for other in (low_crest(lines, 4096, peak=0.3), low_crest(lines, 6000)):
        np.testing.assert_array_equal(one.phases, other.phases)


def test_the_spectrum_and_the_peak_are_those_asked_for():
    lines = odd_lines(3, 99)
    power = np.random.default_rng(0).uniform(0.1, 3.0, lines.size)
    signal = low_crest(lines, 4096, peak=0.3, power=power)
    period = synthesise(signal, 4096)
    assert np.max(np.abs(period)) == pytest.approx(0.3, rel=1e-12)
    found = np.abs(np.fft.rfft(period)[lines]) ** 2
    np.testing.assert_allclose(found / np.sum(found), power / np.sum(power), rtol=1e-10)


def test_a_common_factor_of_the_lines_only_repeats_the_waveform():
    base, repeated = low_crest(np.arange(1, 41), 2000), low_crest(5 * np.arange(1, 41), 10_000)
    np.testing.assert_allclose(synthesise(repeated, 10_000), np.tile(synthesise(base, 2000), 5), atol=1e-12)


# The bounds lie between what the search reaches (1.97, 2.13, 1.25, 1.49, 1.47, 1.44) and Schroeder's crest.
@pytest.mark.parametrize(
    ("lines", "power", "bound", "schroeder"),
    [
        (np.unique(np.geomspace(1, 1000, 100).astype(int)), None, 2.05, 3.9),
        (np.sort(np.random.default_rng(7).choice(np.arange(1, 500), 40, replace=False)), None, 2.25, 2.9),
        (np.arange(1, 201), 1 / np.arange(1, 201), 1.3, 2.09),
        (np.arange(1, 201), np.arange(1, 201.0) ** 2, 1.55, 2.08),
        (odd_random_grid(1, 249, 3)[0], None, 1.52, 2.4),
        (harmonic_range(1, 250, range(5, 251, 5)), None, 1.5, 2.0),
    ],
)
def test_other_spectra_are_far_below_schroeder(lines, power, bound, schroeder):
    assert max(crests(low_crest(lines, SAMPLES, power=power))) < bound
    assert crests(sphs(lines, SAMPLES, power=power))[0] > schroeder


def never_above_schroeder(lines, samples, power=None):
    low, schroeder = low_crest(lines, samples, power=power), sphs(lines, samples, power=power)
    return crests(low, samples)[0] <= crests(schroeder, samples)[0] * (1 + 1e-12)


@pytest.mark.parametrize(
    ("lines", "samples"), [([7, 29], SAMPLES), ([9, 43], 4096), ([5, 13], SAMPLES), ([1, 2], 5), ([3], 8)]
)
def test_a_few_lines_where_the_search_alone_would_lose_to_schroeder(lines, samples):
    assert never_above_schroeder(lines, samples)


@settings(max_examples=20, deadline=None)
@given(lines=st.lists(st.integers(1, 60), min_size=1, max_size=12, unique=True).map(sorted), seed=st.integers(0, 99))
def test_never_above_schroeder(lines, seed):
    power = np.random.default_rng(seed).uniform(0.05, 1.0, len(lines))
    assert never_above_schroeder(lines, 256, power)


@pytest.mark.parametrize(
    ("call", "name"),
    [
        (lambda: low_crest([1, 2, 50], 100), "samples_per_period"),
        (lambda: low_crest([3, 2], 100), "lines"),
        (lambda: low_crest([1, 2], 100, peak=0.0), "peak"),
        (lambda: low_crest([1, 2], 100, power=[1.0]), "power"),
        (lambda: low_crest([1, 2], 100, power=[1.0, -1.0]), "power"),
    ],
)
def test_bad_input_is_named(call, name):
    with pytest.raises(ValueError, match=name):
        call()
