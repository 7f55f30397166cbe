"""Environments whose rig is read by its own coils keep every contract, and say what that costs."""

import warnings
from dataclasses import replace

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env
from gymnasium.vector import AutoresetMode
from stable_baselines3.common.env_checker import check_env as sb3_check_env

import maglev_env
from maglev_env.envs.testing import check_vector_env
from maglev_env.evaluation.score import WEIGHTS
from maglev_env.rig.rig_file import load_rig
from maglev_env.rig.self_sensor import rig_sensors

SENSED = {"sensor": "self_sensing", "protocol": "quick"}
TOLD = {"gap_error_rms", "gap_error_bias", "gap_error_worst", "added_phase", "margin_lost"}
# Rigs whose coils are not those that the estimator was made for.
UNLIKE = replace(
    load_rig("hmb_free"),
    randomization={"gap": (0.97, 1.03), "turns": (0.97, 1.03), "supply_voltage": (0.9, 0.95), "mass": (0.95, 1.05)},
)


@pytest.fixture(scope="module")
def env():
    return gym.make("maglev/HMBFree-v0", budget=3, **SENSED)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["maglev/HMBFree-v0", "maglev/HMBRadial-v0", "maglev/EFrame-v0"])
def test_gymnasium_and_sb3_find_nothing_to_say(name):
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        warnings.filterwarnings("ignore", message=".*where there is no screen")  # of its "human" check
        check_env(gym.make(name, render_mode="rgb_array", **SENSED).unwrapped)
        sb3_check_env(gym.make(name, **SENSED).unwrapped)


@pytest.mark.slow
@pytest.mark.parametrize("mode", [AutoresetMode.NEXT_STEP, AutoresetMode.SAME_STEP])
def test_the_vector_environment_is_the_scalar_one_bit_for_bit(mode):
    more = SENSED | {"rig": UNLIKE, "budget": 3, "randomization": "wide", "draw_target": True}
    more |= {"terminate_on_touchdown": mode is AutoresetMode.SAME_STEP}
    check_vector_env(
        lambda n: maglev_env.RigVectorEnv(n, autoreset_mode=mode, **more),
        lambda: maglev_env.RigEnv(**more),
        steps=7,
    )


def test_the_info_says_what_self_sensing_costs_and_the_probe_none_of_it(env):
    _, info = env.reset(seed=1)
    assert info.keys() >= TOLD and info["gap_error_worst"] > info["gap_error_rms"] > abs(info["gap_error_bias"])
    _, reward, _, _, info = env.step(np.zeros(3))
    assert info.keys() >= TOLD and reward == info["score"]
    _, on_probe = gym.make("maglev/HMBFree-v0", protocol="quick").reset(seed=1)
    assert not TOLD & on_probe.keys() and on_probe["term_gap_sensing"] == 1


def test_the_reward_counts_how_well_the_gap_is_sensed(env):
    env.reset(seed=2)
    preset = env.unwrapped.task.box.actions([getattr(env.unwrapped.task.rig.gains, n) for n in ("kp", "ki", "kd")])
    _, reward, _, _, info = env.step(preset.astype(np.float32))
    term = 1 / (1 + (info["gap_error_rms"] / (0.02 * UNLIKE.gap)) ** 2)
    assert info["term_gap_sensing"] == pytest.approx(term, rel=1e-12) and term < 0.99
    others = np.prod([info[f"term_{name}"] ** weight for name, weight in WEIGHTS.items() if name != "gap_sensing"])
    assert reward == pytest.approx(others * term ** WEIGHTS["gap_sensing"], rel=1e-12) and reward > 0.5


def test_a_drawn_rig_is_sensed_by_the_estimator_of_the_nominal_one():
    env = maglev_env.RigVectorEnv(4, rig=UNLIKE, randomization="wide", budget=2, **SENSED)
    env.reset(seed=3)
    (nominal,) = rig_sensors(UNLIKE)
    task = env.task
    for episode in env._episodes:
        rig = episode.rig
        (sensor,) = task.experiment(episode, task.box.gains(episode.start), 0).sensor
        assert sensor.estimator == nominal.estimator and sensor.gap == nominal.gap == UNLIKE.gap
        assert (sensor.coil.turns, sensor.supply.voltage) == (rig.turns, rig.supply_voltage)
        assert rig.turns != UNLIKE.turns and rig.gap != UNLIKE.gap and rig.supply_voltage < 23
    preset = task.box.actions([UNLIKE.gains.kp, UNLIKE.gains.ki, UNLIKE.gains.kd])
    _, _, _, _, info = env.step(np.tile(preset, (4, 1)).astype(np.float32))
    # estimate / gap = V N_nominal^2 / (V_nominal N^2); the loop holds the reading near zero: what leans is the rotor.
    for episode, bias in zip(env._episodes, info["gap_error_bias"], strict=True):
        rig = episode.rig
        share = rig.supply_voltage / UNLIKE.supply_voltage * (UNLIKE.turns / rig.turns) ** 2
        leaning = rig.gap - UNLIKE.gap / share
        assert bias == pytest.approx(-leaning, abs=0.1 * abs(leaning) + 1e-6) and abs(leaning) > 5e-6
    assert info["_gap_error_bias"].all()


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ({"sensor": "eye"}, "sensor = 'eye'; use one of probe, self_sensing"),
        ({"effects": {"sensor_lag": {"time_constant": 2e-5}}}, "sensor_lag is the probe's"),
        ({"rig": replace(UNLIKE, coil_resistance=200.0)}, "sample faster"),
    ],
)
def test_what_cannot_be_sensed_is_refused_when_the_environment_is_made(arguments, words):
    named = SENSED | {"rig": "hmb_free"} | arguments
    with pytest.raises(ValueError, match=words):
        maglev_env.RigEnv(**named)
    with pytest.raises(ValueError, match=words):
        maglev_env.RigVectorEnv(2, **named)
