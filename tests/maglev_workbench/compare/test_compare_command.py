"""`maglev compare` as a user runs it."""

import json
from functools import partial

import pytest
from command_line import maglev

from tuning.learned.tuner import SHIPPED

run = partial(maglev, "compare")
SMALL = ("--rigs", 3, "--budgets", "1,2", "--protocol", "quick")


@pytest.mark.slow
def test_table_page_markdown_and_json_say_the_same(tmp_path, monkeypatch):
    monkeypatch.setattr("tuning.comparison.compare.SEARCH", 120)
    monkeypatch.setattr("tuning.search.corrected.tuner.ROUNDS", 2)
    out, docs, file = tmp_path / "c", tmp_path / "tuners.md", tmp_path / "c.json"
    arguments = ("sobol", "model", *SMALL, "--effect", "delay=75e-6", "--out", out, "--docs", docs, "--json", file)
    text = run(*arguments)
    data = json.loads(file.read_text())
    assert data["schema"] == "maglev-compare/1" and data["budgets"] == [1, 2] and len(data["best"]) == 3
    assert list(data["made_by"]["effects"]) == ["delay"] and data["made_by"]["methods"] == ["sobol", "model"]
    last = {r["method"]: r["at"][-1] for r in data["results"]}
    value, low, high = last["model"]["median"]
    assert 0 <= value < last["sobol"]["median"][0] and low is None and high is None  # of three rigs
    shown = f"{value:.4f}"
    assert "Fewer than 6 rigs tell no 95 % interval" in text
    page, markdown = (out / "compare.html").read_text(), docs.read_text()
    assert "3 rigs drawn wide" in text and all(shown in t for t in (text, page, markdown))
    assert last["model"]["better"]["sobol"][0] == 1 and "1.00 [0.29, 1.00]" in markdown
    for heading in ("Regret against experiments", "Performance profiles", "Probability that a tuner"):
        assert heading in page
    assert "| touchdowns per 100 | s per tuning |" in markdown
    assert "delay: time = 7.5e-05" in page
    assert "maglev compare sobol model --rig hmb_free --rigs 3" in markdown and "--effect delay=75e-6" in markdown
    assert json.loads((out / "compare.json").read_text()) == data
    assert f"reused from {out}: sobol, model".replace(" ", "") in run(*arguments).replace(" ", "")
    assert json.loads(file.read_text())["results"][0]["score"] == data["results"][0]["score"]


@pytest.mark.slow
def test_a_goal_of_requirements_has_scores_and_a_share_that_meets_it(tmp_path, monkeypatch):
    monkeypatch.setattr("tuning.comparison.compare.SEARCH", 60)
    out, docs, file = tmp_path / "c", tmp_path / "tuners.md", tmp_path / "c.json"
    goal = "phase_margin >= 25, compliance <= 60e-6, best noise_current near 0.02"
    arguments = ("nelder-mead@preset", "rule", *SMALL, "--out", out, "--docs", docs, "--json", file)
    text = run(*arguments, "--goal", goal)
    data = json.loads(file.read_text())
    assert "under a goal of requirements on 3 rigs" in " ".join(text.split())
    assert data["made_by"]["rig"]["target"]["goal"].startswith("phase_margin >= 25")
    for one in data["results"]:
        met = [share for rig in one["met"] for run in rig for share in run]
        assert set(met) <= {0.0, 1.0} and one["at"][-1]["met"] == sum(rig[0][-1] for rig in one["met"]) / 3
        # What meets all limits scores more than half of that of the best quantity, which is at least one half.
        for rig, scores in zip(one["met"], one["score"], strict=True):
            assert all(score > 0.4 or not m for m, score in zip(rig[0], scores[0], strict=True))
    assert "| met % |" in docs.read_text() and "--goal" in docs.read_text()
    assert "another goal" in run(*arguments, "--goal", "phase_margin >= 26", code=2)


def test_goals_have_folders_of_their_own(tmp_path, monkeypatch):
    def stop(task, *_):
        raise KeyboardInterrupt

    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("tuning.comparison.compare.optima", stop)
    for goal in ("engineer", "phase_margin >= 25"):
        run("sobol", *SMALL, "--goal", goal, code=130)
    run("sobol", *SMALL, code=130)
    names = sorted(one.name for one in tmp_path.iterdir())
    assert names[:2] == ["compare-hmb_free", "compare-hmb_free-engineer"] and len(names) == 3


def test_an_interrupt_says_how_to_go_on(tmp_path, monkeypatch):
    def stop(*_):
        raise KeyboardInterrupt

    monkeypatch.setattr("tuning.comparison.compare.optima", stop)
    assert "same command again" in run("sobol", *SMALL, "--out", tmp_path / "c", code=130)


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("annealing",), "'annealing' is unknown; use one of grid"),
        (("--rigs", 0), "rigs = 0"),
        (("--repeats", 0), "repeats = 0"),
        (("de", "--policy", SHIPPED / "hmb_free-quick.npz"), "method learned is not"),
        (("learned", "--rig", "eframe"), "serve other rigs"),
        (("learned", "--policy", SHIPPED / "hmb_free-quick.npz", "--protocol", "full"), "other observations"),
        (("--budgets", "30,10"), "give increasing"),
        (("--budgets", "0,10"), "give increasing"),
        (("--budgets", "ten"), "give whole numbers"),
        (("--rig", "pedestal"), "no controlled magnet"),
        (("--goal", "phase_margin >= many"), "is not understood"),
    ],
)
def test_bad_input_is_refused_before_any_work(tmp_path, monkeypatch, arguments, words):
    monkeypatch.chdir(tmp_path)
    assert words in run(*arguments, code=2)
    assert not list(tmp_path.iterdir())
