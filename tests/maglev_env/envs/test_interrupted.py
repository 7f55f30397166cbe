"""A step that is interrupted has not been made: neither budget nor noise is used up."""

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.utils.env_checker import data_equivalence
from gymnasium.vector import AutoresetMode

import maglev_env  # noqa: F401
from maglev_env.task.task import Task

pytestmark = pytest.mark.slow
MORE = {"protocol": "quick", "budget": 2, "randomization": "wide"}


class Interrupted:
    """Task.measure that is interrupted in one of its calls."""

    def __init__(self, at):
        self.at, self.calls, self.real = at, 0, Task.measure

    def __call__(self, *arguments):
        self.calls += 1
        if self.calls == self.at:
            raise KeyboardInterrupt
        return self.real(*arguments)


def interrupted(monkeypatch, act, at=1):
    with monkeypatch.context() as patch:
        broken = Interrupted(at)
        patch.setattr(Task, "measure", lambda *a: broken(*a))
        with pytest.raises(KeyboardInterrupt):
            act()


def test_one_environment(monkeypatch):
    sound, tried = (gym.make("maglev/HMBFree-v0", **MORE).unwrapped for _ in range(2))
    sound.reset(seed=3)
    interrupted(monkeypatch, lambda: tried.reset(seed=3))
    tried.reset(seed=3)
    for act in (np.zeros(3), 0.1 * np.ones(3)):
        interrupted(monkeypatch, lambda act=act: tried.step(act))
        assert data_equivalence(sound.step(act), tried.step(act), exact=True)
    interrupted(monkeypatch, tried.reset)
    assert data_equivalence(sound.reset(), tried.reset(), exact=True)


@pytest.mark.parametrize("mode", [AutoresetMode.NEXT_STEP, AutoresetMode.SAME_STEP])
def test_many_environments_also_where_some_of_them_restart(monkeypatch, mode):
    sound, tried = (
        gym.make_vec("maglev/HMBFree-v0", num_envs=2, autoreset_mode=mode, **MORE).unwrapped for _ in range(2)
    )
    for env in (sound, tried):
        env.reset(seed=3)
    for step in range(5):
        act = np.full((2, 3), 0.1 * step)
        interrupted(monkeypatch, lambda act=act: tried.step(act))
        if mode is AutoresetMode.SAME_STEP and step % 2:  # of two measurements, the restart's
            interrupted(monkeypatch, lambda act=act: tried.step(act), at=2)
        assert data_equivalence(sound.step(act), tried.step(act), exact=True)
