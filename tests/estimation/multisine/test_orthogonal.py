import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from estimation.multisine.low_crest import low_crest
from estimation.multisine.orthogonal import interleaved_lines, orthogonal_multisines
from estimation.multisine.sphs import odd_lines, random_phase, sphs, synthesise

SAMPLES = 512
LINES = odd_lines(1, 61)


def inputs(experiments, samples=SAMPLES):
    """Sampled periods (experiments, axes, samples)."""
    return np.array([[synthesise(axis, samples) for axis in experiment] for experiment in experiments])


def amplitudes(signals, lines=LINES):
    """Complex amplitudes (lines, axes, experiments) of periods (experiments, axes, samples)."""
    return np.fft.rfft(signals)[..., lines].transpose(2, 1, 0) * 2 / signals.shape[-1]


@pytest.mark.parametrize("axes", [1, 2, 3, 4, 5, 8])
def test_the_inputs_of_a_line_are_unitary_times_its_amplitude(axes):
    power = np.random.default_rng(1).uniform(0.2, 2.0, LINES.size)
    multisine = random_phase(LINES, SAMPLES, seed=4, power=power)
    u = amplitudes(inputs(orthogonal_multisines(multisine, axes)))
    gram = u @ u.conj().transpose(0, 2, 1)
    np.testing.assert_allclose(
        gram, axes * multisine.amplitudes[:, None, None] ** 2 * np.eye(axes), atol=1e-12 * multisine.amplitudes[0] ** 2
    )
    np.testing.assert_allclose(np.abs(u), np.broadcast_to(multisine.amplitudes[:, None, None], u.shape), rtol=1e-10)


def test_two_axes_are_the_sum_and_the_difference():
    s = synthesise(sphs(LINES, SAMPLES), SAMPLES)
    expected = [[s, s], [s, -s]]
    np.testing.assert_allclose(inputs(orthogonal_multisines(sphs(LINES, SAMPLES))), expected, atol=1e-13)


@pytest.mark.parametrize("axes", [2, 4, 8])
def test_a_power_of_two_keeps_the_peak_of_every_axis(axes):
    multisine = low_crest(LINES, SAMPLES, peak=0.7)
    peaks = np.max(np.abs(inputs(orthogonal_multisines(multisine, axes))), axis=-1)
    np.testing.assert_allclose(peaks, 0.7, rtol=1e-12)


@pytest.mark.parametrize("axes", [3, 5, 6])
def test_phase_shifts_raise_the_peak_by_no_more_than_stated(axes):
    for multisine, most in ((low_crest(np.arange(1, 101), 4000), 2.05), (sphs(np.arange(1, 101), 4000), 1.16)):
        assert 1.05 < np.max(np.abs(inputs(orthogonal_multisines(multisine, axes), 4000))) < most


def two_by_two(signals):
    """Periodic steady state of a coupled 2 x 2 recursive filter, run until the transient is below rounding."""
    a = np.array([[0.6, -0.3], [0.2, 0.5]])
    b = np.array([[1.0, 0.4], [-0.7, 0.8]])
    state, period = np.zeros(signals.shape[:2]), np.empty_like(signals)
    for _ in range(3):
        for k in range(signals.shape[-1]):
            period[..., k] = state
            state = state @ a.T + signals[..., k] @ b.T
    z = np.exp(2j * np.pi * LINES / signals.shape[-1])
    return period, np.linalg.solve(z[:, None, None] * np.eye(2) - a, b)


def response(signals, outputs):
    return amplitudes(outputs) @ np.linalg.inv(amplitudes(signals))


def test_a_coupled_system_is_recovered_and_noise_costs_half_of_one_axis_at_a_time():
    multisine = low_crest(LINES, SAMPLES)
    s = synthesise(multisine, SAMPLES)
    together = inputs(orthogonal_multisines(multisine))
    in_turn = np.array([[s, 0 * s], [0 * s, s]])
    np.testing.assert_allclose(np.max(np.abs(together)), np.max(np.abs(in_turn)), rtol=1e-12)
    rng, deviation, trials = np.random.default_rng(8), 0.1, 500
    variance = []
    for signals in (together, in_turn):
        outputs, exact = two_by_two(signals)
        np.testing.assert_allclose(response(signals, outputs), exact, atol=1e-10)
        errors = [
            response(signals, outputs + deviation * rng.standard_normal(outputs.shape)) - exact for _ in range(trials)
        ]
        variance.append(np.mean(np.abs(errors) ** 2, axis=(0, 1)))
    # a complex amplitude 2 / N FFT of white noise has variance 4 sigma^2 / N; the mean over lines and trials of its
    # square scatters by 1 / sqrt(500 * 31) = 0.8 %
    expected = 4 * deviation**2 / SAMPLES / multisine.amplitudes[0] ** 2
    np.testing.assert_allclose(variance[1], expected, rtol=0.04)
    np.testing.assert_allclose(variance[0], expected / 2, rtol=0.04)


@settings(deadline=None)
@given(lines=st.lists(st.integers(1, 400), min_size=6, max_size=80, unique=True).map(sorted), axes=st.integers(1, 6))
def test_dealt_lines_are_a_fair_partition(lines, axes):
    hands = interleaved_lines(lines, axes)
    sizes = [hand.size for hand in hands]
    assert len(hands) == axes and max(sizes) - min(sizes) <= 1
    np.testing.assert_array_equal(np.sort(np.concatenate(hands)), lines)
    # spread evenly: between two lines of one axis there is exactly one line of each other axis
    for hand in hands:
        assert np.all(np.diff(np.searchsorted(lines, hand)) == axes)


def test_odd_lines_stay_odd():
    first, second = interleaved_lines(odd_lines(1, 9))
    np.testing.assert_array_equal(first, [1, 5, 9])
    np.testing.assert_array_equal(second, [3, 7])


def test_one_record_gives_each_axis_the_response_on_its_lines():
    hands = interleaved_lines(LINES)
    signals = np.array([[synthesise(low_crest(hand, SAMPLES), SAMPLES) for hand in hands]])
    outputs, exact = two_by_two(signals)
    u, y = amplitudes(signals)[..., 0], amplitudes(outputs)[..., 0]
    for axis, hand in enumerate(hands):
        own = np.isin(LINES, hand)
        np.testing.assert_allclose(y[own] / u[own, axis, None], exact[own, :, axis], atol=1e-10)


@pytest.mark.parametrize(
    ("call", "name"),
    [
        (lambda: orthogonal_multisines(sphs([1, 2], 16), 0), "axes"),
        (lambda: interleaved_lines([1, 2, 3], 0), "axes"),
        (lambda: interleaved_lines([1, 2, 3], 4), "axes"),
        (lambda: interleaved_lines([], 1), "lines"),
        (lambda: interleaved_lines([1, 3, 2]), "lines"),
        (lambda: interleaved_lines([0, 1, 2]), "lines"),
        (lambda: interleaved_lines([1.5, 2.0]), "lines"),
        (lambda: interleaved_lines([[1, 2], [3, 4]]), "lines"),
    ],
)
def test_bad_input_is_named(call, name):
    with pytest.raises(ValueError, match=name):
        call()
