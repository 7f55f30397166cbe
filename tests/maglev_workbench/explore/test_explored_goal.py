"""The goal's bars, the large-signal test, the map of a sweep and the rig of a diagnosis, without a browser."""

import json
from dataclasses import asdict, replace

import numpy as np
import pytest
import xarray as xr

from maglev_env.design.defaults import with_defaults
from maglev_env.design.goals import with_goal
from maglev_env.experiment import protocol_experiment
from maglev_env.recordings.campaign_writer import toml_table
from maglev_env.rig.rig_file import load_rig
from maglev_env.rig.rig_toml import rig_toml
from maglev_workbench.commands.explore.asked import asked
from maglev_workbench.explore.curves import loop_curves
from maglev_workbench.explore.goal_bars import bars, followed, linear_row, shown_goal, simulated_goal
from maglev_workbench.explore.panels import event_curves, panels_data
from maglev_workbench.explore.sweep_map import read_sweep
from maglev_workbench.goal_page import PREFIX

RIG = with_defaults(load_rig("hmb_free"))
EXPERIMENT = protocol_experiment(RIG)
AT_ONCE = {"peak_sensitivity", "phase_margin", "gain_margin", "compliance"}


@pytest.fixture(scope="module")
def found():
    return simulated_goal(EXPERIMENT, shown_goal(RIG), 0)


def test_the_linear_model_says_at_once_what_the_noisy_nonlinear_experiment_shows(found):
    goal, curves = shown_goal(RIG), loop_curves(EXPERIMENT, 0)
    linear = {one.name: one for one in bars(goal, linear_row(curves), curves)}
    assert set(linear) == AT_ONCE
    for one in bars(goal, found.row):
        if one.name in AT_ONCE:
            # Of one draw: three times the half width of the 95 % interval, and 1 % for the curvature of the force law.
            limit = next(r.limit for r in goal.requirements if r.name == one.name)
            half = 3 * (found.row[f"{PREFIX}{one.name}_high"] - found.row[PREFIX + one.name]) / limit + 0.01
            assert linear[one.name].share == pytest.approx(one.share, abs=half)
            assert linear[one.name].met == one.met


def test_all_requirements_have_a_bar_after_the_experiment(found):
    goal = shown_goal(RIG)
    assert [one.name for one in bars(goal, found.row)] == [one.name for one in goal.requirements]
    assert {one.name: one.met for one in bars(goal, found.row)}["phase_margin"] is False  # docs/goals.md: 23°


def test_an_unstable_loop_has_no_bars():
    curves = loop_curves(protocol_experiment(RIG, replace(RIG.gains, kp=500.0)), 0)
    assert bars(shown_goal(RIG), linear_row(curves), curves) == []


def test_load_and_lift_off_are_followed_in_time(found):
    curves, limits = event_curves(found), followed(RIG)
    lift = curves["lift_off"]
    assert lift["y"][0] == pytest.approx(limits["lift_off"].size, rel=0.02)
    assert abs(lift["y"][-50:]).max() < 0.02 * lift["y"][0]
    # The loop's own step, which is that of the linear model, times the load: within the noise and the law's curvature.
    linear, load = loop_curves(EXPERIMENT, 0), curves["load"]
    expected = limits["load"].size * np.interp(load["x"], linear.times, linear.step)
    np.testing.assert_allclose(load["y"], expected, atol=0.1 * expected.max())
    assert max(load["x"]) < linear.times[-1] * 1.5


def test_a_goal_of_ones_own_is_judged_on_the_rig_alone_and_names_its_panels():
    rig = with_goal(RIG, "peak_sensitivity <= 2, recovery_time <= 0.02 after 0.5, worst of 4 rigs")
    assert shown_goal(rig).rigs == 0
    assert "0.5" in panels_data(rig, "bench")["load"]["title"]
    assert "175 µm" in panels_data(rig, "bench")["lift_off"]["title"]
    assert "lift_off" not in panels_data(with_defaults(load_rig("hmb_radial")), "bench")


def test_a_sweep_is_read_and_says_where_it_begins(swept):
    found = read_sweep(swept, [RIG], RIG.gains)
    assert (found.x, found.y, found.log) == ("kp", "kd", False)
    assert found.gains_of(found.best) == {"kp": 8e3, "kd": 6.0, "ki": 2e3, "td": 1e-4, "ti": 0.0318}
    assert found.values["score"][0] is None and found.values["stiffness"][1] == 35e3


@pytest.mark.parametrize(
    ("name", "rig", "error", "words"),
    [("", "eframe", ValueError, "swept hmb_free"), ("no", "hmb_free", FileNotFoundError, "make it with maglev sweep")],
)
def test_a_sweep_that_does_not_fit_is_refused(swept, name, rig, error, words):
    with pytest.raises(error, match=words):
        read_sweep(swept / name if name else swept, [with_defaults(load_rig(rig))], RIG.gains)


def stored(folder, swept, gains=(), **attributes):
    """The sweep with other attributes, and more gains."""
    data = xr.load_dataset(swept / "sweep.nc").assign_attrs(attributes)
    constant = {name: ("experiment", np.full(data.sizes["experiment"], value)) for name, value in gains}
    data.assign_coords(constant).to_netcdf(folder / "sweep.nc", engine="h5netcdf")
    return folder


def as_stored(rig):
    return json.dumps(asdict(rig))


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"rig": as_stored(replace(RIG, mass=0.9))}, "swept hmb_free with another mass"),
        ({"effects": '{"delay": {"time": 1e-4}}'}, "with another set of effects"),
        ({"sensor": "self_sensing"}, "read by self_sensing"),
        ({"gains": [("notch_frequency", 650.0)]}, r"another controller than the page has \(notch_frequency"),
    ],
)
def test_a_sweep_of_another_rig_of_the_same_name_is_refused(swept, tmp_path, changes, words):
    with pytest.raises(ValueError, match=words):
        read_sweep(stored(tmp_path, swept, **changes), [RIG], RIG.gains)


def test_a_sweep_is_of_the_page_or_of_the_rig_before_its_diagnosis(swept, tmp_path):
    diagnosed = replace(RIG, mass=0.9, effects={"delay": {"time": 1e-4}})
    for rig in (RIG, diagnosed):
        stored(tmp_path, swept, rig=as_stored(rig), effects="{}", sensor="probe")
        assert read_sweep(tmp_path, [diagnosed, RIG], RIG.gains).best == 19


def test_a_sweep_by_another_goal_says_so(swept, tmp_path):
    assert read_sweep(swept, [RIG], RIG.gains).note == ""
    other = with_goal(RIG, "peak_sensitivity <= 2,\nbest noise_current near 0.02")
    assert "by its own goal (match), not" in read_sweep(swept, [other], RIG.gains).note
    stored(tmp_path, swept, rig=as_stored(other))
    note = read_sweep(tmp_path, [RIG], RIG.gains).note
    assert "\n" not in note and "noise_current near 0.02" in note
    assert read_sweep(tmp_path, [other], RIG.gains).note == ""


def test_another_file_is_no_sweep(tmp_path):
    (tmp_path / "sweep.nc").write_text("not a sweep")
    with pytest.raises(ValueError, match=r"is not the sweep\.nc"):
        read_sweep(tmp_path, [RIG], RIG.gains)


def test_a_campaign_with_a_diagnosis_is_explored_with_what_was_found(tmp_path):
    recording = {"file": "run1.npz", "sample_rate": 20000.0}
    excitation = {"kind": "sphs", "at": "force", "fundamental": 1.0, "harmonics": [1, 250], "amplitude": 3.0}
    text = ['schema = "maglev-campaign/1"', 'rig = "hmb_free"', *toml_table("[[recording]]", recording)]
    text += [*toml_table("[recording.excitation]", excitation), "[recording.channels]", 'force = { from = "F" }']
    (tmp_path / "campaign.toml").write_text("\n".join(text))
    np.savez(tmp_path / "run1.npz", F=np.zeros(40000))
    assert not asked(str(tmp_path)).diagnosed
    corrected = tmp_path / "diagnosis" / "corrected.toml"
    corrected.parent.mkdir()
    corrected.write_text(rig_toml(replace(load_rig("hmb_free"), effects={"delay": {"time": 7.5e-5}})))
    found = asked(str(tmp_path))
    assert found.diagnosed and dict(found.rig.effects) == {"delay": {"time": 7.5e-5}}
    assert found.source.option == str(corrected)
