"""Lines kept off the spin against a dense scan of speeds, and what the errors name."""

import numpy as np
import pytest

from estimation.multisine.line_choice import lines_off_spin


def scanned(lines, fundamental, low, high, orders, clearance):
    """Lines clear of every harmonic at each of many speeds between low and high (rpm)."""
    harmonics = np.linspace(low, high, 20001)[:, None] / 60 * np.asarray(orders)
    return [line for line in lines if np.abs(harmonics - line * fundamental).min() >= clearance]


@pytest.mark.parametrize("low, high", [(8000, 8000), (7900, 8100), (1500, 2100), (60, 90)])
def test_equals_a_dense_scan_of_speeds(low, high):
    lines = np.arange(3, 200)
    kept = lines_off_spin(lines, 2.0, [(low, high)], [0.5, 1, 2, 3], 1.503, least=1)
    assert 10 < kept.size < lines.size
    assert kept.tolist() == scanned(lines, 2.0, low, high, [0.5, 1, 2, 3], 1.503)


def test_several_speeds_take_what_each_takes():
    lines = np.arange(5, 101)
    each = [lines_off_spin(lines, 4.0, [s], [1, 2], 5.0) for s in (8000, 5000.0, (3000, 3300))]
    both = lines_off_spin(lines, 4.0, [8000, 5000.0, (3000, 3300)], [1, 2], 5.0)
    assert both.tolist() == sorted(set(each[0]) & set(each[1]) & set(each[2]))
    assert both.size < min(e.size for e in each)


def test_a_line_at_the_clearance_stays_and_one_on_a_harmonic_falls():
    lines = np.array([98, 99, 100, 101, 102])
    assert lines_off_spin(lines, 0.1, [600], [1], 0.1, least=1).tolist() == [98, 99, 101, 102]
    assert lines_off_spin(lines, 0.1, [600], [1], 0.0, least=1).tolist() == [98, 99, 101, 102]
    assert lines_off_spin(lines, 0.1, [600], [1], 0.11, least=1).tolist() == [98, 102]


def test_ranges_of_speed_may_be_rows_of_an_array():
    with pytest.raises(ValueError, match="5000 to 9000 rpm takes"):
        lines_off_spin([1, 2], 100.0, np.array([[5000, 9000]]), [1], 1.0)


def test_too_few_names_the_speeds_and_their_lines():
    with pytest.raises(ValueError) as caught:
        lines_off_spin(np.arange(10, 22), 10.0, [8000, (6000, 7200), 60000], [1], 8.0)
    text = str(caught.value)
    assert "7 of 12 lines stay 8 Hz clear of the spin, 10 are needed" in text
    assert "8000 rpm takes lines 13, 14" in text
    assert "6000 to 7200 rpm takes lines 10, 11, 12" in text and "60000 rpm takes none" in text
    with pytest.raises(ValueError, match="takes lines 1, 2, 3, 4, 5, 6, 7, 8, 9, 10 and 30 more"):
        lines_off_spin(np.arange(1, 41), 1.0, [(30, 6000)], [1], 0.5)


@pytest.mark.parametrize(
    "change, text",
    [
        ({"lines": []}, "lines must be a non-empty"),
        ({"lines": [0, 1]}, "positive integers"),
        ({"lines": [1.5]}, "positive integers"),
        ({"fundamental": 0.0}, "fundamental = 0.0 Hz"),
        ({"fundamental": np.nan}, "fundamental = nan Hz"),
        ({"harmonics": []}, "harmonics"),
        ({"harmonics": [0]}, "harmonics"),
        ({"clearance_hz": -1.0}, "clearance_hz = -1.0"),
        ({"speeds_rpm": []}, "speeds_rpm is empty"),
        ({"speeds_rpm": [-5]}, "speed -5 rpm"),
        ({"speeds_rpm": [(2, 1)]}, r"speed \(2, 1\) rpm"),
        ({"speeds_rpm": [(1, 2, 3)]}, r"speed \(1, 2, 3\) rpm"),
    ],
)
def test_bad_input(change, text):
    good = {"lines": [1, 2], "fundamental": 1.0, "speeds_rpm": [8000], "harmonics": [1], "clearance_hz": 1.0}
    assert lines_off_spin(**good, least=1).size == 2
    with pytest.raises(ValueError, match=text):
        lines_off_spin(**(good | change), least=1)
