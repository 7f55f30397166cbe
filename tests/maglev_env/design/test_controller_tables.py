"""Controllers in words, and those that are fitted to a numerator and a denominator."""

from dataclasses import replace

import numpy as np
import pytest

from maglev_env.design.controller_fit import fitted_gains
from maglev_env.design.controllers import with_controller
from maglev_env.loop.controller_forms import Cascade, CurrentLoop, Pid
from maglev_env.loop.filtered_pid import FilteredPid, LeadLag, LowPass, Notch
from maglev_env.loop.gains import Gains, controller_response, digital, gain_values
from maglev_env.rig.rig_file import load_rig

FREE = load_rig("hmb_free")
DT = 1 / FREE.control_rate
OWN = {"kp": 8000.0, "ki": 2000.0, "kd": 5.2, "td": 1e-4, "ti": 0.0318}
NOTCHED = FilteredPid(**OWN, notch=Notch(657.0, 0.05, 0.4))


def test_a_controller_in_words_has_the_rigs_gains_and_the_stated_filters():
    text = "pid + notch 650 depth=0.2 + low-pass 3000 + notch 900 width=1 + lead_lag frequency=150 ratio=0.5"
    expected = FilteredPid(
        **OWN, notch=Notch(650.0, 0.2), notch2=Notch(900.0, width=1.0), lead_lag=LeadLag(150.0, 0.5),
        low_pass=LowPass(3000.0),
    )  # fmt: skip
    assert with_controller(FREE, text).gains == expected
    assert with_controller(FREE, None) is FREE and with_controller(FREE, "pid").gains == FREE.gains
    own = replace(FREE, gains=NOTCHED)
    assert with_controller(own, "pid + notch depth=0.3").gains.notch == replace(NOTCHED.notch, depth=0.3)
    assert with_controller(own, "pid").gains == Gains(**OWN)
    two = replace(load_rig("hmb_radial"), gains=(Gains(1.0, 0.0, 1.0), Gains(2.0, 0.0, 1.0)))
    assert [g.kp for g in with_controller(two, "pid + notch 60").gains] == [1.0, 2.0]


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("notch 650", "begin with 'pid'"),
        ("pid + comb 650", "no filter 'comb'; filters are notch, lead_lag, low_pass"),
        ("pid + notch", "notch: give its frequency in Hz, as in 'notch 650'"),
        ("pid + notch 650 q=3", "'q=3': give each of frequency, depth, width once"),
        ("pid + notch deep", "'deep' is not a number"),
        ("pid + notch 1 + notch 2 + notch 3", "at most 2 of notch"),
        ("pid + notch 650 depth=-2", "depth = -2.0"),
        ("pid + notch 12000", "half of the control rate of 20000 Hz"),
        ("pid +", "no filter ''"),
    ],
)
def test_words_that_say_no_controller_are_refused(text, words):
    with pytest.raises(ValueError, match=words):
        with_controller(FREE, text)


def test_another_form_takes_no_filters():
    cascade = Cascade(Pid(110.0), CurrentLoop(6.0), 4.0)
    with pytest.raises(ValueError, match='of the form "cascade", which takes no filters'):
        with_controller(replace(FREE, gains=cascade), "pid + notch 650")


@pytest.mark.parametrize(
    ("controller", "text"),
    [
        (NOTCHED, "pid + notch 600"),
        (FilteredPid(**OWN, low_pass=LowPass(2500.0, 0.5)), "pid + low_pass 3000"),
        (FilteredPid(9000.0, 0.0, 6.0, 3e-4), "pid"),
    ],
    ids=["notch", "low-pass", "plain"],
)
def test_a_numerator_and_a_denominator_become_the_gains_that_made_them(controller, text):
    found = with_controller(replace(FREE, gains=digital(controller, DT)), text).gains
    z = np.exp(2j * np.pi * np.geomspace(1.0, 9000.0, 60) * DT)
    np.testing.assert_allclose(controller_response(found, z, DT), controller_response(controller, z, DT), rtol=1e-6)
    expected = gain_values(controller)
    for name in {"kp", "kd", "td", *expected} - ({"ki", "ti"} if controller.ki == 0 else set()):
        assert gain_values(found)[name] == pytest.approx(expected[name], rel=1e-3), name


def test_what_a_pid_with_these_filters_cannot_be_is_refused_with_the_deviation():
    with pytest.raises(ValueError, match=r"no pid is the controller .* deviates by \d+% at 6\d\d Hz"):
        with_controller(replace(FREE, gains=digital(NOTCHED, DT)), "pid")
    for other, words in (
        (Pid(8000.0, 0.0, 5.2, 1e-4, limit=(-1.0, 1.0)), "has a limit"),
        (Pid(8000.0, 0.0, 5.2, 1e-4, "measurement"), "treats the reference otherwise"),
    ):
        with pytest.raises(ValueError, match=words):
            fitted_gains(digital(other, DT), {}, DT)
