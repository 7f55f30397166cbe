"""What is to be minded: a recording that contradicts what is stated, a lag that is not stated, a curved reading."""

from types import SimpleNamespace

import pytest

from maglev_workbench.commands.diagnose import minded as module
from maglev_workbench.commands.diagnose.minded import curved, minded, unstated
from maglev_workbench.commands.diagnose.report import _gap_lines, capitalised
from sim2real.compared.commands_seen import STALLS
from sim2real.gap.shrink import Gap


def diagnosis(cause, pole=0.0, tolerance=(), effects=("amplifier_lag",)):
    values = {name: {"time_constant": 4.0031e-3} for name in effects}
    stated = dict.fromkeys(tolerance, 0.0)
    rig = SimpleNamespace(amplifier_time_constant=pole, sensor_time_constant=0.0, tolerance=stated, effects={})
    corrected = SimpleNamespace(effects=values)
    return SimpleNamespace(cause=cause, corrected=corrected, rig=rig, verdict="explained", notes=(), wrong_gain=None)


def test_a_sentence_begins_with_a_capital_and_the_name_of_an_effect_as_it_is():
    assert capitalised("the rig states no mass") == "The rig states no mass"
    assert capitalised("force_law may be the probe's") == "force_law may be the probe's"


@pytest.mark.parametrize("cause", [("amplifier_lag",), ("amplifier_lag+friction", "amplifier_lag+damping")])
def test_a_lag_that_nobody_stated_is_said_to_be_what_was_left_out(cause):
    (said,) = unstated(diagnosis(cause))
    assert "states no amplifier_time_constant" in said and "amplifier_time_constant = 0.004 (s)" in said


def test_a_lag_of_which_a_part_is_dead_time_is_to_be_stated_whole():
    found = diagnosis(("amplifier_lag",))
    found.corrected.effects["amplifier_lag"]["feedback"] = 0.25
    found.corrected.effects["delay"] = {"time": 1.0e-3}
    (said,) = unstated(found)
    assert "amplifier_time_constant = 0.004 (s)" in said  # 0.75 * 4.003 ms + 1 ms
    found.rig.effects["delay"] = {"time": 0.4e-3}  # is none of it
    (said,) = unstated(found)
    assert "amplifier_time_constant = 0.0036 (s)" in said


@pytest.mark.parametrize(
    "known",
    [
        diagnosis(("amplifier_lag",), pole=1e-4),
        diagnosis(("amplifier_lag",), tolerance=("amplifier_time_constant",)),
        diagnosis(("amplifier_lag", "delay")),
        diagnosis(("friction",)),
        diagnosis(()),
    ],
)
def test_nothing_is_said_of_a_stated_pole_or_of_one_cause_among_others(known):
    assert unstated(known) == []


def stop(monkeypatch, se):
    found = (SimpleNamespace(name="soft_stop.distance", value=1e-3, se=se),)
    monkeypatch.setattr(module, "corrections", lambda diagnosis: found)


@pytest.mark.parametrize("cause", [("soft_stop",), ("asymmetric_gain+force_law", "cubic_spring")])
def test_a_force_that_bends_with_the_position_may_be_a_curved_reading(monkeypatch, cause):
    stop(monkeypatch, 1e-4)
    (said,) = minded(diagnosis(cause, effects=()))
    assert "calibration" in said and "hall and inductive" in said


def test_a_stop_with_a_knee_is_no_curve(monkeypatch):
    stop(monkeypatch, 1e-6)
    assert curved(diagnosis(("soft_stop",), effects=())) == []


@pytest.mark.parametrize("cause", [(), ("friction",), ("soft_stop", "friction")])
def test_what_may_be_another_effect_is_not_said_to_be_the_probe(cause):
    assert curved(diagnosis(cause, effects=())) == []


WIRING = {
    "code": "filter",
    "kind": "wiring",
    "recording": "r1.npz",
    "message": "gains: with kp = 5 in place of 6; correct kp",
}
LATE = {
    "code": "delay",
    "kind": "effect",
    "channel": "force",
    "recording": "r2.npz",
    "message": "force: late by 2 samples; check when column 'F' is read; or an effect (damping): run `maglev diagnose`",
}


@pytest.mark.parametrize(
    ("verdict", "warnings", "words"),
    [
        ("explained", (WIRING,), "states: r1.npz: gains: with kp = 5 in place of 6; correct kp; put that right first"),
        ("ambiguous", (LATE, WIRING, WIRING), "(1 more such warnings): r1.npz: gains: with kp"),
        ("unexplained", (LATE,), "r2.npz: force: late by 2 samples; check when column 'F' is read; put that right"),
        ("unexplained", ({**LATE, "channel": "current_x"},), None),
        ("explained", (LATE,), None),
        ("no_gap", (WIRING,), None),
        ("unexplained", ({**WIRING, "kind": "quality"},), None),
    ],
)
def test_a_recording_that_is_not_what_is_stated_is_put_right_first(verdict, warnings, words):
    found = diagnosis((), effects=())
    found.verdict = verdict
    said = minded(found, warnings)
    assert (words in said[0] and len(said) == 1) if words else said == []


SPIKE = {**WIRING, "code": "spike", "channel": "current", "message": "current: a spike of 0.1 A at 1.5 s"}


@pytest.mark.parametrize(("cause", "notes"), [(("dropped_samples",), ()), (("unknown",), ("rec1.csv: " + STALLS,))])
def test_the_spikes_of_lost_commands_are_not_to_be_left_out(cause, notes):
    found = diagnosis(cause, effects=())
    found.notes = notes
    assert minded(found, (SPIKE,)) == []
    assert "0.1 A at 1.5 s" in minded(diagnosis(("friction",), effects=()), (SPIKE,))[0]
    elsewhere = {**SPIKE, "channel": "displacement", "message": "displacement: a spike"}
    assert "displacement: a spike" in minded(found, (elsewhere,))[0]


def test_a_corrected_rig_that_is_worse_is_not_to_be_used():
    corrected = SimpleNamespace(effects={}, changes={"mass": 0.1})
    for after, told in ((8.11, True), (7.0, False)):
        gap = Gap(7.48, None, after, 1.0, None, None, "holdout", {}, {})
        found = SimpleNamespace(gap=gap, corrected_freely=False, by_partial=None, corrected=corrected, choice=None)
        (line,) = _gap_lines(found)
        assert ("do not use it" in line) == told
