"""The model-based tuner identifies what the rig differs in, and finds good gains at once."""

import numpy as np
import pytest

from maglev_env.loop.effect import effect
from maglev_env.task.episodes import Episode
from maglev_env.task.task import make_task
from tuning.search.model_based import ModelBased
from tuning.study.study import experiments

TASK = make_task(protocol="quick", randomization="wide")


@pytest.mark.slow
@pytest.mark.parametrize("seed", [0, 1])
def test_the_second_experiment_is_a_good_one(seed):
    episode = TASK.draw(np.random.default_rng(seed))
    tuner, scores = ModelBased(TASK, episode, seed), []
    for i in range(2):
        points = tuner.ask(1)
        assert points.shape == (1, 3) and (abs(points) <= 1).all()
        trials = experiments(TASK, [episode], points, i + 1)
        tuner.tell(trials)
        scores.append(float(trials.score[0]))
    assert scores[1] > 0.9 > scores[0]
    gain = episode.rig.actuator_gain / TASK.rig.actuator_gain
    assert tuner.parameters["actuator_gain"] == pytest.approx(gain, rel=0.05)


@pytest.mark.slow
def test_it_asks_the_same_again_and_knows_nothing_of_the_rig():
    episode = TASK.draw(np.random.default_rng(4))
    first, again = (ModelBased(TASK, episode, 9) for _ in range(2))
    trials = experiments(TASK, [episode], first.ask(1), 1)
    again.ask(1)
    for tuner in (first, again):
        tuner.tell(trials)
    np.testing.assert_array_equal(first.ask(2), again.ask(2))
    assert first._episode.rig is TASK.rig


def test_its_model_has_noise_of_its_own_and_no_effect_of_the_rig():
    task = make_task(protocol="quick", effects=effect("delay", 75e-6))
    episode = Episode(task.rig, task.target, np.zeros(3), 7)
    tuner = ModelBased(task, episode, 7)
    assert tuner._task.effects == {} and tuner._episode.seed != episode.seed


def test_a_model_that_touches_down_where_the_rig_did_not_says_nothing():
    task = make_task("hmb_radial", protocol="quick", randomization="wide")
    tuner = ModelBased(task, task.draw(np.random.default_rng(0)), 0)
    bands = np.ones(len(task.layout.bands))
    whole, nothing = tuner._features({"band_stiffness": bands, "band_damping": bands}), tuner._features({})
    assert [len(part) for part in (*whole, *nothing)] == [2 * len(bands) + 2] * 4
    assert np.isfinite(whole[0]).sum() == 2 * len(bands) and not np.isfinite(nothing[0]).any()
