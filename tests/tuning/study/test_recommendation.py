"""Recommended gains hold up; others are refused with the reason. And the dissertation's rule."""

from dataclasses import replace

import numpy as np
import pytest
from scipy import stats

from maglev_env.design.goals import with_goal
from maglev_env.task.task import make_task
from tuning.search.rule import DissertationRule
from tuning.study import recommendation
from tuning.study.passed_over import PassedOver, passed_over
from tuning.study.recommendation import PEAK_SENSITIVITY, recommend, verdict_of
from tuning.study.study import experiments
from tuning.tuner import Trials

pytestmark = pytest.mark.slow
TASK = make_task(protocol="quick", randomization="wide")
NOMINAL = make_task(protocol="quick")
EPISODE = replace(NOMINAL.draw(np.random.default_rng(0)), rig=NOMINAL.rig)


def tried(*gains):
    points = NOMINAL.box.actions(np.array(gains))
    return experiments(NOMINAL, [EPISODE] * len(points), points, 1)


def test_the_best_that_is_safe_is_recommended_with_its_spread():
    trials = tried((8000, 2000, 5.2), (7000, 2000, 4.0), (12000, 2000, 6.0))
    found = recommend(NOMINAL, EPISODE, trials, seed=3)
    assert found.chosen is not None and not found.refused
    np.testing.assert_array_equal(found.chosen.point, trials.points[trials.best])
    low, high = found.chosen.intervals["score"]
    assert 0 < low < found.chosen.score < 1 and high <= 1 and 0 < found.chosen.score_se < 0.05
    again = recommend(NOMINAL, EPISODE, trials, seed=3)
    assert again.chosen.intervals == found.chosen.intervals and again.chosen.score == found.chosen.score


def test_gains_at_the_border_are_refused_with_the_reason():
    sharp, weak = (14000, 2000, 2.2), (3000, 2000, 2.0)
    found = recommend(NOMINAL, EPISODE, tried(sharp, weak), seed=0)
    assert found.chosen is None and len(found.refused) == 2
    reasons = " ".join(v.reason for v in found.refused)
    assert "peak sensitivity up to" in reasons or "touches down in" in reasons
    worst = max(v.intervals.get("peak_sensitivity", (0, 0))[1] for v in found.refused)
    assert worst > PEAK_SENSITIVITY


def test_a_lucky_reading_is_not_recommended():
    trials = tried((8000, 2000, 5.2), (9000, 2000, 5.2), (7000, 2000, 5.2))
    lucky = replace(trials, score=np.array([0.9, 0.99, 0.95]))
    found = recommend(NOMINAL, EPISODE, lucky, seed=0)
    np.testing.assert_array_equal(found.chosen.point, trials.points[0])
    assert found.chosen.score > 0.97 and not found.refused
    assert len(found.passed.lower) == 2 and max(found.passed.lower) < found.chosen.score
    assert found.passed.beside == found.passed.beside_refused == 0


def test_copies_of_refused_gains_do_not_take_the_place_of_others(monkeypatch):
    monkeypatch.setattr(recommendation, "FINALISTS", 1)  # the stated scores are not what these gains reach
    copies, sound = [(14000 + n, 2000, 2.2) for n in range(9)], (8000, 2000, 5.2)
    trials = tried(*copies, sound)
    trials = replace(trials, score=np.array([*np.linspace(0.99, 0.98, 9), 0.5]))
    found = recommend(NOMINAL, EPISODE, trials, seed=0, candidates=2)
    assert len(found.refused) == 1
    np.testing.assert_array_equal(found.chosen.point, trials.points[-1])
    assert found.passed == PassedOver(beside_refused=8)


def test_gains_that_would_be_refused_for_the_same_reason_do_not_take_the_place_of_others():
    """Seen on a pump: of 400 sets the six best that lie apart were refused for phase margins of 17.5 degrees."""
    plain = {"peak_sensitivity": 2.0, "peak_displacement": 0.0}
    info = tuple({**plain, "phase_margin": one} for one in (21.0, 21.2, 17.0, 21.0))
    again = Trials(np.zeros((4, 3)), np.full(4, 0.8), np.zeros((4, 0)), info, np.zeros(4, bool))
    verdict = recommendation.verdict_of(np.zeros(3), again, 2, EPISODE)
    assert "phase margin down to 17" in verdict.reason
    lost = recommendation._lost(again, 2, verdict)
    assert lost["phase_margin"] == pytest.approx(17.3 / 21.1, rel=0.02) and lost["peak_sensitivity"] == 1.0
    assert recommendation._would_lose({"phase_margin": 23.0, "peak_sensitivity": 2.0}, lost)
    assert not recommendation._would_lose({"phase_margin": 26.0, "peak_sensitivity": 2.0}, lost)
    assert recommendation._would_lose({"phase_margin": 26.0, "peak_sensitivity": 4.1}, lost)
    assert not recommendation._would_lose({}, lost)


def readings(hidden_peak, **more):
    """Eight repetitions, six within tolerance, of a loop that reads 2.8 and has this peak between its lines."""
    hidden = {"peak_sensitivity": hidden_peak, "peak_frequency": 658.2, "phase_margin": 25.0, "gain_margin": 2.0}
    between = {f"between_lines_{name}": value for name, value in (hidden | {"disk_margin": 0.4}).items()}
    read = {"peak_sensitivity": 2.8, "phase_margin": 32.0, "gain_margin_high": 2.8, "peak_displacement": 0.0}
    required = {"required_peak_sensitivity": 2.8, "required_peak_sensitivity_high": 2.9}
    return Trials(np.zeros((8, 3)), np.full(8, 0.8), np.zeros((8, 0)), (read | required | between | more,) * 8,
                  np.zeros(8, bool))  # fmt: skip


def test_a_resonance_between_the_lines_is_refused_with_its_frequency():
    found = verdict_of(np.zeros(3), readings(4.45), 2, EPISODE)
    expected = "between the lines at 658 Hz: peak sensitivity up to 4.45, beyond zone B of ISO 14839-3 (4)"
    assert found.reason == expected and found.intervals["peak_sensitivity"][1] == pytest.approx(4.45)
    assert found.required["required_peak_sensitivity"] == pytest.approx(4.45)
    sound = verdict_of(np.zeros(3), readings(3.4), 2, EPISODE)
    assert sound.reason is None and sound.intervals["phase_margin"] == pytest.approx((25.0, 25.0))


def test_what_a_goal_asks_for_must_hold_between_the_lines_too():
    """Scored as if it met the goal, which the lines alone show."""
    asks = replace(EPISODE, rig=with_goal(EPISODE.rig, "peak_sensitivity <= 3, best compliance near 2e-5"))
    found = verdict_of(np.zeros(3), readings(3.4), 2, asks)
    assert found.reason == "between the lines at 658 Hz: peak |S| 3.40, and the goal asks for at most 3"
    assert verdict_of(np.zeros(3), readings(2.95), 2, asks).reason is None
    missed = readings(3.4, required_peak_sensitivity=3.2)  # its score knows that the goal is missed
    assert verdict_of(np.zeros(3), missed, 2, asks).reason is None


def test_gains_of_zone_c_that_read_as_zone_a_are_not_recommended():
    effects = {"delay": 150e-6, "support_resonance": {"frequency": 600.0, "damping_ratio": 0.005, "mass_ratio": 0.2}}
    bounds = {"kp": (4e3, 9e3), "ki": (50.0, 500.0), "kd": (3.0, 12.0), "td": (2e-5, 1e-3)}
    goal = "peak_sensitivity <= 3, compliance <= 70e-6, best noise_current near 0.01"
    task = make_task(tuned=tuple(bounds), bounds=bounds, effects=effects, goal=goal)
    episode = replace(task.draw(np.random.default_rng(0)), rig=task.rig)
    points = task.box.actions(np.array([(4846.0, 106.4, 8.218, 803e-6)]))
    trials = experiments(task, [episode], points, 1)
    assert trials.info[0]["required_peak_sensitivity"] < 3  # the lines show nothing of it
    found = recommend(task, episode, trials, 0, repeats=2, rigs=4)
    assert found.chosen is None and found.refused[0].reason.startswith("between the lines at 65")


def test_the_intervals_of_a_verdict_leave_out_one_of_forty_at_either_end():
    n, own = 4000, 100
    scatter = stats.norm.ppf((np.arange(n) + 0.5) / n)
    info = tuple(
        {"peak_sensitivity": 2.0 + 0.1 * v, "phase_margin": 40.0 + v, "peak_displacement": 0.0} for v in scatter
    )
    scores = np.concatenate([np.linspace(0.4, 0.6, own), np.linspace(0.2, 0.8, n - own)])
    again = Trials(np.zeros((n, 3)), scores, np.zeros((n, 1)), info, np.zeros(n, bool))
    found = verdict_of(np.zeros(3), again, own, EPISODE)
    assert found.reason is None and found.score == pytest.approx(0.5)
    assert found.score_se == pytest.approx(0.2 / np.sqrt(12 * own), rel=0.02)  # evenly spread over 0.2
    assert found.intervals["peak_sensitivity"] == pytest.approx((2 - 0.196, 2 + 0.196), abs=1e-3)
    assert found.intervals["phase_margin"] == pytest.approx((40 - 1.96, 40 + 1.96), abs=1e-2)
    assert found.intervals["score"] == pytest.approx((0.2 + 0.025 * 0.6, 0.8 - 0.025 * 0.6), abs=1e-3)


def test_a_gain_margin_is_told_without_the_readings_that_noise_raised():
    """Of a loop with 2.9, 16 readings had a mean of 3.6."""
    readings = np.array([2.5, 2.7, 2.8, 2.9, 2.9, 3.1, 3.6, 9.4])
    info = tuple({"required_gain_margin": one, "required_lift_off_time": 0.01} for one in readings)
    again = Trials(np.zeros((8, 3)), np.full(8, 0.8), np.zeros((8, 0)), info, np.zeros(8, bool))
    assert verdict_of(np.zeros(3), again, 8, EPISODE).required["required_gain_margin"] == pytest.approx(2.9)
    down = ({**info[0], "required_lift_off_time": np.inf}, *info[1:])
    told = verdict_of(np.zeros(3), replace(again, info=down), 8, EPISODE).required
    assert told["required_lift_off_time"] == np.inf  # one touchdown is one too many


def test_why_sets_that_scored_higher_are_passed_over_is_counted():
    score = np.array([0.9, 0.89, 0.88, 0.87, 0.86, 0.8, 0.1])
    trials = Trials(np.zeros((7, 3)), score, np.zeros((7, 0)), ({},) * 7, np.zeros(7, bool))
    found = passed_over(trials, 5, {0: 0.7, 1: 0.75, 5: 0.82, 6: 0.1}, refused=[0], skipped=[2])
    assert found == PassedOver((0.75,), beside=2, beside_refused=1)


def test_nothing_that_failed_is_recommended():
    trials = tried((3000, 100, 1.0), (4000, 100, 1.0))
    failed = replace(trials, score=np.zeros(2))
    found = recommend(NOMINAL, EPISODE, failed, 0)
    assert found.chosen is None and not found.refused


def test_the_rule_approaches_the_target():
    """It leaves out lags and the filter of the derivative: nearer than the start, not there."""
    rng, first, last = np.random.default_rng(1), [], []
    for _ in range(6):
        episode = TASK.draw(rng)
        tuner = DissertationRule(TASK, episode)
        for i in range(4):
            trials = experiments(TASK, [episode], tuner.ask(1), i + 1)
            tuner.tell(trials)
            (first if i == 0 else last).append(float(trials.score[0]))
    assert np.median(last) > 1.5 * np.median(first)
