"""The spinning rotor's environment against its specification."""

import re
from dataclasses import replace

import gymnasium as gym
import numpy as np
import pytest
from matplotlib.figure import Figure

import maglev_env
from maglev_env.envs.pump import PumpRotorEnv
from maglev_env.loop.gains import Gains
from maglev_env.rotor.evaluation import evaluate_rotors
from maglev_env.rotor.parts import Unbalance
from maglev_env.rotor.rotor import load_rotor
from maglev_env.task.pump import LADDER, make_rotor_task
from maglev_env.task.pump_episodes import controlled, gains_at

PUMP = load_rotor("pump")
SHORT = {"speeds": (0.0, 14_000.0)}


def tried(env: PumpRotorEnv, action: np.ndarray) -> tuple[dict[str, float], float, bool, dict]:
    """Observation by name, reward, whether it ended there, info."""
    observation, reward, terminated, _, info = env.step(action)
    return dict(zip(env.observation_names, observation, strict=True)), reward, terminated, info


def test_the_default_is_six_gains_and_every_element_is_named_once():
    env = gym.make("maglev/PumpRotor-v0").unwrapped
    names = env.observation_names
    assert env.action_space.shape == (6,) and env.observation_space.shape == (len(names),)
    assert len(set(names)) == len(names) == 5 * 4 + len(LADDER) + 2 + 6 + 1
    assert names[0] == "stiffness_translation_0_rpm" and names[-7:-1] == env.task.box.names
    assert env.task.layout.speeds == tuple(range(0, 14_001, 1000))


def test_no_names_of_gains_are_the_default():
    assert make_rotor_task(tuned=None).box.names == make_rotor_task().box.names


def test_elements_are_scaled_as_specified():
    env = PumpRotorEnv(speeds=(0.0, 8000.0, 14_000.0), budget=4)
    env.reset(seed=1)
    action = env.task.preset + np.array([0.05, 0.0, 0.1, -0.05, 0.1, -0.1])
    seen, reward, _, info = tried(env, action)
    target = env.task.layout.target
    for j, speed in enumerate((0, 14_000)):
        for m, mode in enumerate(("translation", "tilt")):
            at = f"{mode}_{speed}_rpm"
            for name in ("stiffness", "damping"):
                unit = getattr(target, name)[j, m]
                assert seen[f"{name}_{at}"] == pytest.approx(np.log(info[f"{name}_{at}"] / unit) / np.log(5), abs=1e-6)
                decade = np.log10(info[f"{name}_se_{at}"] / unit)
                assert seen[f"{name}_se_{at}"] == pytest.approx((decade + 1.5) / 2.5, abs=1e-6)
            peak = info[f"peak_sensitivity_{at}"]
            assert seen[f"peak_sensitivity_{at}"] == pytest.approx(1 - 2 * np.log(peak) / np.log(20), abs=1e-6)
    for j, speed in enumerate((0, 8000, 14_000)):
        share = info["peak"][j].max() / PUMP.axis.clearance
        assert seen[f"displacement_{speed}_rpm"] == pytest.approx((np.log10(share) + 1.5) / 1.5, abs=1e-6)
    assert seen["current"] == pytest.approx((np.log10(info["current_rms"] / 0.5) + 1) / 2, abs=1e-6)
    assert seen["feasible"] == 1 and seen["experiments_left"] == pytest.approx(0.5)
    assert [seen[name] for name in env.task.box.names] == pytest.approx(action, abs=1e-6)
    assert reward == info["score"] > 0.3


def test_the_experiment_is_that_of_the_gains_and_the_info_is_si_without_nan():
    env = PumpRotorEnv(**SHORT)
    env.reset(seed=1)
    action = env.task.preset + 0.1
    _, reward, _, info = tried(env, action)
    gains = {name: Gains(*(info[f"{gain}_{name}"] for gain in ("kp", "ki", "kd"))) for name in ("translation", "tilt")}
    assert gains["tilt"].kp == pytest.approx(3000.0 * 8.0 ** ((1 + action[3]) / 2))
    found = evaluate_rotors(
        [replace(PUMP, gains=gains)], SHORT["speeds"], seed=(env._episode.seed, 1), target=env.task.layout.target
    )
    assert reward == found.score[0] and np.array_equal(info["peak"], found.run_up.peak[0])
    assert info["stiffness_tilt_14000_rpm"] == found.identification[1].stiffness[0, 1]
    assert info["peak_frequency_translation_0_rpm"] == found.identification[0].peak_frequency[0, 0]
    assert info["displacement_zone"] == "A" and info["term_current"] == found.terms["current"][0]
    assert not {"touchdown_time", "touchdown_speed"} & set(info)
    numbers = [np.asarray(value, float) for value in info.values() if not isinstance(value, str)]
    assert all(np.isfinite(value).all() for value in numbers)
    # What the class says is told, is told.
    said = set(re.findall(r"^    \| ([a-z_0-9]+)", PumpRotorEnv.__doc__.split("## Info")[1].split("## Arg")[0], re.M))
    assert said - {"key"} <= set(info) | {"touchdown_time"}


def test_a_touchdown_costs_one_and_ends_the_episode_if_asked():
    for ends in (False, True):
        env = PumpRotorEnv(**SHORT, terminate_on_touchdown=ends)
        env.reset(seed=0)
        seen, reward, terminated, info = tried(env, [0.0, 0.0, 0.5, 1.0, 1.0, -1.0])  # a tilt that swings up
        assert reward == -1 and info["score"] == 0 and terminated is ends
        assert info["touchdown_speed"] == 0 and not info["feasible"] and "stiffness_tilt_0_rpm" not in info
        assert seen["displacement_0_rpm"] == 1 and seen["peak_sensitivity_tilt_0_rpm"] == -1
        assert seen["stiffness_tilt_0_rpm"] == 0 and seen["stiffness_se_tilt_0_rpm"] == 1 and seen["feasible"] == -1


def test_what_is_known_below_the_speed_of_a_touchdown_stays():
    task = make_rotor_task(PUMP, speeds=(0.0, 8000.0))
    task = replace(task, rotor=replace(PUMP, unbalance=Unbalance(1.8e-5)))
    episode = task.draw(np.random.default_rng(0))
    _, observation = task.measure([episode], task.preset[None], [1], 1)
    seen = dict(zip(task.layout.names, observation[0], strict=True))
    assert seen["displacement_8000_rpm"] == 1 > seen["displacement_0_rpm"]
    assert abs(seen["stiffness_tilt_0_rpm"]) < 0.05 and seen["stiffness_se_tilt_0_rpm"] < 0
    assert seen["stiffness_tilt_8000_rpm"] == 0 and seen["stiffness_se_tilt_8000_rpm"] == 1


def test_an_unstable_loop_that_stays_in_the_air_has_no_reward():
    env = PumpRotorEnv(**SHORT)
    env.reset(seed=0)
    seen, reward, _, info = tried(env, [0.0, 0.0, 0.5, 0.0, 0.0, -1.0])
    assert "touchdown_time" not in info and info["pole_radius"].min() > 1
    assert reward == 0 and seen["feasible"] == -1


def test_common_gains_are_those_of_both_controllers():
    common, both = (PumpRotorEnv(**SHORT, control=control) for control in ("common", "translation_tilt"))
    assert common.action_space.shape == (3,) and common.task.box.names == ("kp", "ki", "kd")
    action = np.array([-0.1, 0.2, 0.1])
    episodes = [env.task.draw(np.random.default_rng(3)) for env in (common, both)]
    episodes = [replace(episode, seed=5) for episode in episodes]
    found = [
        env.task.measure([episode], row[None], [1], 1)[0]
        for env, episode, row in zip((common, both), episodes, (action, np.tile(action, 2)), strict=True)
    ]
    assert found[0].score[0] == found[1].score[0]
    assert np.array_equal(found[0].run_up.peak, found[1].run_up.peak)


def test_planes_with_the_same_gains_are_the_same_loop():
    planes = make_rotor_task(**SHORT, control="planes")
    assert planes.layout.controllers == ("a", "b") and "kp_b" in planes.box.names
    assert "peak_sensitivity_b_14000_rpm" in planes.layout.names and "stiffness_tilt_0_rpm" in planes.layout.names
    modes = make_rotor_task(**SHORT)
    episodes = [replace(t.draw(np.random.default_rng(3)), seed=5) for t in (planes, modes)]
    found = [
        t.measure([episode], t.preset[None], [1], 1)[0] for t, episode in zip((planes, modes), episodes, strict=True)
    ]
    # Alike up to where commands are rounded to the converter's steps.
    np.testing.assert_allclose(found[0].run_up.peak, found[1].run_up.peak, rtol=0.1)
    np.testing.assert_allclose(found[0].pole_radius, found[1].pole_radius, rtol=1e-6)
    uneven = replace(PUMP, gains=PUMP.gains | {"tilt": Gains(7000.0, 2000.0, 5.0)})
    with pytest.raises(ValueError, match=r"gains\.a"):
        controlled(uneven, "planes")
    own = controlled(uneven, "common").gains
    assert list(own) == ["translation", "tilt"] and own["tilt"] == uneven.gains["translation"]
    rows = gains_at(uneven, np.array([1.0, 2.0, 3.0, 4.0]), ("kd", "kp")).gains
    assert (rows["translation"].kd, rows["translation"].kp, rows["tilt"].kd, rows["tilt"].kp) == (1, 2, 3, 4)


def test_tolerances_and_unbalance_are_drawn_as_stated():
    task = make_rotor_task(**SHORT, randomization="tolerances", unbalance=(0.8, 3.0))
    episodes = [task.draw(np.random.default_rng(i)) for i in range(800)]
    static, couple = (
        np.log([getattr(e.rotor.unbalance, n) / getattr(PUMP.unbalance, n) for e in episodes])
        for n in ("static", "couple")
    )
    for drawn in (static, couple):
        assert np.log(0.8) <= drawn.min() < np.log(0.82) and np.log(2.9) < drawn.max() <= np.log(3.0)
        assert drawn.mean() == pytest.approx(np.log(0.8 * 3.0) / 2, abs=5 * np.log(3 / 0.8) / np.sqrt(12 * 800))
    assert abs(np.corrcoef(static, couple)[0, 1]) < 5 / np.sqrt(800)
    for name, sigma in PUMP.axis.tolerance.items():
        logs = np.log([getattr(e.rotor.axis, name) / getattr(PUMP.axis, name) for e in episodes])
        assert logs.std() == pytest.approx(sigma, rel=5 / np.sqrt(2 * 800))
        assert abs(logs.mean()) < 5 * sigma / np.sqrt(800)
    bodies = [e.rotor.body for e in episodes]
    ratio = [b.mass / PUMP.body.mass for b in bodies]
    assert np.std(ratio) == pytest.approx(0.005, rel=0.15)
    assert [b.polar_inertia / PUMP.body.polar_inertia for b in bodies] == pytest.approx(ratio)
    starts = np.array([e.start for e in episodes])
    assert abs(starts - 0.5 * task.preset).max() <= 0.5 and np.ptp(starts, axis=0).min() > 0.9
    plain = make_rotor_task(**SHORT).draw(np.random.default_rng(0))
    assert plain.rotor == controlled(PUMP, "translation_tilt")


def test_a_move_steps_from_the_gains_tried_last():
    env = PumpRotorEnv(**SHORT, move=0.2, tuned=("kd",))
    env.reset(seed=4)
    start = env._history[-1][0]
    env.step(np.array([0.5, -1.0], np.float32))
    assert env._history[-1][0] == pytest.approx(np.clip(start + np.array([0.1, -0.2]), -1, 1))


def test_at_standstill_alone_only_standstill_is_identified():
    task = make_rotor_task(speeds=(0.0,))
    assert len(task.layout.names) == 5 * 2 + 1 + 2 + 6 + 1 and task.layout.id_speeds == (0.0,)
    backwards = make_rotor_task(speeds=(-9000.0, 0.0))
    assert backwards.layout.id_speeds == (-9000.0, 0.0)


@pytest.mark.parametrize("actions", [((0.0, 0.0, 0.5) * 2,), ((0.0, 0.0, 0.2) * 2, (0.0, 0.0, 0.5, 1.0, 1.0, -1.0))])
def test_the_picture_shows_the_last_run_up(actions):
    env = PumpRotorEnv(**SHORT, render_mode="rgb_array")
    env.reset(seed=0)
    for action in actions:
        _, _, _, _, info = env.step(np.array(action, np.float32))
    figure: Figure = env.picture(env.task, env._episode, env._history)
    by_label = {axes.get_label(): axes for axes in figure.axes}
    assert set(by_label) == {"motion", "current", "identified", "tried"}
    line = by_label["motion"].lines[0]
    assert line.get_xdata().tolist() == [0.0, 14.0]
    wall = PUMP.axis.clearance
    assert line.get_ydata() == pytest.approx(np.minimum(info["peak"][:, 0], wall) * 1e6)
    down = "touchdown_speed" in info
    assert ("touchdown at 0 rpm" in by_label["motion"].get_title(loc="left")) is down
    shown = next(entry for entry in by_label["identified"].lines if entry.get_label() == "stiffness").get_ydata()
    assert len(shown) == (0 if down else 4)
    assert len(by_label["tried"].collections[0].get_offsets()) == (2 if down or len(actions) == 1 else 3)
    frame = env.render()
    assert frame.shape == (720, 960, 3) and frame.dtype == np.uint8


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ({"rotor": "nothing"}, "rotor"),
        ({"control": "alone"}, "control"),
        ({"tuned": ()}, "tuned"),
        ({"bounds": {"kp": (2.0, 1.0)}}, "empty range"),
        ({"tuned": ("kp",), "bounds": {"kd": (1.0, 2.0)}}, "bounds: kd is not tuned"),
        ({"randomization": "wide"}, "randomization"),
        ({"rotor": replace(PUMP, axis=replace(PUMP.axis, tolerance={})), "randomization": "tolerances"}, "tolerance"),
        ({"unbalance": (0.0, 1.0)}, "unbalance"),
        ({"unbalance": (2.0, 1.0)}, "unbalance"),
        ({"speeds": ()}, "speeds"),
        ({"speeds": (0.0, np.inf)}, "speeds"),
        ({"speeds": (5.0, 5.0)}, "speeds"),
        ({"speeds": "fast"}, "speeds"),
        ({"speeds": 9000.0}, "speeds"),
        ({"budget": 0}, "budget"),
        ({"move": 3.0}, "move"),
        ({"render_mode": "ascii"}, "render_mode"),
    ],
)
def test_a_bad_argument_is_named(arguments, words):
    with pytest.raises(ValueError, match=words):
        maglev_env.PumpRotorEnv(**arguments)
    with pytest.raises(ValueError, match=words):
        maglev_env.PumpRotorVectorEnv(2, **arguments)
