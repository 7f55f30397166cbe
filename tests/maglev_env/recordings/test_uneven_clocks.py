"""Time columns that begin anew, repeat until their next unit, or were stored with few digits."""

import numpy as np
import pytest
from scipy.signal import lfilter

from maglev_env.recordings.formats.time_stamps import check_clock, coarse_step, unwrapped
from maglev_env.recordings.guess.recording import guess_recording

N, RATE = 6000, 10000.0
TICKS = np.arange(N)
MOVED = lfilter([0.02], [1, -0.98], np.random.default_rng(7).standard_normal(N))


def write(folder, header, time):
    path = folder / "log.csv"
    rows = (f"{t},{x:.4f},{i:.4f}\n" for t, x, i in zip(time, 100 * MOVED, np.roll(MOVED, 1), strict=False))
    path.write_text(f"{header},x_um,i_A\n" + "".join(rows))
    return path


@pytest.mark.parametrize("bits", [16, 32])
def test_a_counter_that_is_full_goes_on(bits):
    counted = 2.0**bits - 20000 + 10.0 * TICKS
    np.testing.assert_array_equal(unwrapped(counted % 2**bits), counted)
    signed = (counted + 2 ** (bits - 1)) % 2**bits - 2 ** (bits - 1)  # of a type with a sign
    np.testing.assert_array_equal(np.diff(unwrapped(signed)), 10.0)
    garbled = counted % 2**bits
    garbled[[100, 3000]] = 4, np.nan
    on = unwrapped(garbled)
    assert np.isnan(on[3000]) and np.array_equal(np.delete(on, [100, 3000]), np.delete(counted, [100, 3000]))


def test_what_is_no_full_counter_stays():
    again = 10.0 * (TICKS % 3000)  # a log that began anew
    wave = np.rint(32767 * np.sin(TICKS))
    for values in (again, wave, MOVED, TICKS + 0.5):
        assert unwrapped(values) is values


@pytest.mark.parametrize(
    "stamps",
    [
        np.floor(TICKS / RATE * 1000) / 1000,
        np.rint(TICKS / RATE * 1000) / 1000 + 86000,
        (TICKS / RATE + 4000).astype(np.float32).astype(float),
        np.floor(TICKS / RATE * 64) / 64,
    ],
)
def test_the_mean_rate_of_a_coarse_clock(stamps):
    step, unsure = coarse_step(stamps)
    assert abs(step * RATE - 1) < 2 * unsure * RATE
    assert check_clock(stamps, RATE).instants is None
    with pytest.raises(ValueError, match=r"not sample_rate = 9000"):
        check_clock(stamps, 9000.0)


def test_a_clock_with_gaps_and_repeats_is_not_coarse():
    for lost in ([100], [100, 2000, 3000]):
        assert coarse_step(np.delete(TICKS, lost) / RATE) is None
        assert coarse_step(np.delete(np.floor(TICKS / 10), np.arange(2000, 2040))) is None
    assert coarse_step(np.repeat(np.arange(10.0), 100)) is None  # too few to tell


@pytest.mark.parametrize(
    ("header", "time"),
    [
        ("us", (2**32 - 100000 + 100 * TICKS) % 2**32),
        ("t_ms", TICKS // 10),
        ("timestamp", [f"2026-03-04T13:22:{10 + k / RATE:06.3f}" for k in TICKS]),
        ("time", [f"0 days 00:00:{k / RATE:09.6f}" for k in TICKS]),
    ],
)
def test_new_knows_the_rate_of_counters_and_coarse_stamps(tmp_path, header, time):
    guess = guess_recording(write(tmp_path, header, time))
    assert guess.rate.value == RATE and guess.channels["time"].column == header


def test_a_counter_of_another_unit_takes_the_stated_rate(tmp_path):
    guess = guess_recording(write(tmp_path, "tick", (60000 + 10 * TICKS) % 2**16), rate=RATE)
    assert guess.channels["time"].scale == 1e-5 and guess.notes == ()


def test_a_time_that_does_not_fit_the_stated_rate_says_what_is_missing(tmp_path):
    path = write(tmp_path, "t_ms", np.delete(TICKS // 10, np.arange(2000, 2080)))
    guess = guess_recording(path, rate=RATE)
    assert "time" not in guess.channels
    assert any("at 10000 Hz about 7" in note and "of 5920 samples are missing" in note for note in guess.notes)
    assert guess_recording(path).rate.value is None
    notes = guess_recording(path, rate=100.0).notes
    assert any("not taken at 100 Hz" in note for note in notes)
