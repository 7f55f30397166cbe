"""Every registered environment keeps Gymnasium's and Stable-Baselines3's contracts, to the letter."""

import multiprocessing
import pickle
import subprocess
import sys
import warnings

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env, data_equivalence
from gymnasium.vector import AutoresetMode
from stable_baselines3.common.env_checker import check_env as sb3_check_env

import maglev_env
from maglev_env.envs.registration import IDS, register_envs
from maglev_env.envs.testing import check_vector_env

BALL = """
schema = "maglev-rig/1"
name = "ball"
magnet = "electromagnet"
[parameters]
mass = 0.058
gap = 10e-3
turns = 1000
pole_area = 3e-4
control_rate = 1000.0
probe_gain = 800.0
[tolerance]
mass = 0.02
pole_area = 0.1
"""
PUMP, RADIAL = "maglev/PumpRotor-v0", "maglev/HMBRadial-v0"


def quick(task):
    """Arguments with which steps take little time."""
    return {"speeds": (0.0, 9000.0)} if task[0] == PUMP else {"protocol": "quick"}


def wild(task):
    """Arguments with which as much as can be is drawn."""
    if task[0] == PUMP:
        return {"speeds": (0.0, 14000.0), "budget": 2, "randomization": "tolerances"}
    return {"protocol": "quick", "budget": 4, "randomization": "wide", "draw_target": True}


@pytest.fixture(params=sorted(IDS))
def task(request, tmp_path):
    """An id and the arguments that it needs; `maglev/Rig-v0` gets a rig of a user's own."""
    if request.param != "maglev/Rig-v0":
        return request.param, {}
    (tmp_path / "ball.toml").write_text(BALL)
    return request.param, {"rig": str(tmp_path / "ball.toml")}


def make(task, **more):
    name, arguments = task
    return gym.make(name, **arguments, **more)


@pytest.mark.slow
def test_gymnasium_and_sb3_find_nothing_to_say(task):
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        warnings.filterwarnings("ignore", message=".*where there is no screen")  # of its "human" check
        check_env(make(task, render_mode="rgb_array", **quick(task)).unwrapped)
        sb3_check_env(make(task, **quick(task)).unwrapped)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("task", "mode"),
    [
        *((name, AutoresetMode.NEXT_STEP) for name in sorted(IDS)),  # the others are one code for all rigs
        *((name, mode) for name in (RADIAL, PUMP) for mode in AutoresetMode if mode is not AutoresetMode.NEXT_STEP),
    ],
    indirect=["task"],
)
def test_the_vector_environment_is_the_scalar_one_bit_for_bit(task, mode):
    name, arguments = task
    more = wild(task) | {"terminate_on_touchdown": mode is not AutoresetMode.NEXT_STEP}
    check_vector_env(
        lambda n: gym.make_vec(name, num_envs=n, autoreset_mode=mode, **arguments, **more),
        lambda: make(task, **more),
        steps=4 if name == PUMP else 7,  # past the end of an episode of `wild`, and on
    )


@pytest.mark.slow
def test_twin_rollouts_are_equal(task):
    twins = [make(task, **wild(task)) for _ in range(2)]
    starts = [env.reset(seed=7) for env in twins]
    assert data_equivalence(*starts, exact=True)
    twins[0].action_space.seed(8)
    for _ in range(6 if task[0] == PUMP else 20):
        action = twins[0].action_space.sample()
        one, two = (env.step(action) for env in twins)
        assert data_equivalence(one, two, exact=True)
        if one[2] or one[3]:
            assert data_equivalence(*(env.reset() for env in twins), exact=True)


@pytest.mark.slow
def test_no_element_of_the_observation_is_constant_and_starts_are_random(task):
    name, arguments = task
    envs, steps = (16, 7) if name == PUMP else (32, 12)
    env = gym.make_vec(name, num_envs=envs, **arguments, **wild(task))
    start, _ = env.reset(seed=0)
    names = env.task.layout.names
    varied = {n for n, column in zip(names, start.T, strict=True) if np.ptp(column) > 0}
    assert varied >= set(names) - {"experiments_left", "feasible", *(n for n in names if "margin" in n)}
    env.action_space.seed(0)
    seen = np.concatenate([start, *(env.step(env.action_space.sample())[0] for _ in range(steps))])
    still = [n for n, column in zip(names, seen.T, strict=True) if np.ptp(column) == 0]
    assert not still
    ends_only = [n for n, column in zip(names, np.abs(seen).T, strict=True) if np.ptp(column) == 0]
    assert ends_only in ([], ["feasible"])  # which is yes or no


@pytest.mark.slow
def test_thousands_of_random_steps_stay_in_the_space(task):
    name, arguments = task
    envs, total = {"maglev/HMBFree-v0": (250, 2_000), PUMP: (20, 80)}.get(name, (100, 300))
    env = gym.make_vec(name, num_envs=envs, **arguments, **(wild(task) | {"budget": 3}))
    observations = [env.reset(seed=1)[0]]
    env.action_space.seed(1)
    rewards = []
    for _ in range(total // envs - 1):
        observation, reward, *_ = env.step(env.action_space.sample())
        observations.append(observation)
        rewards.append(reward)
    seen = np.concatenate(observations)
    assert len(seen) == total and np.isfinite(seen).all() and np.abs(seen).max() <= 1
    assert np.isfinite(rewards).all() and np.min(rewards) >= -1 and np.max(rewards) <= 1


def test_pickle_and_spec_give_the_same_environment(task):
    env = make(task, budget=3, **quick(task))
    first = env.reset(seed=3)
    again = gym.make(gym.envs.registration.EnvSpec.from_json(env.spec.to_json()))
    assert data_equivalence(first, again.reset(seed=3), exact=True)
    copied = pickle.loads(pickle.dumps(env.unwrapped))
    action = env.action_space.sample()
    assert data_equivalence(env.step(action), copied.step(action), exact=True)


def test_a_frame_is_an_rgb_array(task):
    env = make(task, render_mode="rgb_array", **quick(task))
    env.reset(seed=0)
    frame = env.render()
    assert frame.dtype == np.uint8 and frame.ndim == 3 and frame.shape[2] == 3 and np.ptp(frame) > 0
    name, arguments = task
    batch = gym.make_vec(name, num_envs=2, render_mode="rgb_array", **quick(task), **arguments)
    batch.reset(seed=0)
    frames = batch.render()
    assert len(frames) == 2 and np.array_equal(frames[0], frame) and not np.array_equal(frames[1], frame)


def _reset_in_child(queue):
    env = gym.make("maglev_env:maglev/HMBFree-v0", protocol="quick")
    queue.put(env.reset(seed=5)[0])


@pytest.mark.slow
def test_a_spawned_process_finds_the_environment_by_module_and_id():
    context = multiprocessing.get_context("spawn")
    queue = context.Queue()
    child = context.Process(target=_reset_in_child, args=(queue,))
    child.start()
    there = queue.get(timeout=120)
    child.join()
    here, _ = gym.make("maglev/HMBFree-v0", protocol="quick").reset(seed=5)
    assert np.array_equal(there, here)


def test_an_import_registers_quietly_and_so_does_another():
    code = "import gymnasium, maglev_env; print(sorted(i for i in gymnasium.registry if i.startswith('maglev/')))"
    found = subprocess.run([sys.executable, "-W", "error", "-c", code], capture_output=True, text=True, check=True)
    assert found.stdout.strip() == str(sorted(IDS))
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        register_envs()
        register_envs()
    assert maglev_env.RigEnv is not None


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ({"rig": "nothing"}, "rig"),
        ({"rig": "pedestal"}, "no controlled magnet"),
        ({"sensor": "eye"}, "sensor"),
        ({"effects": {"gremlins": {"size": 1.0}}}, "gremlins"),
        ({"effects": {"delay": {"time": 1.0}}}, "delay"),
        ({"bounds": {"kp": (5.0, 5.0)}}, "empty range"),
        ({"bounds": {"kp": (9e3, 4e3)}}, "empty range"),
        ({"bounds": {"kp": (-1.0, 4e3)}}, "negative"),
        ({"bounds": {"kx": (1.0, 2.0)}}, "kx"),
        ({"bounds": {"kp": (1.0, 2.0, 3.0)}}, "bounds: kp = .* two numbers"),
        ({"bounds": {"kp": None}}, "bounds: kp = None"),
        ({"tuned": ("kp",), "bounds": {"kd": (1.0, 2.0)}}, "bounds: kd is not tuned"),
        ({"tuned": ("kp", "kp")}, "tuned"),
        ({"tuned": ()}, "tuned"),
        ({"randomization": "wild"}, "randomization"),
        ({"protocol": "slow"}, "protocol"),
        ({"budget": 0}, "budget"),
        ({"budget": 2.5}, "budget"),
        ({"render_mode": "ascii"}, "render_mode"),
    ],
)
def test_a_bad_argument_is_named(arguments, words):
    named = {"rig": "hmb_free"} | arguments
    with pytest.raises(ValueError, match=words):
        maglev_env.RigEnv(**named)
    with pytest.raises(ValueError, match=words):
        maglev_env.RigVectorEnv(2, **named)


@pytest.mark.parametrize("threads", [0, -3, 1.5, True])
def test_threads_are_none_or_a_number_of_them(threads):
    with pytest.raises(ValueError, match="threads = "):
        gym.make_vec("maglev/HMBFree-v0", num_envs=2, threads=threads)


@pytest.mark.parametrize("num_envs", [0, -1, 1.5, True])
def test_a_batch_needs_environments(num_envs):
    with pytest.raises(ValueError, match="num_envs"):
        maglev_env.RigVectorEnv(num_envs)


def test_an_action_that_is_none_is_refused_and_one_outside_is_clipped_with_a_warning():
    env = gym.make("maglev/HMBFree-v0", protocol="quick").unwrapped
    with pytest.raises(gym.error.ResetNeeded):
        env.step(np.zeros(3))
    env.reset(seed=0)
    wrong = ((np.zeros(2), "shape"), (np.full(3, np.nan), "nan"), ("up", "action"), (np.full(3, np.inf), "infinite"))
    for action, words in (*wrong, (np.full(3, 0.1 + 1j), "complex"), ([1j, 0, 0], "complex")):
        with pytest.raises(gym.error.InvalidAction, match=words):
            env.step(action)
    with pytest.warns(UserWarning, match="clipped"):
        _, _, _, _, info = env.step(np.array([5.0, 0.0, 0.0]))
    assert info["kp"] == env.task.rig.bounds["kp"][1]
    batch = maglev_env.RigVectorEnv(2, protocol="quick")
    batch.reset(seed=0)
    with pytest.raises(gym.error.InvalidAction, match="shape"):
        batch.step(np.zeros((2, 2)))
    with pytest.raises(ValueError, match="seed"):
        batch.reset(seed=[1, 2, 3])
    with pytest.raises(ValueError, match="reset_mask"):
        batch.reset(options={"reset_mask": np.zeros(2, bool)})


def test_an_action_that_is_ignored_may_be_anything_and_any_other_is_looked_at():
    env = gym.make_vec("maglev/HMBFree-v0", num_envs=2, protocol="quick", budget=1).unwrapped
    assert env.observation_names == env.task.layout.names
    env.reset(seed=0)
    env.step(np.zeros((2, 3)))  # ends both episodes
    env.step(np.full((2, 3), np.nan))  # which restart
    with pytest.raises(gym.error.InvalidAction, match="nan"):
        env.step(np.full((2, 3), np.nan))


def test_seeds_may_be_an_array():
    one, other = (gym.make_vec("maglev/HMBFree-v0", num_envs=2, protocol="quick") for _ in range(2))
    assert data_equivalence(one.reset(seed=np.array([4, 5])), other.reset(seed=4), exact=True)


def test_a_step_after_the_end_asks_for_a_reset():
    env = gym.make("maglev/HMBFree-v0", protocol="quick", budget=1)
    env.reset(seed=0)
    assert env.step(np.zeros(3, np.float32))[3]
    with pytest.raises(gym.error.ResetNeeded, match="the episode has ended"):
        env.step(np.zeros(3, np.float32))
    env.reset()
    assert env.step(np.zeros(3, np.float32))[3]


def test_an_argument_that_is_unknown_is_refused_with_those_that_are_known(task):
    name, arguments = task
    for make_one in (gym.make, gym.make_vec):
        with pytest.raises(TypeError, match=r"unknown argument 'budgett' .* it has .*tuned, .*budget, .*render_mode"):
            make_one(name, **arguments, budgett=3)


def test_an_effect_of_one_parameter_is_a_number_as_on_the_command_line():
    envs = [
        maglev_env.RigEnv(protocol="quick", effects=effects)
        for effects in ({"delay": 7.5e-5}, {"delay": {"time": 7.5e-5}})
    ]
    assert envs[0].task.effects == envs[1].task.effects
    for effects, words in (
        ({"delay": "long"}, "not a number"),
        (7.5e-5, "give {name"),
        ({"delay": {"x": 1.0}}, "no par"),
    ):
        with pytest.raises(ValueError, match=words):
            maglev_env.RigEnv(effects=effects)
