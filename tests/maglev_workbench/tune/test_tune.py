"""`maglev tune` as a user runs it."""

import json
from functools import partial

import pytest
from command_line import maglev

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
        (("--method", "annealing"), "--method annealing: use one of grid"),
        (("--budget", 0), "Invalid value"),
        (("--rig", "pedestal"), "no controlled magnet"),
        (("--tune", "kq"), "no gain 'kq'"),
    ],
)
def test_bad_input_is_refused_before_any_work(tmp_path, monkeypatch, arguments, words):
    monkeypatch.chdir(tmp_path)
    assert words in run(*arguments, code=2).replace("│", "").replace("  ", " ")
    assert not list(tmp_path.iterdir())


@pytest.mark.slow
def test_a_folder_of_another_study_is_refused(tmp_path):
    run("--budget", 1, *QUICK, "--out", tmp_path / "s")
    assert "another seed" in run("--budget", 1, "--seed", 1, *QUICK, "--out", tmp_path / "s", code=2)
    assert "another method" in run("--budget", 1, "--method", "sobol", *QUICK, "--out", tmp_path / "s", code=2)
