"""Environments with a goal: the existing spaces stay, and a goal adds its elements and infos."""

import gymnasium as gym
import numpy as np
import pytest

import maglev_env  # noqa: F401  (registers the ids)
from maglev_env.envs.vector import RigVectorEnv
from maglev_env.task.task import make_task

GOAL = "peak_sensitivity <= 3, phase_margin >= 30, impulse_displacement <= 1e-4 after 4e-3, best compliance near 2e-5"


def test_without_a_goal_nothing_changes_and_a_goal_adds_elements():
    plain, aimed = make_task(protocol="quick"), make_task(protocol="quick", goal=GOAL)
    added = ("reserve_peak_sensitivity", "reserve_phase_margin", "reserve_impulse_displacement", "reserve_compliance")
    assert aimed.layout.names == (*plain.layout.names, *added)
    assert gym.make("maglev/HMBFree-v0", protocol="quick").observation_space.shape == (len(plain.layout.names),)


def test_one_and_many_environments_agree_and_tell_what_the_goal_measures():
    one = gym.make("maglev/HMBFree-v0", protocol="quick", goal=GOAL)
    many = RigVectorEnv(2, rig="hmb_free", protocol="quick", goal=GOAL)
    observation, info = one.reset(seed=5)
    observations, _ = many.reset(seed=[5, 6])
    assert np.array_equal(observation, observations[0])
    action = np.array([0.2, 0.0, 0.4], np.float32)
    observation, reward, *_, info = one.step(action)
    observations, rewards, *_ = many.step(np.stack([action, -action]))
    assert np.array_equal(observation, observations[0]) and reward == rewards[0] == info["score"]
    assert info["required_phase_margin_low"] < info["required_phase_margin"] < info["required_phase_margin_high"]
    assert 0 < info["term_best"] < 1 and info["required_impulse_displacement"] < 1e-4
    names = one.unwrapped.observation_names
    reserve = observation[names.index("reserve_compliance")]
    assert reserve == pytest.approx(np.log(2e-5 / info["required_compliance"]) / np.log(5), abs=1e-5)
    assert one.observation_space.contains(observation)
