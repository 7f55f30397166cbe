"""Responses, coherence and distortion against closed forms and by simulation."""

import numpy as np
import pytest
from drawn_spectra import draw, two_channels
from scipy import stats

from estimation.lines.frequency_response import (
    coherence,
    distortion,
    frequency_response,
    instrumented_response,
    loop_variance,
    pooled_variance,
)
from estimation.lines.periods import LineStatistics, line_statistics, period_spectra

LINES = np.arange(1, 9)
RECORDS = 4000


def white(rng, shape):
    return (rng.standard_normal(shape) + 1j * rng.standard_normal(shape)) / np.sqrt(2)


def test_variance_of_the_response_by_simulation():
    f = LINES.astype(float)
    force = 2 * np.exp(0.7j * f)
    g = 0.3 * np.exp(-0.4j * f)
    cross = 0.7 * 0.04 * 0.05 * np.exp(1j * f)  # displacement with force
    covariance = np.array([[0.04**2 + 0 * f, cross], [np.conj(cross), 0.05**2 + 0 * f]])
    s = draw(two_channels(f, force, g * force, covariance), RECORDS, seed=0)
    measured, variance = frequency_response(s, "displacement", "force")
    assert np.allclose(measured.mean(axis=0), g, atol=5 * np.sqrt(variance.mean() / RECORDS))
    scatter = np.mean(np.abs(measured - g) ** 2, axis=0)
    assert np.allclose(variance.mean(axis=0) / scatter, 1, atol=4 * np.sqrt(1.25 / RECORDS))
    uncorrelated = (0.04**2 + np.abs(g) ** 2 * 0.05**2) / 4
    assert np.sum(np.abs(scatter / uncorrelated - 1) > 0.15) >= 6  # else the cross term would not be tested


def test_a_source_without_power_gives_nan():
    silent = two_channels([1.0, 2.0], [0.0, 1.0], [1.0, 1.0], [[1, 0], [0, 0]])
    g, variance = frequency_response(silent, "displacement", "force")
    assert np.isnan(g[0]) and np.isnan(variance[0])
    assert g[1] == 1 and variance[1] == 1


@pytest.mark.parametrize("large", [1e-4, np.nan, np.inf])
def test_a_line_unlike_the_others_moves_the_means_of_its_neighbours_alone(large):
    variance = np.random.default_rng(0).uniform(1e-22, 2e-22, (2, 60))
    variance[1, 20] = large
    pooled = pooled_variance(variance)
    for lane in (0, 1):
        for i in range(3, 57):
            around = variance[lane, i - 3 : i + 4]
            expected = around[np.isfinite(around)].mean() if np.isfinite(variance[lane, i]) else variance[lane, i]
            assert pooled[lane, i] == pytest.approx(expected, rel=1e-12, abs=0.0, nan_ok=True)
    assert pooled[0, :3] == pytest.approx(
        [np.mean(variance[0, [*range(3 - i), *range(4 + i)]]) for i in range(3)], rel=1e-12, abs=0.0
    )


def test_noise_in_a_loop_biases_the_plain_ratio_but_not_the_instrumented_one():
    rng = np.random.default_rng(1)
    plant, controller, records = 0.4 * np.exp(-1j * LINES), 2.0 * np.exp(0.3j * LINES), 20000
    sensitivity = 1 / (1 + plant * controller)
    for noise in (0.3, 30.0):
        r = np.exp(2j * np.pi * rng.random((records, 8)))
        n = noise * white(rng, (records, 8))
        y = sensitivity * (plant * r + n)
        u = sensitivity * (r - controller * n)
        plain = (y * np.conj(u)).sum(axis=0) / (np.abs(u) ** 2).sum(axis=0)
        power = noise**2
        expected = (plant - np.conj(controller) * power) / (1 + np.abs(controller) ** 2 * power)
        assert np.allclose(plain, expected, atol=0.02)
        instrumented = instrumented_response(y, u, r)
        se = noise / np.abs(sensitivity) / np.sqrt(records)
        assert np.all(np.abs(instrumented - plant) < 5 * np.abs(sensitivity) * se * np.abs(1 + plant * controller))
    assert np.allclose(plain, -1 / controller, atol=0.01)
    assert np.all(np.abs(plant + 1 / controller) > 0.1)  # the two limits differ


@pytest.mark.parametrize("snr", [0.1, 1.0, 10.0])
def test_coherence_of_one_period(snr):
    periods = 400
    z = np.sqrt(snr) + white(np.random.default_rng(2), (periods, 1, 2000))
    c = coherence(line_statistics(z, 1.0, np.arange(2000), ("y",)), "y")
    assert c.mean() == pytest.approx(snr / (1 + snr), abs=0.004)


@pytest.mark.parametrize("periods", [5, 50])
def test_coherence_of_pure_noise_tends_to_zero(periods):
    z = white(np.random.default_rng(3), (periods, 1, 20000))
    c = coherence(line_statistics(z, 1.0, np.arange(20000), ("y",)), "y")
    assert np.median(c) == 0 and c.min() == 0 and c.max() <= 1
    assert c.mean() < 0.45 / periods


def test_coherence_without_any_power_is_zero():
    assert coherence(line_statistics(np.zeros((3, 1, 2), complex), 1.0, [1, 2], ("y",)), "y").tolist() == [0, 0]


@pytest.mark.parametrize("periods", [3, 5, 16])
def test_distortion_p_is_uniform_under_noise_alone(periods):
    rng, p = np.random.default_rng(periods), []
    lines = np.arange(1, 25)
    excited = np.array([1, 3, 5, 9, 11, 15, 17, 21])
    scale = rng.uniform(0.5, 2, 24)  # the noise need not be white
    for _ in range(800):
        z = np.isin(lines, excited) * 10.0 + scale * white(rng, (periods, 1, 24))
        d = distortion(line_statistics(z, 1.0, lines, ("y",)), "y", excited)
        p.append((d.even_p, d.odd_p))
    for values in np.array(p).T:
        assert stats.kstest(values, "uniform").pvalue > 0.01


def polynomial_coefficients(amplitudes, quadratic, cubic):
    """Peak amplitudes at lines 0.. of x + q x^2 + c x^3 by convolving two-sided Fourier coefficients."""
    half = np.concatenate([np.conj(amplitudes[:0:-1]), [2 * amplitudes[0]], amplitudes[1:]]) / 2
    square = np.convolve(half, half)
    cube = np.convolve(square, half)
    order = len(amplitudes) - 1
    y = cubic * cube
    y[order:-order] += quadratic * square
    y[2 * order : -2 * order] += half
    return 2 * y[3 * order + 1 :]  # lines 1, 2, ...


@pytest.mark.parametrize(("quadratic", "cubic"), [(0.05, 0.0), (0.0, 0.05), (0.03, 0.02)])
def test_distortion_level_of_a_static_polynomial(quadratic, cubic):
    rng, n = np.random.default_rng(4), 256
    excited, lines = np.array([1, 3, 7, 9, 13, 15]), np.arange(1, 20)
    amplitudes = np.zeros(16, complex)
    amplitudes[excited] = rng.uniform(0.5, 1, 6) * np.exp(2j * np.pi * rng.random(6))
    t = np.arange(n) / n
    x = (amplitudes[:, None] * np.exp(2j * np.pi * np.outer(np.arange(16), t))).real.sum(axis=0)
    y = x + quadratic * x**2 + cubic * x**3
    periods = [period_spectra((y + 1e-4 * rng.standard_normal(n))[None], lines) for _ in range(6)]
    d = distortion(line_statistics(periods, 1.0, lines, ("y",)), "y", excited)

    exact = np.abs(polynomial_coefficients(amplitudes, quadratic, cubic)[:19]) ** 2
    is_excited, odd = np.isin(lines, excited), lines % 2 == 1
    level = exact[is_excited].mean()
    assert d.even == pytest.approx(np.sqrt(exact[~odd].mean() / level), abs=2e-5)
    assert d.odd == pytest.approx(np.sqrt(exact[odd & ~is_excited].mean() / level), abs=2e-5)
    for measured, p, present in ((d.even, d.even_p, quadratic), (d.odd, d.odd_p, cubic)):
        assert (measured > 0.01 and p < 1e-9) if present else (measured < 2e-5 and p > 1e-3)
    assert d.noise == pytest.approx(1e-4 * 2 / np.sqrt(n) / np.sqrt(6) / np.sqrt(level), rel=0.3)


def test_distortion_is_none_without_detection_lines():
    lines = np.array([1, 2, 3])
    s = LineStatistics(lines * 1.0, lines, ("y",), np.ones((1, 3), complex), np.full((1, 1, 3), 0.01 + 0j), 5)
    assert distortion(s, "y", lines).even is None and distortion(s, "y", lines).odd is None
    only_even = distortion(s, "y", np.array([1, 3]))
    assert only_even.odd is None and only_even.odd_p is None and only_even.even > 0.9


def test_detection_lines_without_noise_have_a_level_but_no_p_value():
    lines = np.array([1, 2, 3])
    s = LineStatistics(lines * 1.0, lines, ("y",), np.array([[1, 0.1, 0.2]], complex), np.zeros((1, 1, 3)), 5)
    d = distortion(s, "y", [1])
    assert (d.even, d.odd, d.even_p, d.odd_p) == (pytest.approx(0.1), pytest.approx(0.2), None, None)


def test_scatter_between_lines_that_noise_does_not_explain_widens_a_loops_variance():
    rng = np.random.default_rng(0)
    f = np.geomspace(5.0, 2000.0, 90)
    clean = 1 / (1 + 1 / (1 + 1j * f / 100) ** 2)
    noise = np.full(f.size, 1e-6) * np.abs(clean) ** 2

    def draw(scatter):
        normal = (rng.standard_normal(f.size) + 1j * rng.standard_normal(f.size)) / np.sqrt(2)
        return loop_variance(f, clean + normal * np.abs(clean) * scatter, noise)

    quiet = np.mean([draw(1e-3) / noise for _ in range(40)])
    rough = np.mean([draw(5e-3) / noise for _ in range(40)])
    assert 1.0 <= quiet < 1.2  # noise alone, of which a line's own and the excess by chance add a little
    assert 28 < rough < 37  # 25 times the variance that the periods show, and 1.3 times for few degrees of freedom


def test_distortion_inside_the_rig_counts_most_where_its_loop_gain_is_large():
    """Of a disturbance d in proportion to the injection, dS = (1 - S) d: beside the noise it falls a thousandfold."""
    rng = np.random.default_rng(2)
    f = np.unique(np.r_[np.arange(5.0, 250.0, 5.0), np.geomspace(260.0, 2000.0, 42)])
    s = 2j * np.pi * f / (2 * np.pi * 60.0)
    clean = 1 / (1 + (2.2 + 1.6 * s) / (s**2 - 1))  # of an unstable plant
    noise = 1e-6 * np.abs(clean) ** 2
    disturbed = (0.15 * np.abs(1 - clean)) ** 2
    claims = []
    for _ in range(60):
        normal = (rng.standard_normal((2, f.size)) + 1j * rng.standard_normal((2, f.size))) / np.sqrt(2)
        own = np.sqrt(noise) * normal[0] + np.sqrt(disturbed) * normal[1]
        claims.append(loop_variance(f, clean + own, noise))
    ratio = np.median(claims, axis=0) / (noise + disturbed)
    assert ratio[1:].min() > 0.85 and ratio[0] > 0.65  # at an end of the lines smooth curves bend with the noise
    assert np.median(ratio) < 1.4 and ratio.max() < 2.6


@pytest.mark.parametrize("more", [1.0, 3.0, 30.0])
def test_noise_that_one_line_has_for_itself_counts_there(more):
    """A tone at one line: periods are drawn, and the claim is compared with the variance that they were drawn with."""
    rng, f, periods, at = np.random.default_rng(1), np.geomspace(5.0, 2000.0, 90), 5, 40
    clean = 1 / (1 + 1 / (1 + 1j * f / 100) ** 2)
    truth = 1e-6 * np.abs(clean) ** 2
    truth[at] *= more
    claims = []
    for _ in range(120):
        normal = rng.standard_normal((2, periods, f.size)) * np.sqrt(truth * periods / 2)
        drawn = clean + normal[0] + 1j * normal[1]
        claims.append(loop_variance(f, drawn.mean(axis=0), drawn.var(axis=0, ddof=1) / periods))
    ratio = np.median(claims, axis=0) / truth
    if more > 10:
        # The mean of seven lines has a fifth of it.
        assert np.mean(claims, axis=0)[at] / truth[at] == pytest.approx(1.0, abs=0.12)
    else:
        assert 0.4 < ratio[at] < 1.3
    assert np.median(ratio[np.abs(np.arange(f.size) - at) > 5]) == pytest.approx(1.0, abs=0.12)
