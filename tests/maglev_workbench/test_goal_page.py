"""A goal on pages and in commands: bars, the front, tables and JSON."""

import json
from functools import partial

import numpy as np
import pytest
from command_line import maglev

from maglev_env.rig.goal import parse_goal
from maglev_workbench.goal_page import (
    front,
    missed_in_words,
    requirement_bars,
    requirement_rows,
    requirements_json,
    standing,
)

GOAL = parse_goal("peak_sensitivity <= 3, gain_margin >= 2, noise_current <= 0.05, best compliance near 2e-5")
ROW = {
    "required_peak_sensitivity": 3.3, "required_peak_sensitivity_low": 3.2, "required_peak_sensitivity_high": 3.4,
    "required_gain_margin": np.nan, "required_noise_current": 0.02, "required_compliance": 1.9e-5,
}  # fmt: skip


def test_a_set_stands_to_its_goal_in_words_bars_and_json():
    rows = requirement_rows(GOAL, ROW)
    assert rows[0] == ("peak |S|", "3.30 ±0.10", "at most 3", "missed")
    assert rows[1][1:] == ("not within the lines", "at least 2", "met")
    assert rows[3] == ("worst compliance", "19.0 µm/N", "as good as possible", "")
    assert missed_in_words(GOAL, ROW) == "misses peak |S| at most 3 (3.30 ±0.10)"
    data = requirements_json(GOAL, ROW)
    assert data["peak_sensitivity"]["met"] is False and data["compliance"]["limit"] is None
    bars = requirement_bars(GOAL, [("one", ROW)])
    assert bars.data[0].x[0] == pytest.approx(1.1) and bars.data[0].x[2] == pytest.approx(0.4)


def test_an_unstable_loop_meets_nothing():
    """Seen: "8 of 8" beside a score of 0; margins of a growing motion are no margins."""
    good = ROW | {"required_peak_sensitivity": 2.9, "feasible": True}
    assert standing(GOAL, good)[0] == "3 of 3"
    assert standing(GOAL, good | {"feasible": False}) == ("0 of 3", "unstable")
    assert standing(GOAL, good | {"feasible": False, "touchdown_time": 0.2}) == ("0 of 3", "touchdown")
    data = requirements_json(GOAL, good | {"feasible": False})
    assert not any(one["met"] for one in data.values())


def test_a_requirement_that_is_missed_between_the_lines_is_not_met():
    hidden = ROW | {"required_peak_sensitivity": 2.9, "required_peak_sensitivity_low": 2.8,
                    "required_peak_sensitivity_high": 86.0, "between_lines_peak_sensitivity": 86.0,
                    "between_lines_gain_margin": 1.03}  # fmt: skip
    rows = requirement_rows(GOAL, hidden)
    assert rows[0] == ("peak |S|", "2.90, 86.0 between the lines", "at most 3", "missed")
    assert rows[1] == ("gain margin", "not within the lines, 1.03 between the lines", "at least 2", "missed")
    assert standing(GOAL, hidden)[0] == "1 of 3"
    assert missed_in_words(GOAL, hidden).startswith("misses peak |S| at most 3 (2.90, 86.0 between")
    assert requirements_json(GOAL, hidden)["peak_sensitivity"]["met"] is False


@pytest.mark.slow
def test_a_goal_may_have_no_limit(tmp_path):
    """Only `best ..`: there are no bars of limits, and nothing to meet."""
    goal = ("--goal", "best compliance near 2e-5")
    text = maglev("sweep", "--kp", 8000, "--kd", "5:6:2", *goal, "--out", tmp_path / "s")
    page = (tmp_path / "s" / "sweep.html").read_text()
    assert "as good as possible" in text and "as good as possible" in page and "Requirements of" not in page
    tune = ("tune", "--budget", 1, "--method", "sobol", "--protocol", "quick", "--out", tmp_path / "t")
    maglev(*tune, *goal)
    assert "Worst compliance against noise current" in (tmp_path / "t" / "tune.html").read_text()


def test_the_front_is_that_of_every_pair_compared():
    rng = np.random.default_rng(3)
    values = {"compliance": rng.integers(1, 30, 200) * 1e-6, "noise_current": rng.integers(1, 30, 200) * 1e-3}
    may = rng.random(200) < 0.8
    found = front(GOAL, values, may)
    points = np.stack(list(values.values()), axis=1)
    for i in np.flatnonzero(may):
        better = (points[may] <= points[i]).all(axis=1) & (points[may] < points[i]).any(axis=1)
        same = (points[found] == points[i]).all(axis=1)
        assert not better.any() if found[i] else better.any() or same.any()
    assert not found[~may].any()


@pytest.mark.slow
def test_a_sweep_and_a_study_by_a_goal(tmp_path):
    goal = tmp_path / "goal.txt"
    goal.write_text("peak_sensitivity <= 3  # zone A\nphase_margin >= 30\nbest compliance near 2e-5\n")
    ranges = ("--kp", "8000:12000:2", "--kd", "5:11:2")
    text = maglev("sweep", *ranges, "--goal", goal, "--out", tmp_path / "s", "--json", tmp_path / "s.json")
    assert "The best set and its goal" in text and "at least 30" in text
    data = json.loads((tmp_path / "s.json").read_text())
    assert data["best"]["gains"]["kd"] == 11 and data["requirements"]["phase_margin"]["met"]
    page = (tmp_path / "s" / "sweep.html").read_text()
    assert "Requirements of the best three" in page and "Worst compliance against noise current" in page
    tune = partial(maglev, "tune", "--budget", 2, "--protocol", "quick", "--method", "sobol", "--goal", goal)
    tune("--out", tmp_path / "t", "--json", tmp_path / "t.json")
    data = json.loads((tmp_path / "t.json").read_text())
    assert data["goal"].startswith("peak_sensitivity <= 3") and "phase_margin" in data["experiments"][0]["requirements"]
    assert "another goal" in maglev(
        "tune", "--budget", 2, "--protocol", "quick", "--method", "sobol", "--out", tmp_path / "t", code=2
    )
    assert "is not understood" in maglev("tune", "--goal", "phase_margin > 3", "--out", tmp_path / "u", code=2)
