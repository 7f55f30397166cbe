"""`maglev tune --rig pump` as a user runs it."""

import json
import shlex
from functools import partial

import numpy as np
import pytest
from command_line import maglev

from maglev_env.rig.rig_file import ROTOR_FOLDER
from maglev_env.rotor.loop_quantities import PLANES, TOGETHER, Found
from maglev_env.rotor.requirements import rotor_goal
from maglev_env.rotor.rotor import load_rotor
from maglev_env.task.pump_goal import make_rotor_goal_task
from maglev_workbench.commands.runup.asked import parse_speeds, with_chosen_gains
from maglev_workbench.commands.tune import rotor as rotor_command
from maglev_workbench.commands.tune.rotor_report import check_rows, found_json, place_rows, speed_rows

run = partial(maglev, "tune", "--rig", "pump")
GOAL = "peak_sensitivity <= 3, phase_margin >= 20, best noise_current near 0.02"


@pytest.mark.slow
def test_a_rotor_is_tuned_checked_and_goes_on(tmp_path):
    out, js = tmp_path / "study", tmp_path / "a.json"
    arguments = ("--goal", GOAL, "--speeds", "0:14000:14000", "--rejection", 10, "--batch", 4, "--out", out)
    text = run(*arguments, "--budget", 4, "--json", js)
    assert "Take kp_translation = " in text and "4 experiments" in text and "Checked in simulation" in text
    data = json.loads(js.read_text())
    assert data["schema"] == "maglev-tune/1" and data["goal"].startswith("peak_sensitivity <= 3")
    best = data["recommended"]
    assert set(best["gains"]) == {f"{g}_{c}" for g in ("kp", "ki", "kd") for c in ("translation", "tilt")}
    by_speed = data["by_speed"]["peak_sensitivity"]
    assert by_speed["speeds"] == [0, 14_000] and by_speed["places"][-1] == TOGETHER
    assert best["requirements"]["peak_sensitivity"]["value"] == pytest.approx(np.max(by_speed["values"]), rel=1e-6)
    # The simulated run-up is that of these gains, with and by the command that is printed.
    checked = data["run_up"]
    assert checked["gains"]["tilt"]["kp"] == best["gains"]["kp_tilt"] and checked["rejection"]["rate"] == 10
    assert all(row["touchdown"] is None for row in checked["speeds"])
    again = shlex.split(text.partition("the same run-up: maglev ")[2].partition("4 experiments")[0])
    other = tmp_path / "runup.json"
    maglev(*again, "--speeds", "14000", "--out", tmp_path / "r", "--json", other)
    found = json.loads(other.read_text())
    assert found["speeds"][0]["peak"] == pytest.approx(checked["speeds"][-1]["peak"], rel=0.1)
    assert max(found["speeds"][0]["coil_once"]) < 0.02  # rejected, of 0.3 A
    page = (out / "tune.html").read_text()
    assert "Requirements over the speeds" in page and "By mode and plane" in page
    assert "4 reused" in run(*arguments, "--budget", 8)


def test_a_rate_of_rejection_keeps_the_least_speed_of_the_file(tmp_path, monkeypatch):
    def asked(rotor, *_, **__):
        raise ValueError(f"{rotor.rejection}")

    monkeypatch.setattr(rotor_command, "make_rotor_goal_task", asked)
    path = tmp_path / "own.toml"
    path.write_text((ROTOR_FOLDER / "pump.toml").read_text() + "\n[rejection]\nrate = 5.0\nfrom_speed = 3000.0\n")
    assert "rate=20.0, from_speed=3000.0" in maglev("tune", "--rig", path, "--rejection", 20, code=2)
    assert "rate=5.0, from_speed=3000.0" in maglev("tune", "--rig", path, code=2)


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("--method", "model"), "--method model is made for one axis"),
        (("--goal", "match"), "--goal match is for rigs of one axis"),
        (("--goal", "peak <= 3"), "no quantity 'peak'"),
        (("--effect", "delay=1e-4"), "--effect: not for a rotor"),
        (("--controller", "pid + notch 650"), "--controller: not for a rotor"),
        (("--speeds", "fast"), "--speeds 'fast'"),
        (("--speeds", "0:20000:10000"), "lower --speeds"),
        (("--rejection", 0), "rate = 0"),
        (("--tune", "kq"), "no gain 'kq'"),
        (("--rig", "hmb_free", "--speeds", "0"), "--speeds is for rotors"),
        (("--rig", "hmb_free", "--rejection", 3), "--rejection is for rotors"),
    ],
)
def test_bad_input_is_refused_before_any_work(tmp_path, monkeypatch, arguments, words):
    monkeypatch.chdir(tmp_path)
    assert words in run(*arguments, code=2).replace("│", "").replace("  ", " ")
    assert not list(tmp_path.iterdir())


def test_a_rotors_file_is_known_by_its_schema(tmp_path):
    from maglev_workbench.presets import is_rotor

    (tmp_path / "r.toml").write_text('# mine\nschema = "maglev-rotor/1"\n')
    (tmp_path / "a.toml").write_text('schema = "maglev-rig/1"\n')
    found = [is_rotor(str(name)) for name in ("pump", "hmb_free", tmp_path / "r.toml", tmp_path / "a.toml", "no.toml")]
    assert found == [True, False, True, False, False]


def test_tables_name_the_worst_mode_or_plane_and_what_is_missed():
    goal = rotor_goal(load_rotor("pump"), "peak_sensitivity <= 2, displacement <= 0.3, best noise_current near 0.02")
    found = {
        "peak_sensitivity": Found((0.0, 6000.0), (*PLANES, TOGETHER), np.array([[1.2, 1.4, 1.4], [1.1, 1.9, 2.1]])),
        "displacement": Found((0.0, 6000.0), PLANES, np.array([[0.1, 0.05], [0.2, 0.35]])),
        "noise_current": Found((0.0, 6000.0), PLANES, np.array([[0.010, 0.011], [0.012, 0.011]])),
    }
    assert speed_rows(goal, found) == [
        ["0", "1.40 b", "0.100 a", "11.0 b"],
        ["6000", "2.10 all, b 1.90 !", "0.350 b !", "12.0 a"],
    ]
    rows = place_rows(goal, found)
    assert [row[1] for row in rows] == [*PLANES, TOGETHER, *PLANES, *PLANES]
    assert [row[4] for row in rows] == ["met", "met", "missed", "met", "missed", "", ""]
    assert rows[2][2:4] == ["2.10", "6000"]


def test_the_command_of_the_same_run_up_is_one_of_a_shell_and_leaves_out_nothing():
    task = make_rotor_goal_task(load_rotor("pump"), GOAL, ("kp", "kd"), None, [0.0, 9250.0], budget=1)
    point = np.array([0.123, 0.456, 0.5, 0.61])
    program, *words = shlex.split(rotor_command.command("my pumps/a b.toml", task, point, 1 / 3, 9250.0, 7))
    assert (program, words[0]) == ("maglev", "runup")
    given = dict(zip(words[1::2], words[2::2], strict=True))
    assert given["--rotor"] == "my pumps/a b.toml" and given["--seed"] == "7" and float(given["--rejection"]) == 1 / 3
    np.testing.assert_array_equal(parse_speeds(given["--speeds"]), [*range(0, 9001, 500), 9250])
    single = [words[i + 1] for i, word in enumerate(words) if word == "--gains"]
    assert with_chosen_gains(task.rotor, {}, single).gains == task.at(task.rotor, point).gains


def test_a_value_without_a_bound_is_none_in_json():
    found = {"compliance": Found((0.0, 6000.0), PLANES, np.array([[np.inf, 1e-5], [np.nan, 2e-5]]))}
    data = json.loads(json.dumps(found_json(found), allow_nan=False))
    assert data == {"compliance": {"speeds": [0, 6000], "places": list(PLANES), "values": [[None, 1e-5], [None, 2e-5]]}}


@pytest.mark.slow
def test_the_identified_peaks_are_beside_the_linear_models():
    from maglev_workbench.commands.runup.study import report

    rows = check_rows(report(load_rotor("pump"), np.array([0.0, 14_000.0]), 0, None))
    assert [row[:2] for row in rows] == [[v, c] for v in ("0", "14000") for c in ("translation", "tilt")]
    for _, _, identified, model in rows:
        assert float(identified) == pytest.approx(float(model), rel=0.05)
