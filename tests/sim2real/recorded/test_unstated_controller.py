"""A controller that a recording does not state is told by a current that the injection does not make."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import lfilter

from maglev_env.rig.rig_file import load_rig
from sim2real.recorded.unstated_controller import unstated_controller

RATE = 5000.0


@pytest.fixture(scope="module")
def rig():
    return replace(load_rig("hmb_free"), amplifier_time_constant=4e-4)


def recorded(rig, lag, answer, noise=1e-3):
    """An injection, and the current of an amplifier that lags by `lag` (s), with a share that follows a motion."""
    rng = np.random.default_rng(5)
    injection, motion = 0.3 * rng.normal(size=(2, 20000))
    decay = np.exp(-1 / (RATE * lag))
    current = lfilter([1 - decay], [1, -decay], injection + answer * motion) + noise * rng.normal(size=20000)
    return {"current": current[None], "injection": injection[None]}


@pytest.mark.parametrize("times", [0.5, 1.0, 2.0])
def test_what_an_amplifier_makes_of_the_injection_is_no_controller(rig, times):
    channels = recorded(rig, times * rig.amplifier_time_constant, answer=0.0)
    assert not unstated_controller(rig, channels, RATE)


def test_a_current_that_also_follows_a_motion_is_one(rig):
    assert unstated_controller(rig, recorded(rig, rig.amplifier_time_constant, answer=0.5), RATE)


def test_a_current_without_an_injection_is_one_unless_it_is_noise(rig):
    rig = replace(rig, noise=replace(rig.noise, current=1e-3))
    channels = recorded(rig, rig.amplifier_time_constant, answer=0.0)
    assert unstated_controller(rig, {"current": channels["current"]}, RATE)
    assert not unstated_controller(rig, {"current": channels["current"] * 1e-3}, RATE)
    assert not unstated_controller(rig, {"injection": channels["injection"]}, RATE)
