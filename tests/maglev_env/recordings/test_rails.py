"""A reading that stays at its extreme value is clipped, but not where a coarse converter shows the levels of steps."""

import numpy as np
import pytest
from scipy.signal import lfilter

from maglev_env.recordings.alarms.rail import touched_rail
from maglev_env.recordings.masking import clipped_samples

RATE, N = 2000.0, 8000
T = np.arange(N) / RATE
STEP = 0.01  # converter, mm


def _moved(wanted, lag=0.03, seed=4):
    """What follows a set point with a lag, with little noise, as a coarse converter reads it."""
    pole = np.exp(-1 / (lag * RATE))
    noise = 0.0015 * np.random.default_rng(seed).standard_normal(wanted.size)
    return np.round((lfilter([1 - pole], [1, -pole], wanted) + noise) / STEP) * STEP


def _rail(values, wanted):
    return touched_rail(
        "displacement", "pos", values, 1e-3 * values, RATE, wanted=None if wanted is None else 1e-3 * wanted
    )


@pytest.mark.parametrize("lag", [0.004, 0.03])
@pytest.mark.parametrize("rest", [0, 1000, 4000])
def test_steps_that_a_coarse_converter_reads_reach_their_set_point_and_no_rail(lag, rest):
    wanted = np.where(np.arange(N) < rest, 0, 0.2 * np.sign(np.sin(2 * np.pi * T) + 1e-9))
    read = _moved(wanted, lag)
    if not rest:
        assert clipped_samples(read).mean() > 0.2, "the values alone look so"
    alarm, at = _rail(read, wanted)
    assert alarm is None and not at.any()


@pytest.mark.parametrize("clip", [0.15, 0.24])
def test_steps_that_the_converter_cuts_off_are_clipped_beside_their_set_point(clip):
    """Below it, or where the reading overshoots."""
    wanted = 0.2 * np.sign(np.sin(2 * np.pi * T) + 1e-9)
    w = 2 * np.pi * 8
    ringing = lfilter(*_second_order(w, 0.35), wanted) if clip > 0.2 else _moved(wanted)
    read = np.clip(np.round(ringing / STEP) * STEP, -clip, clip)
    alarm, at = _rail(read, wanted)
    assert alarm is not None and alarm.code == "rail"
    assert np.array_equal(at, np.abs(read) == np.abs(read).max())


def _second_order(w, damping):
    """Difference equation of a resonance."""
    r, angle = np.exp(-damping * w / RATE), w * np.sqrt(1 - damping**2) / RATE
    a = np.array([1, -2 * r * np.cos(angle), r * r])
    return [a.sum()], a


def test_where_no_set_point_is_recorded_levels_that_are_held_alike_are_steps():
    levels = np.array([0, 0.1, -0.2, 0.05, 0.2, -0.1, 0.2, 0])
    read = _moved(np.repeat(levels, N // levels.size), 0.01)
    assert _rail(read, None)[0] is None
    # Overshoots that are cut off are held for a short while only, whatever is held between.
    w = 2 * np.pi * 15
    wanted = np.repeat(levels, N // levels.size)
    ringing = np.clip(np.round(lfilter(*_second_order(w, 0.35), wanted) / STEP) * STEP, -0.24, 0.24)
    assert _rail(ringing, None)[0] is not None


def test_a_rest_beside_a_burst_that_is_cut_off_hides_no_rail():
    burst = np.where(T < 2, 0, 0.4 * np.sin(2 * np.pi * 5 * T))
    read = np.clip(np.round(burst / STEP) * STEP, -0.2, 0.2)
    for wanted in (None, burst):
        assert _rail(read, wanted)[0].severity == "refuse"
