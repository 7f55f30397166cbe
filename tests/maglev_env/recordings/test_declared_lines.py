"""Declared lines on which the recorded force, injection or reference has no power are refused, each by name."""

from types import SimpleNamespace

import numpy as np
import pytest
import xarray as xr

from maglev_env.recordings.excited import check_excited
from maglev_env.rig.excitation import Excitation

RATE, LINES = 1000.0, (2, 3, 5, 7, 11)


def recorded(channel, lines, fundamental=2.0):
    t = np.arange(4000) / RATE
    noise = 1e-3 * np.random.default_rng(1).standard_normal(t.size)
    wave = sum(np.cos(2 * np.pi * n * fundamental * t + n**2) for n in lines) + noise
    return xr.Dataset({channel: ("time", wave)}, {"time": t})


def spec(at, lines=LINES):
    return SimpleNamespace(excitations=(Excitation("multisine", at, 2.0, lines, 1.0),), sample_rate=RATE)


@pytest.mark.parametrize(("at", "channel"), [("force", "force"), ("current", "injection"), ("reference", "reference")])
def test_missing_lines_are_named_with_their_frequencies(at, channel):
    check_excited(recorded(channel, LINES), spec(at))
    with pytest.raises(ValueError, match=rf"'{channel}': no excitation at line 5 \(10 Hz\), 7 \(14 Hz\): at 2 of 5 st"):
        check_excited(recorded(channel, (2, 3, 11)), spec(at))


def test_a_long_list_is_cut_and_a_channel_that_was_not_recorded_is_not_judged():
    with pytest.raises(ValueError, match=r"8 \(16 Hz\), 9 \(18 Hz\) and 11 more: at 19 of 20"):
        check_excited(recorded("injection", (1,)), spec("current", tuple(range(1, 21))))
    check_excited(recorded("displacement", (1,)), spec("current"))
