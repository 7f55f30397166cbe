"""Amplitudes of lines of whole blocks, and their statistics over periods, against numpy's transform and covariance."""

import numpy as np
import pytest

from maglev_lanes.layout import LANES
from maglev_lanes.line_spectra import LineSpectra
from maglev_lanes.period_statistics import PeriodStatistics, as_complex

RNG = np.random.default_rng(0)


# Lengths with every radix alone and together, with factors that no radix has, a prime, and the shortest ones.
@pytest.mark.parametrize("samples", [1, 2, 5, 12, 64, 125, 1009, 1200, 4000, 4410])
def test_the_lines_are_those_of_numpys_transform(samples):
    series = RNG.standard_normal((samples, 3, LANES))
    lines = np.arange(samples // 2 + 1)[:: max(1, samples // 100)]
    whole = np.fft.rfft(series, axis=0) * (2 / samples)
    for channel in range(3):
        found = as_complex(LineSpectra(samples, lines)(series, channel))
        np.testing.assert_allclose(found, whole[lines, channel].T, rtol=0, atol=1e-14 * np.abs(whole).max())


def test_a_line_and_a_lane_have_the_same_bits_beside_any_others():
    series = RNG.standard_normal((1000, 1, LANES))
    every = LineSpectra(1000, np.arange(200))(series, 0)
    series[..., 1:] = np.inf
    alone = LineSpectra(1000, np.array([7, 111]))(series, 0)
    np.testing.assert_array_equal(alone[..., 0], every[[7, 111], :, 0])


@pytest.mark.parametrize("periods", [2, 5])
def test_statistics_equal_the_two_pass_formulas(periods):
    spectra = RNG.standard_normal((periods, 4, 6, 2, LANES)) + 10.0
    spectra[:, 3] = spectra[0, 3]  # a channel that repeats exactly
    gathered = PeriodStatistics(4, (0, 1, 2), 6)
    for z in spectra:
        gathered.add(z.copy())
    z = as_complex(spectra)  # (lanes, periods, channels, lines)
    np.testing.assert_allclose(gathered.mean(), z.mean(axis=1), rtol=1e-13)
    off = z - z.mean(axis=1, keepdims=True)
    expected = np.einsum("npal,npbl->nabl", off, off.conj()) / (periods - 1) / periods
    np.testing.assert_allclose(gathered.covariance(), expected, rtol=0, atol=1e-13)
    assert not gathered.covariance()[:, 3].any()
