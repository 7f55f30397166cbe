"""Studies side by side are those one by one; courses and optima of rigs."""

import numpy as np
import pytest

from maglev_env.task.task import make_task
from tuning.lockstep import course, judged, optima, side_by_side
from tuning.methods import METHODS, make_tuner
from tuning.study.study import experiments

pytestmark = pytest.mark.slow
TASK = make_task(protocol="quick", randomization="wide")
EPISODES = [TASK.draw(np.random.default_rng(i)) for i in range(3)]


@pytest.fixture(autouse=True)
def short_search(monkeypatch):
    monkeypatch.setattr("tuning.search.corrected.tuner.ROUNDS", 2)


def tuners(method, budget):
    return [make_tuner(method, TASK, e, seed, budget) for seed, e in enumerate(EPISODES)]


@pytest.mark.parametrize("method", [name for name, m in METHODS.items() if m.longest is None])
def test_side_by_side_is_one_by_one(method):
    budget = 6
    together = side_by_side(TASK, EPISODES, tuners(method, budget), budget, batch=2)
    alone = side_by_side(TASK, EPISODES[1:2], tuners(method, budget)[1:2], budget, batch=2)[0]
    np.testing.assert_array_equal(together[1].points, alone.points)
    np.testing.assert_array_equal(together[1].score, alone.score)
    assert [len(t) for t in together] == [budget] * 3
    if METHODS[method].safe_start:
        np.testing.assert_allclose(together[2].points[0], EPISODES[2].start)


def test_a_course_is_what_fresh_noise_says_of_the_best_so_far():
    trials = side_by_side(TASK, EPISODES, tuners("model", 4), 4)
    found = course(trials)
    best, touchdowns, meets = judged(TASK, EPISODES, found, (1, 4), seed=5)
    assert np.isnan(meets).all()
    assert best.shape == (3, 2) and (best[:, 1] > best[:, 0]).all()
    np.testing.assert_allclose(best[:, 1], found.score.max(axis=1), atol=0.05)
    assert (touchdowns[:, 1] >= touchdowns[:, 0]).all()


def test_what_is_met_is_what_the_medians_of_fresh_experiments_meet():
    goal = "phase_margin >= 25, compliance <= 80e-6, best noise_current near 0.02"
    task = make_task(protocol="quick", goal=goal)
    episode = task.draw(np.random.default_rng(0))
    points = task.box.actions(np.array([[8000.0, 2000.0, 5.2], [10000.0, 2000.0, 8.0]]))  # 23 and 33 degrees
    trials = [experiments(task, [episode], point[None], 1) for point in points]
    _, _, meets = judged(task, [episode] * 2, course(trials), (1,), seed=0)
    np.testing.assert_array_equal(meets[:, 0], [0.0, 1.0])


def test_optima_are_not_beaten_by_the_preset():
    points, scores = optima(TASK, EPISODES, seed=0, budget=240)
    preset = TASK.box.actions([8000.0, 2000.0, 5.2])
    plain = experiments(TASK, EPISODES, np.tile(preset, (3, 1)), [0, 0, 0]).score
    assert (scores > plain - 0.02).all() and (scores > 0.9).all() and points.shape == (3, 3)


def test_an_unknown_method_is_refused_with_those_that_are_known():
    with pytest.raises(ValueError, match=r"simulated-annealing.*model"):
        make_tuner("simulated-annealing", TASK, EPISODES[0], 0, 10)
