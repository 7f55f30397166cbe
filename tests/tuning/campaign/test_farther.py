"""Where gains within the ranges do not meet a goal, what the user left open is tuned farther."""

from dataclasses import replace
from types import SimpleNamespace

import pytest
from gain_sets import PRESET, RIG, gain_set, true_rig

from maglev_env.loop.gains import with_gains
from maglev_env.rig.rig_file import load_rig
from tuning.campaign.farther import farther, lacking, names_of
from tuning.campaign.next_step import next_step

GOAL = "phase_margin >= 50, compliance <= 20e-6, peak_sensitivity <= 3, best noise_current near 0.03"


def test_what_was_named_is_tuned_and_else_what_recordings_vary():
    sets = [SimpleNamespace(gains=PRESET), SimpleNamespace(gains=with_gains(PRESET, td=5e-5))]
    assert names_of(sets[:1], None) == ("kp", "ki", "kd") == names_of([], None)
    assert names_of(sets, None) == ("kp", "ki", "kd", "td")
    assert names_of(sets, ("kp", "td")) == ("kp", "td")


def test_ranges_that_nobody_stated_go_farther():
    so_far = {"kp": (3000.0, 24000.0), "ki": (100.0, 20000.0), "kd": (2.0, 15.0), "td": (3e-5, 3e-4)}
    rig = replace(load_rig("hmb_free"), bounds={"kp": (3000.0, 24000.0)})
    names, wider = farther(rig, so_far, {"kd": (2.0, 15.0)})
    assert names == ("kp", "ki", "kd", "td")
    # The filter may be as fast as a control period lets it be: 1e-4 s in the rig, at 20 kHz.
    assert wider == {
        "kp": (3000.0, 24000.0), "ki": (50.0, 40000.0), "kd": (2.0, 15.0), "td": pytest.approx((1 / 60e3, 3e-4)),
    }  # fmt: skip
    assert farther(replace(rig, bounds={"td": (5e-5, 2e-4)}), so_far, {})[1]["td"] == (5e-5, 2e-4)


def test_only_a_goal_that_may_be_missed_is_lacking():
    def stopped(missed=(), unsure=(), goal="a goal", stop="enough", keep=0):
        claim = SimpleNamespace(missed=missed, unsure=unsure)
        task = SimpleNamespace(layout=SimpleNamespace(goal=goal))
        return SimpleNamespace(stop=stop, task=task, keep=keep, claimed=(claim,))

    assert lacking(stopped(missed=("compliance",))) and lacking(stopped(unsure=("compliance",)))
    assert not lacking(stopped()) and not lacking(stopped(("compliance",), goal=None))
    assert not lacking(stopped(("compliance",), stop=None)) and not lacking(stopped(("compliance",), keep=None))


@pytest.mark.slow
def test_a_goal_that_kp_ki_and_kd_cannot_meet_is_met_with_the_filter():
    """Seen on a pair of another simulator under eddy currents: 28.4 of 30 degrees, and 31 with a faster filter."""
    rig = true_rig()
    sets, goal = [gain_set(rig, with_gains(PRESET, kp=12000.0, ki=1000.0, kd=9.0))], GOAL
    for i in range(3):
        if (named := next_step(RIG, sets, ("kp", "ki", "kd"), goal=goal)).stop:
            break
        sets.append(gain_set(rig, named.next, seed=i + 1, name=f"run{i + 2}.npz"))
    assert named.claimed[named.keep].missed == ("phase_margin",)
    open_ = next_step(RIG, sets, goal=goal)
    assert open_.kind == "climb" and open_.next.td < PRESET.td and "td " in open_.why
    assert "phase_margin" in named.stop
    # Once a recording has another td it is tuned without being named.
    for i in range(4):
        sets.append(gain_set(rig, open_.next, seed=9 + i, name=f"run{9 + i}.npz"))
        if (open_ := next_step(RIG, sets, goal=goal)).stop:
            break
    assert "td" in open_.task.box.names and open_.stop
    assert open_.claimed[open_.keep].missed == () and open_.claimed[open_.keep].met > 0.7
