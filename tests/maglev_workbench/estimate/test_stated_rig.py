"""What the answer says of an identified rig that is far from the stated one, on coefficients written by hand."""

from dataclasses import replace

import pytest
from test_estimate_report import band, identification

from estimation.actuator import ActuatorEstimate
from maglev_env.loop.magnets.kinds import force_law
from maglev_env.loop.magnets.law import linearise
from maglev_env.rig.rig_file import load_rig
from maglev_workbench.commands.estimate.answer import estimate_answer
from maglev_workbench.commands.estimate.stated_rig import Found, from_stated, of_axis_named

RIG = replace(load_rig("hmb_free"), tolerance={"actuator_gain": 0.1, "negative_stiffness": 0.15})


def said(gain, stiffness, se=0.01, rig=RIG):
    """The clause on an actuator gain of 80 N/A and a stiffness of -320 kN/m, identified as so many times these."""
    found = [
        Found("actuator_gain", 80.0 * gain, 80.0 * se, 80.0),
        Found("negative_stiffness", -3.2e5 * stiffness, 3.2e5 * se, -3.2e5),
    ]
    return from_stated(rig, found)


@pytest.mark.parametrize(("factor", "words"), [(2.0, "2.01 times too large"), (0.5, "1.99 times too small")])
def test_one_factor_on_gain_and_stiffness_is_a_mass(factor, words):
    text = said(factor, factor * 1.01)
    assert f"{words}; check [parameters] mass" in text
    assert f"the actuator gain is {factor:.3g} times the stated 80" in text
    assert "(10 tolerances)" in text and "the negative stiffness is" in text  # twice and half are equally far


def test_one_coefficient_that_is_far_is_said_and_no_mass_is_blamed():
    text = said(0.707, 1.005)
    assert "0.707 times the stated 80" in text and "4.1 tolerances" in text
    assert "mass" not in text and "negative stiffness" not in text and "axes of the channels" in text
    assert "mass" not in said(2.0, -2.0)


def test_what_is_within_tolerance_or_is_hardly_known_says_nothing():
    assert not said(1.1, 0.9) and not said(2.0, 2.0, se=0.4) and not said(2.0, 2.0, rig=None)
    for factor in (1.6, 1 / 1.6):
        assert not said(factor, factor, rig=replace(RIG, tolerance={}))  # nobody states how well it is known
    wide = replace(RIG, tolerance={"actuator_gain": 0.5, "negative_stiffness": 0.5})
    assert not said(0.5, 0.5, rig=wide) and "3.13 times too small" in said(0.3, 0.34, rig=wide)


def test_a_mass_at_half_is_said_as_one_at_double_without_a_stated_tolerance():
    loose = replace(RIG, tolerance={})
    assert "too small; check [parameters] mass" in said(0.5, 0.5, rig=loose)
    assert "too large; check [parameters] mass" in said(2.0, 2.0, rig=loose)


def test_a_tolerance_of_zero_and_another_sign_are_said_without_a_number_of_tolerances():
    exact = replace(RIG, tolerance={"actuator_gain": 0.0})
    assert "1.1 times the stated 80.0 N/A: check" in said(1.1, 1.0, rig=exact)
    assert "-1 times the stated -320 kN/m: check" in said(1.0, -1.0)


SPRUNG = replace(RIG, support_stiffness=12000.0, tolerance={"actuator_gain": 0.1, "negative_stiffness": 0.1})


def sprung(magnets=1.0, spring=1.0, rig=SPRUNG):
    """The clause where magnets and the spring that holds most of them are so many times what is stated."""
    gain, pull = linearise(force_law(rig))
    total = magnets * pull + spring * rig.support_stiffness
    return from_stated(rig, of_axis_named(rig, "run.csv", (gain, 0.01 * gain), (total, 1.0)))


def test_a_spring_that_nearly_cancels_the_magnets_widens_no_deviation():
    """A fifth of a tolerance of the magnets had been "4.8 tolerances" of what is left of them."""
    assert not sprung(1.02) and not sprung(1.2)
    known = replace(SPRUNG, tolerance=dict(SPRUNG.tolerance) | {"support_stiffness": 0.01})
    assert "the stiffness is" in sprung(1.4, rig=known) and "(4 tolerances)" in sprung(1.4, rig=known)
    assert "negative" not in sprung(1.4, rig=known) and "the stiffness is" in sprung(1.0, 1.4, rig=known)


def test_the_first_sentence_of_a_recording_says_it():
    gain, stiffness = linearise(force_law(RIG))
    for factor in (1.0, 2.0):
        shown = ActuatorEstimate(factor * gain, factor * stiffness, 0.0, 0.01 * gain, 10.0, 0.1, 1.0, 0.0)
        text = estimate_answer([("a.csv", identification(bands=(band(1.0),), actuator=shown))], None, rig=RIG)
        assert ("check [parameters] mass" in text) == (factor == 2.0)


def test_the_second_axis_has_its_own_stated_values():
    rig = replace(RIG, axes=2, per_axis={"y": {"mass": 0.1, "gap": 0.4e-3, "actuator_gain": 4.5}})
    stated = [of_axis_named(rig, f"run, {axis}", (1.0, 0.1), (1.0, 0.1))[0].stated for axis in "xy"]
    assert stated[0] != stated[1]
