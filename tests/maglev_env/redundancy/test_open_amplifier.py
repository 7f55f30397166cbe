"""Records without a period of a rig that leaves the amplifier's time constant out, by difference equations of a lag."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import cont2discrete, lfilter

from maglev_env.loop.gains import Gains, controller_output
from maglev_env.redundancy.amplifier import amplified, unstated_pole
from maglev_env.redundancy.controller import applies
from maglev_env.redundancy.periods import breaks
from maglev_env.redundancy.view import View
from maglev_env.rig.excitation import Excitation
from maglev_env.rig.rig_file import load_rig

PRESET = load_rig("hmb_free")
RATE = PRESET.control_rate
TOLERANCE = {name: value for name, value in PRESET.tolerance.items() if name != "amplifier_time_constant"}
OPEN = replace(PRESET, amplifier_time_constant=0.0, tolerance=TOLERANCE)
N = 40_000


def held(command, lag, late=0):
    """A current (samples,) that follows a held command by a first-order lag (in samples), read `late` samples later."""
    a = np.exp(-1 / lag) if lag else 0.0
    return np.roll(lfilter([0.0, 1 - a], [1.0, -a], command), late)


def view(rig, gains=None, **channels):
    names = frozenset(channels)
    return View("run", RATE, channels, names, {n: n for n in names}, (Excitation("none", "current"),), frozenset(),
                gains, (), rig, rig.mass)  # fmt: skip


@pytest.mark.parametrize("lag", [0.4, 1.8, 12.0])
@pytest.mark.parametrize("late", [0, 1])
def test_an_unknown_lag_is_no_scale_and_a_late_reading_beside_it_is_told(lag, late):
    rng = np.random.default_rng(3)
    command = lfilter([0.3], [1.0, -0.7], rng.normal(size=N))
    current = held(command, lag, late) + 1e-3 * rng.normal(size=N)
    (row,) = amplified(view(OPEN, command=command, current=current))
    assert not row.gain_off() and not row.shape_off
    assert row.delay_off() == bool(late)
    if late:
        assert row.delay * RATE == pytest.approx(late, abs=0.2)


def test_a_wrong_scale_is_told_beside_an_unknown_lag():
    rng = np.random.default_rng(4)
    command = lfilter([0.3], [1.0, -0.7], rng.normal(size=N))
    (row,) = amplified(view(OPEN, command=command, current=2 * held(command, 3.0) + 1e-3 * rng.normal(size=N)))
    assert row.gain_off() and row.gain == pytest.approx(2.0, rel=0.05)


def test_a_lag_that_is_stated_to_be_none_is_told():
    rng = np.random.default_rng(5)
    command = lfilter([0.3], [1.0, -0.7], rng.normal(size=N))
    without = replace(OPEN, tolerance=TOLERANCE | {"amplifier_time_constant": 0.0})
    (row,) = amplified(view(without, command=command, current=held(command, 6.0) + 1e-3 * rng.normal(size=N)))
    assert row.off


def test_noise_that_was_added_to_the_command_beside_a_constant_reference_accuses_nobody():
    rng = np.random.default_rng(6)
    y, gains = 1e-5 * lfilter([0.1], [1.0, -0.9], rng.normal(size=N)), Gains(8000.0, 2000.0, 5.2)
    command = controller_output(gains, y, 1 / RATE) + rng.normal(size=N)
    rests = view(OPEN, gains, displacement=y, command=command, reference=np.zeros(N))
    assert not applies(rests)
    assert applies(view(OPEN, gains, displacement=y, command=command, reference=1e-5 * np.sign(np.sin(np.arange(N)))))


@pytest.mark.parametrize("stepped", [True, False])
def test_a_set_point_step_between_two_samples_is_no_missing_sample(stepped):
    rng = np.random.default_rng(7)
    command = lfilter([0.3], [1.0, -0.7], rng.normal(size=N))
    current = held(command, 2.0) + 1e-3 * rng.normal(size=N)
    kick = 8 * np.exp(-np.arange(3) / 1.5)  # a derivative's answer, of which the samples show only the end
    current[20_000:20_003] += kick
    reference = np.where(np.arange(N) < (19_999 if stepped else 25_000), 0.0, 1e-3)
    found = breaks(view(OPEN, command=command, current=current, reference=reference))
    assert [f.code for f in found] == ([] if stepped else ["missing samples"])


@pytest.mark.parametrize("late", [0, 1])
def test_the_lag_that_is_left_out_is_offered_to_be_stated(late):
    rng = np.random.default_rng(6)
    command = lfilter([0.3], [1.0, -0.7], rng.normal(size=N))
    channels = {"command": command, "current": held(command, 6.0, late) + 1e-3 * rng.normal(size=N)}
    (found,) = unstated_pole(view(OPEN, **channels))
    assert found.kind == "not checkable" and found.value * RATE == pytest.approx(6.0, rel=0.03)
    assert ("delay of 1.0 samples" in found.message) == bool(late)
    assert not unstated_pole(view(replace(OPEN, amplifier_time_constant=3e-4), **channels))
    assert not unstated_pole(view(OPEN, **channels | {"current": 2 * channels["current"]}))
    assert not unstated_pole(view(OPEN, command=command, current=command + 1e-3 * rng.normal(size=N)))


def test_a_lag_beyond_what_is_tried_is_not_offered():
    rng = np.random.default_rng(8)
    command = lfilter([0.3], [1.0, -0.7], rng.normal(size=N))
    channels = {"command": command, "current": held(command, 54.0) + 1e-5 * rng.normal(size=N)}
    assert not unstated_pole(view(OPEN, **channels))


@pytest.mark.parametrize("rate", [20.0, 100.0, 500.0])
def test_a_slow_rig_is_tried_within_what_a_time_constant_may_be(rate):
    rng = np.random.default_rng(7)
    command = lfilter([0.3], [1.0, -0.7], rng.normal(size=N))
    slow = replace(OPEN, control_rate=rate, gains=None)
    wide = view(slow, command=command, current=2 * command + rng.normal(size=N))
    (row,) = amplified(replace(wide, rate=rate))
    assert row.gain == pytest.approx(2.0, rel=0.1)


def test_a_current_loop_with_integral_action_leads_by_less_than_the_nominal_lag():
    """Its zero makes the current early; so does one that is read early, by more than the lag."""
    stated = replace(PRESET, amplifier_time_constant=1.6 / RATE)
    b, a, _ = cont2discrete(([1.8 / RATE, 1.0], [0.8 / RATE**2, 2.1 / RATE, 1.0]), 1 / RATE)
    rng = np.random.default_rng(6)
    command = lfilter([0.02], [1.0, -0.98], rng.normal(size=N))
    current = lfilter(b.ravel(), a, command) + 1e-3 * rng.normal(size=N)
    (row,) = amplified(view(stated, command=command, current=current))
    assert row.delay < -0.3 / RATE and row.delay_effects == ("amplifier_lag",)
    (row,) = amplified(view(stated, command=command, current=np.roll(current, -2)))
    assert row.delay < -1.6 / RATE and not row.delay_effects
