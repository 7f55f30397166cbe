"""`maglev tune` as a user runs it."""

import json
from dataclasses import replace
from functools import partial
from types import SimpleNamespace

import numpy as np
import pytest
from command_line import maglev

from maglev_env.design.controllers import with_controller
from maglev_env.rig.goal import parse_goal
from maglev_env.rig.rig_file import load_rig
from maglev_env.task.gain_box import gain_box
from maglev_env.task.task import make_task
from maglev_workbench.commands.tune.advised import farther_in_words, passed_in_words, unstated_noise
from maglev_workbench.commands.tune.figures import where_figure
from maglev_workbench.goal_label import goal_label
from tuning.study.passed_over import PassedOver
from tuning.study.recommendation import Recommendation
from tuning.tuner import Trials

run = partial(maglev, "tune")
QUICK = ("--protocol", "quick")


@pytest.mark.slow
def test_gains_are_found_recommended_and_the_study_goes_on(tmp_path):
    out, first, second = tmp_path / "study", tmp_path / "a.json", tmp_path / "b.json"
    text = run("--effect", "delay=75e-6", "--budget", 3, *QUICK, "--out", out, "--json", first)
    assert "Take kp = " in text and "3 experiments" in text
    data = json.loads(first.read_text())
    assert data["schema"] == "maglev-tune/1" and len(data["experiments"]) == 3 and data["reused"] == 0
    best = data["recommended"]
    assert best["score"] > data["experiments"][0]["score"] and best["reason"] is None
    low, high = best["intervals"]["score"]
    assert low < best["score"] and high <= 1 and data["made_by"]["method"] == "model"
    page = (out / "tune.html").read_text()
    assert "Recommended" in page and "Where it looked" in page and json.loads((out / "tune.json").read_text()) == data
    again = run("--effect", "delay=75e-6", "--budget", 4, *QUICK, "--out", out, "--json", second)
    assert "3 reused" in again
    assert json.loads(second.read_text())["experiments"][:3] == data["experiments"]


@pytest.mark.slow
def test_gains_that_do_not_hold_up_are_refused_in_words(tmp_path):
    text = run("--budget", 2, "--method", "rule", "--effect", "delay=3e-4", *QUICK, "--out", tmp_path / "s")
    assert "None of the gains tried is recommended" in text


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("--method", "annealing"), "'annealing' is unknown; use one of grid"),
        (("--budget", 0), "Invalid value"),
        (("--rig", "pedestal"), "no controlled magnet"),
        (("--tune", "kq"), "no gain 'kq'"),
        (("--tune", "kp=3"), "is not name or name=lo:hi"),
        (("--controller", "pid + comb 3"), "no filter 'comb'"),
    ],
)
def test_bad_input_is_refused_before_any_work(tmp_path, monkeypatch, arguments, words):
    monkeypatch.chdir(tmp_path)
    assert words in run(*arguments, code=2).replace("│", "").replace("  ", " ")
    assert not list(tmp_path.iterdir())


def test_pairs_of_many_gains_are_drawn_in_rows():
    box = gain_box(with_controller(load_rig("hmb_free"), "pid + notch 650"))
    points = np.random.default_rng(0).uniform(-1, 1, (4, 6))
    trials = Trials(points, np.ones(4), np.zeros((4, 0)), ({},) * 4, np.zeros(4, bool))
    drawn = where_figure(SimpleNamespace(box=box), SimpleNamespace(trials=trials), Recommendation(None, ()))
    assert len(drawn.data) == 15 and drawn.layout.height == 5 * 380
    assert drawn.layout.xaxis15.title.text == "notch_depth" and drawn.layout.yaxis15.title.text == "notch_width"


@pytest.mark.slow
def test_a_folder_of_another_study_is_refused(tmp_path):
    run("--budget", 1, *QUICK, "--out", tmp_path / "s")
    assert "another seed" in run("--budget", 1, "--seed", 1, *QUICK, "--out", tmp_path / "s", code=2)
    assert "another method" in run("--budget", 1, "--method", "sobol", *QUICK, "--out", tmp_path / "s", code=2)


def test_two_goals_in_a_row_have_two_folders(tmp_path):
    (tmp_path / "mine.txt").write_text("phase_margin >= 30")
    goals = (
        None,
        "match",
        "engineer",
        "phase_margin >= 30",
        "phase_margin>=30.0",
        "phase_margin >= 31",
        "best compliance near 1e-5",
    )
    labels = [goal_label(g) for g in (*goals, str(tmp_path / "mine.txt"))]
    assert labels[:3] == ["", "-match", "-engineer"] and labels[3] == labels[4]
    assert labels[3].startswith("-phase_margin-") and labels[6].startswith("-compliance-")
    assert labels[7] == labels[3].replace("phase_margin", "mine") and len(set(labels)) == len(labels) - 1
    with pytest.raises(ValueError, match="is not understood"):
        goal_label("phase_margin >= many")


@pytest.mark.slow
def test_a_study_of_one_goal_stands_beside_that_of_another(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    for goal in ("phase_margin >= 30", "phase_margin >= 31"):
        run("--budget", 1, *QUICK, "--goal", goal)
    assert len(list(tmp_path.glob("tune-hmb_free-model-phase_margin-*/study.json"))) == 2
    again = run("--budget", 1, *QUICK, "--goal", goal, "--out", next(tmp_path.glob("tune-*")))
    assert "reused" in again or "another goal" in again


def test_sets_that_scored_higher_and_were_not_taken_are_explained_in_a_sentence():
    """Seven rows above the recommended one had no word, and the page said that nothing was refused."""
    assert passed_in_words(PassedOver()) == ""
    assert passed_in_words(PassedOver((0.7, 0.75), beside=2, beside_refused=1)) == (
        " Of single readings 5 scored higher and are passed over: 2 because the mean is lower under fresh noise "
        "(0.700 .. 0.750), 2 beside sets that were measured again, 1 beside refused ones."
    )
    one = passed_in_words(PassedOver((0.7,)))
    assert one.endswith("1 scored higher and is passed over: 1 because the mean is lower under fresh noise (0.700).")


def test_a_noise_current_without_stated_noise_is_said_to_be_the_converters_alone():
    rig = load_rig("hmb_free")
    goal = parse_goal("peak_sensitivity <= 3, best noise_current near 0.02")
    for noise, words in ((rig.noise, ""), (replace(rig.noise, displacement=0.0), "of its converters alone")):
        task = SimpleNamespace(rig=replace(rig, noise=noise), sensor="probe")
        assert words in (said := unstated_noise(task, goal)) and bool(said) == bool(words)
    assert unstated_noise(task, parse_goal("peak_sensitivity <= 3")) == ""


def test_what_is_to_be_searched_farther_is_one_command_for_all_gains():
    """A range alone would leave the other gains at their preset."""
    task = make_task(load_rig("hmb_free"))
    assert farther_in_words(task, np.zeros(3)) == ""
    text = farther_in_words(task, np.array([1.0, -1.0, 0.2]))
    assert "kp (upper of 3000 .. 24000), ki (lower of 100 .. 20000)" in text
    assert text.endswith("Better may lie beyond: --tune kp=3000:48000 --tune ki=50:20000 --tune kd=1:20")
    assert farther_in_words(task, np.zeros(3), missed=True).endswith(
        "Left as before: td, the filter of the derivative, whose lag costs phase. What is missed may be met beyond: "
        "--tune kp=3000:24000 --tune ki=100:20000 --tune kd=1:20 --tune td"
    )
    # Under a goal td may be worth 35 % of what is made best, at the ends of ranges and within.
    for best, point, told in (
        ("", np.zeros(3), False),
        ("", np.ones(3), True),
        (", best compliance near 1e-5", np.zeros(3), True),
    ):
        own = make_task(load_rig("hmb_free"), goal="phase_margin >= 30" + best)
        text = farther_in_words(own, point)
        assert ("Left as before: td" in text and "Better may lie beyond" in text and text.endswith("--tune td")) is told
    notched = make_task(load_rig("hmb_free"), controller="pid + notch 650", tuned=("notch_depth",))
    assert "--tune notch_depth=0.01:1" in farther_in_words(notched, np.array([-1.0]))
