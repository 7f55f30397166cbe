"""Sample rates that numbers of a file state: what is called otherwise is none, and what is open is asked for."""

import pytest

from maglev_env.recordings.guess.rate import STATED_RATE, guess_rate


@pytest.mark.parametrize("name", ["Baud rate", "bit_rate", "Frame rate", "Control rate [kHz]", "PWM rate", "slew_rate"])
def test_another_rate_is_not_that_of_the_samples(name):
    found = guess_rate(None, 1.0, {name: 115200.0})
    assert found.value is None and found.ask
    assert guess_rate(None, 1.0, {name: 20e3, "Sample rate [kHz]": 10.0}).value == 10e3


@pytest.mark.parametrize("name", ["rate", "log.rate", "Scan rate", "Sampling Rate", "run.fs"])
def test_a_rate_that_is_called_nothing_else_is(name):
    found = guess_rate(None, 1.0, {name: 8e3})
    assert found.value == 8e3 and not found.ask


def test_the_samples_own_rate_goes_before_one_that_may_be_another():
    found = guess_rate(None, 1.0, {"control.rate": 20e3, "control_dt": 5e-5, "Abtastrate": 10e3})
    assert found.value == 10e3 and not found.ask


def test_two_rates_that_disagree_are_asked_for():
    found = guess_rate(None, 1.0, {"fs": 20e3, "dt": 1e-3})
    assert found.value == 20e3 and "dt" in found.reason and found.ask
    assert not guess_rate(None, 1.0, {"fs": 20e3, "dt": 5e-5}).ask
    assert not guess_rate(None, 1.0, {"fs": 20e3, "dt": 1e-3, STATED_RATE: 1e3}).ask


def test_a_rate_with_which_nothing_levitates_is_asked_for():
    found = guess_rate(None, 1.0, {"Abtastrate": 2.0})  # in ms, as another line says
    assert found.value == 2.0 and found.ask and not guess_rate(None, 1.0, {STATED_RATE: 2.0}).ask
