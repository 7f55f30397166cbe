"""Band layout of D Appendix C."""

import numpy as np
import pytest

from estimation.bands import band_slices, sliding_bands


@pytest.mark.parametrize(
    ("first", "last", "step", "width", "overlap"),
    [(1, 250, 1.0, 15, 12), (1, 250, 1.0, 10, 8), (1, 100, 0.5, 10, 0), (3, 200, 0.1, 7.3, 7.2), (1, 16, 1.0, 15, 12)],
)
def test_layout(first, last, step, width, overlap):
    f = first + step * np.arange(round((last - first) / step) + 1)
    bands = sliding_bands(f, width, overlap)
    assert bands[0, 0] == f[0]
    assert np.allclose(np.diff(bands, axis=1), width)
    assert np.allclose(np.diff(bands[:, 0]), width - overlap)
    assert bands[-1, 1] <= f[-1] + 1e-6 < bands[-1, 1] + width - overlap  # the last that fits
    for (low, high), (start, stop) in zip(bands, band_slices(f, bands), strict=True):
        assert np.array_equal(np.arange(start, stop), np.flatnonzero((f >= low - 1e-9) & (f <= high + 1e-9)))


def test_both_ends_belong_to_a_band():
    f = np.arange(1.0, 251.0)
    assert np.array_equal(band_slices(f, sliding_bands(f, 10, 8))[:2], [[0, 11], [2, 13]])
    assert len(sliding_bands(f, 15, 12)) == 79


def test_the_last_band_is_not_lost_to_rounding():
    f = 1 + 0.1 * np.arange(100)
    width, overlap = 1.1, 1.1 - 0.1
    assert (f[-1] - f[0] - width) / (width - overlap) < 88  # by 1e-13
    assert len(sliding_bands(f, width, overlap)) == 89


def test_gaps_count_only_the_lines_that_are_there():
    f = np.array([1.0, 2.0, 4.0, 7.0, 8.0, 9.0])
    assert np.array_equal(band_slices(f, np.array([[2.0, 7.0], [7.5, 7.9]])), [[1, 4], [4, 4]])


@pytest.mark.parametrize(
    ("width", "overlap", "message"),
    [
        (10, 10, "smaller than the width"),
        (10, -1, "at least 0"),
        (31, 0, "no band of 31 Hz fits between the excited lines 1 .. 30 Hz"),
        (0.5, 0, "fewer than two lines"),
    ],
)
def test_errors(width, overlap, message):
    with pytest.raises(ValueError, match=message):
        sliding_bands(np.arange(1.0, 31.0), width, overlap)


def test_a_hole_in_the_lines_names_the_band():
    with pytest.raises(ValueError, match=r"the band 11 \.\. 21 Hz holds fewer than two"):
        sliding_bands(np.array([1.0, 2.0, 3.0, 10.0, 15.0, 25.0, 30.0, 31.0]), 10, 0)
