"""The formula of a goal's score: monotone, smooth, and what is missed outweighs what is best."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from maglev_env.evaluation.goal_score import BEST, FAR, goal_score, goal_terms, met, scale_in_words
from maglev_env.rig.goal import parse_goal

GOAL = parse_goal("peak_sensitivity <= 3, phase_margin >= 30, compliance <= 40e-6, best compliance")
MEETS = {"peak_sensitivity": 2.0, "phase_margin": 40.0, "compliance": 20e-6}
shares = st.floats(0.02, 50.0)


def score(**changes):
    values = {name: np.array([value]) for name, value in (MEETS | changes).items()}
    return float(goal_score(goal_terms(GOAL, values))[0])


@given(shares, shares, shares, st.floats(1.001, 3.0))
def test_what_is_better_in_one_quantity_never_scores_less(a, b, c, better):
    one = {"peak_sensitivity": 3 * a, "phase_margin": 30 * b, "compliance": 40e-6 * c}
    here = score(**one)
    assert 0 < here <= 1
    for name, value in one.items():
        improved = value * better if name == "phase_margin" else value / better
        assert score(**one | {name: improved}) >= here * (1 - 1e-12)
    assert score(**one | {"compliance": 40e-6 * c / better}) > here


@given(shares, shares, shares)
def test_a_set_that_misses_a_limit_by_a_twentieth_scores_less_than_one_that_meets_all(a, b, c):
    one = {"peak_sensitivity": 3 * a, "phase_margin": 30 * b, "compliance": 40e-6 * c}
    ratios = np.array([a, 1 / b, c])
    if ratios.max() > 1.052:
        assert score(**one) < 0.5
    elif ratios.max() < 0.95:
        assert score(**one) > 0.5


def test_the_terms_are_those_of_the_documentation():
    values = {name: np.array([value]) for name, value in MEETS.items()}
    limit = goal_terms(GOAL, values | {"peak_sensitivity": np.array([3.0])})["peak_sensitivity"][0]
    assert limit == pytest.approx(1 / (1 + np.log(2) * 0.01 / 0.05))
    half = goal_terms(GOAL, values | {"peak_sensitivity": 3 * np.exp([0.05])})["peak_sensitivity"][0]
    assert half == pytest.approx(0.5, abs=0.002)
    assert goal_terms(GOAL, values | {"compliance": np.array([40e-6])})[BEST][0] == pytest.approx(0.5)
    # Smooth: the slope does not jump anywhere, the limit included.
    at = 3 * np.exp(np.linspace(-0.1, 0.1, 4001))
    one = goal_terms(GOAL, {"peak_sensitivity": at, "phase_margin": at, "compliance": at})["peak_sensitivity"]
    bend = np.abs(np.diff(one, 2)).max() / np.abs(np.diff(one)).max()
    assert bend < 0.01


def test_unknown_and_impossible_values_count_as_what_they_are():
    assert score(phase_margin=np.nan) == score(phase_margin=30 * FAR)  # no crossing within the lines
    assert score(compliance=np.nan) < 0.01 and score(peak_sensitivity=np.inf) < 0.01
    goal = parse_goal("stiffness >= 1000")
    terms = goal_terms(goal, {"stiffness": np.array([-5000.0, 0.0, 2000.0])})
    assert terms["stiffness"][0] == terms["stiffness"][1] < 0.01 and terms["stiffness"][2] > 0.99
    assert met(goal, {"stiffness": np.array([-5000.0, 1001.0])}).tolist() == [False, True]


def test_a_scale_that_is_far_from_what_is_reached_is_said_to_be():
    """Seen on balls of another simulator: at 4 mA, with a scale of 80 mA, tuning stopped at its first recording."""
    goal = parse_goal("peak_sensitivity <= 3, best noise_current near 80 mA")
    words = scale_in_words(goal, 0.00412)
    assert "4.12 mA rms" in words and "80 mA rms" in words and "'best noise_current near 0.0041'" in words
    assert parse_goal("peak_sensitivity <= 3, best noise_current near 0.0041").best.limit == 0.0041
    assert scale_in_words(goal, 0.4) and not scale_in_words(goal, 0.05) and not scale_in_words(goal, np.nan)
    assert scale_in_words(parse_goal("peak_sensitivity <= 3"), 1.0) == ""
    # Beyond that a tenth of it is worth less than the hundredth for which an experiment is made.
    best = 0.08 / 4 * np.array([1.0, 0.9])
    values = {"peak_sensitivity": np.full(2, 2.0), "noise_current": best}
    assert np.diff(goal_score(goal_terms(goal, values)))[0] < 0.01
