"""Every search is told what a recommendation refuses."""

import numpy as np
import pytest

from maglev_env.loop.gains import of_axis
from maglev_env.task.episodes import Episode
from maglev_env.task.task import make_task
from tuning.methods import METHODS, make_tuner
from tuning.search.heeding import Heeding
from tuning.study.limits import LIMITS, heeding
from tuning.tuner import Trials

FINE = {"peak_sensitivity": 2.5, "phase_margin": 30.0, "gain_margin_high": 3.0, "peak_displacement": 30e-6}
NONE = {one.name: np.ones(1) for one in LIMITS.requirements}


def told(nearer=NONE, **changed):
    points = np.zeros((1, 3))
    trials = Trials(points, np.ones(1), np.zeros((1, 0)), (FINE | changed,), np.zeros(1, bool))
    return heeding(trials, 350e-6, nearer).score[0]


def test_gains_that_would_be_refused_score_less():
    assert told() > 0.99
    assert told(phase_margin=19.0) < 0.6 > told(peak_sensitivity=4.3)
    assert told(gain_margin_high=1.4) < 0.6 > told(peak_displacement=150e-6)
    assert told(between_lines_peak_sensitivity=6.0) < 0.2  # what the lines do not show
    assert told({**NONE, "phase_margin": np.full(1, 0.6)}) < 0.5  # on rigs within tolerance
    assert 0 < told(phase_margin=5.0) < told(phase_margin=15.0)  # a search still sees the way


def test_a_margin_that_the_lines_do_not_hold_costs_nothing():
    row = {name: value for name, value in FINE.items() if "margin" not in name}
    trials = Trials(np.zeros((1, 3)), np.ones(1), np.zeros((1, 0)), (row,), np.zeros(1, bool))
    assert heeding(trials, 350e-6, NONE).score[0] > 0.99


@pytest.mark.parametrize("goal", ["match", "peak_sensitivity <= 3, best noise_current near 0.012"])
def test_only_general_searches_under_requirements_heed_by_a_model(goal):
    task = make_task(protocol="quick", goal=goal)
    episode = Episode(task.rig, task.target, task.box.point(of_axis(task.rig.gains, 0)), 0)
    for name in ("nelder-mead", "nelder-mead@preset", "de", "model", "sobol"):
        tuner = make_tuner(name, task, episode, 0, 5)
        wanted = goal != "match" and METHODS[name.partition("@")[0]].near is not None
        assert isinstance(tuner, Heeding) == wanted
        np.testing.assert_array_equal(tuner.ask(1).shape, (1, 3))
