"""What the environments are made of: gains from actions, episodes, protocols, observations, the SB3 adapter."""

from dataclasses import replace

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.vector import AutoresetMode
from hypothesis import given, settings
from hypothesis import strategies as st

import maglev_env  # noqa: F401  registers the environments
from maglev_env.envs.sb3 import SB3VecEnv
from maglev_env.evaluation.evaluate import evaluate
from maglev_env.evaluation.target import score_target
from maglev_env.experiment import protocol_experiment
from maglev_env.kernel.simulate import simulate_records
from maglev_env.loop.magnets.kinds import force_law
from maglev_env.rig.drawn import scaled_rig
from maglev_env.rig.excitation import lines_at
from maglev_env.rig.rig import Rig, axis_rig
from maglev_env.rig.rig_file import load_rig, rig_from_toml
from maglev_env.task.episodes import WIDE, draw_episode, wide_factors
from maglev_env.task.gain_box import gain_box
from maglev_env.task.protocol import env_protocol
from maglev_env.task.task import make_task


@settings(deadline=None)
@given(st.lists(st.floats(-1, 1), min_size=5, max_size=5))
def test_gains_and_actions_are_each_others_inverse(action):
    box = gain_box(load_rig("hmb_free"), ("kp", "ki", "kd", "td", "ti"))
    gains = box.gains(action)
    assert (gains >= box.low * (1 - 1e-12)).all() and (gains <= box.high * (1 + 1e-12)).all()
    np.testing.assert_allclose(box.actions(gains), action, atol=1e-9)


def test_bounds_may_be_an_array():
    found = gain_box(load_rig("hmb_free"), ["kp"], {"kp": np.array([4000.0, 16000.0])})
    assert (found.low[0], found.high[0]) == (4000.0, 16000.0)


def test_a_fivefold_range_is_logarithmic_and_a_shorter_one_straight():
    box = gain_box(load_rig("hmb_free"), ("kp", "ki"), {"kp": (2e3, 8e3), "ki": (10.0, 1000.0)})
    assert box.log.tolist() == [False, True]
    np.testing.assert_allclose(box.gains(np.zeros(2)), [5e3, 100.0])
    np.testing.assert_allclose(box.gains(np.array([[-1.0, -1.0], [1.0, 1.0]])), [[2e3, 10.0], [8e3, 1000.0]])
    from_zero = gain_box(load_rig("hmb_radial"))  # its bounds start at zero gains
    np.testing.assert_allclose(from_zero.gains(np.full(3, -1.0)), 0.0)


def test_episodes_vary_what_the_data_sheet_leaves_open_and_nothing_else():
    rig = load_rig("hmb_free")
    target, box = score_target(rig), gain_box(rig)

    def episodes(randomization, draw_target=False):
        return [
            draw_episode(rig, target, box, randomization, draw_target, np.random.default_rng(i)) for i in range(2000)
        ]

    assert {e.rig for e in [e for e in episodes("none")][:50] if e.rig != rig} == set()
    for name, sigma in rig.tolerance.items():
        drawn = np.log([getattr(e.rig, name) / getattr(rig, name) for e in episodes("tolerances")])
        assert drawn.mean() == pytest.approx(0, abs=4 * sigma / np.sqrt(2000))
        assert drawn.std() == pytest.approx(sigma, rel=0.07)
    wide = episodes("wide", draw_target=True)
    for name in rig.tolerance:
        factors = np.array([getattr(e.rig, name) / getattr(rig, name) for e in wide])
        assert factors.min() == pytest.approx(WIDE[0], abs=0.01) and factors.max() == pytest.approx(WIDE[1], abs=0.01)
    assert all(e.rig.gap == rig.gap and e.rig.protocol == rig.protocol for e in wide[:50])
    ratios = np.array([[e.target.stiffness / target.stiffness, e.target.damping / target.damping] for e in wide])
    assert ratios.min() > 0.8 and ratios.max() < 1.5 and abs(np.corrcoef(np.log(ratios).T)[0, 1]) < 0.08
    starts = np.array([e.start for e in wide])
    assert np.abs(starts).max() <= 1 and (starts.std(axis=0) > 0.25).all()
    assert len({e.seed for e in wide}) == 2000


def test_a_rig_states_its_own_randomization():
    rig = load_rig("hmb_free")
    assert set(wide_factors(rig)) == set(rig.tolerance)
    own = replace(rig, randomization={"mass": (0.5, 2.0)})
    drawn = [
        draw_episode(own, score_target(own), gain_box(own), "wide", False, np.random.default_rng(i)) for i in range(200)
    ]
    masses = np.array([e.rig.mass for e in drawn]) / rig.mass
    assert masses.min() < 0.55 and masses.max() > 1.8 and {e.rig.actuator_gain for e in drawn} == {5.7}
    text = 'schema = "maglev-rig/1"\nname = "a"\nmagnet = "none"\n[parameters]\nmass = 1.0\n[randomization]\n'
    assert rig_from_toml(text + "mass = [0.9, 1.2]", "a").randomization == {"mass": (0.9, 1.2)}
    for line, word in (("mass = [0.0, 1.2]", "factors above 0"), ("weight = [1, 2]", "weight"), ("mass = 2", "mass")):
        with pytest.raises(ValueError, match=word):
            rig_from_toml(text + line, "a")


@pytest.mark.parametrize("name", ["hmb_free", "hmb_radial", "eframe"])
def test_the_quick_protocol_measures_the_same_in_an_eighth_of_the_time(name):
    rig = load_rig(name)
    full, quick = (replace(rig, protocol=env_protocol(rig, p)) for p in ("full", "quick"))

    def seconds(r):
        return (r.protocol.periods + r.protocol.transient_periods) / r.protocol.excitations[0].fundamental

    assert seconds(quick) == pytest.approx(seconds(full) / 7.5)
    for place in ("force", "current"):
        ends = [
            lines_at(r.protocol.excitations, place)[-1] * r.protocol.excitations[0].fundamental for r in (full, quick)
        ]
        assert ends[1] == pytest.approx(ends[0], rel=0.06)
    bands = np.array([rig.target.band, [100.0, 185.0]])
    found = [evaluate([protocol_experiment(r, seed=i) for i in range(12)], bands=bands) for r in (full, quick)]
    for quantity in ("stiffness", "damping"):
        means = [getattr(e, quantity).mean() for e in found]
        assert means[1] == pytest.approx(means[0], rel=0.08)  # what the fewer lines weigh varies in a band
        errors = [getattr(e, f"band_{quantity}_se").mean(axis=0)[1] for e in found]
        assert 2 < errors[1] / errors[0] < 6


@pytest.mark.parametrize("name", ["hmb_axial", "pedestal"])
def test_the_quick_protocol_of_a_rig_that_nothing_controls_excites_its_force_alone(name):
    rig = load_rig(name)
    quick = env_protocol(rig, "quick")
    assert [e.at for e in quick.excitations] == ["force"]
    ends = [lines_at(p.excitations, "force")[-1] * p.excitations[0].fundamental for p in (rig.protocol, quick)]
    assert ends[1] == pytest.approx(ends[0], rel=0.06)
    assert np.isfinite(simulate_records([protocol_experiment(replace(rig, protocol=quick))])[0]).all()
    with pytest.raises(ValueError, match=f"{name}: nothing is excited at the current.*estimate a recording"):
        evaluate([protocol_experiment(rig)])
    with pytest.raises(ValueError, match="excitation at the force"):
        env_protocol(replace(rig, protocol=None), "quick")


def test_the_quick_protocol_of_a_slow_loop_has_whole_periods():
    # Five times 1 Hz leaves too few lines in the band; three times does not divide the control rate of 20 kHz.
    rig = load_rig("hmb_free")
    rig = replace(rig, target=replace(rig.target, band=(14.0, 22.0)))
    quick = env_protocol(rig, "quick")
    fundamental = quick.excitations[0].fundamental
    assert fundamental > rig.protocol.excitations[0].fundamental
    assert quick.excitations[0].samples_per_period(rig.control_rate) * fundamental == rig.control_rate


def test_observations_say_what_the_info_says():
    task = make_task("hmb_free", protocol="quick", draw_target=True)
    episode = task.draw(np.random.default_rng(0))
    found, seen = task.measure([episode], episode.start[None], [0], 1)
    see = dict(zip(task.layout.names, seen[0].astype(float), strict=True))
    assert seen.dtype == np.float32 and len(see) == seen.shape[1]
    assert see["stiffness_over_target"] == pytest.approx(
        np.log(found.stiffness[0] / episode.target.stiffness) / np.log(5), abs=1e-6
    )
    assert see["phase_margin"] == pytest.approx(2 * found.margins["phase_margin"][0] / 90 - 1, abs=1e-6)
    assert see["peak_sensitivity"] == pytest.approx(
        1 - 2 * np.log(found.margins["peak_sensitivity"][0]) / np.log(20), abs=1e-6
    )
    assert see["target_damping"] == pytest.approx(
        np.log(episode.target.damping / task.target.damping) / np.log(5), abs=1e-6
    )
    assert see["kp"] == pytest.approx(episode.start[0], abs=1e-6) and see["experiments_left"] == 1.0


def test_a_touchdown_is_worst_in_reward_and_plain_in_the_observation():
    env = gym.make("maglev/HMBFree-v0", protocol="quick", terminate_on_touchdown=True)
    env.reset(seed=0)
    observation, reward, terminated, truncated, info = env.step(np.array([-1.0, 1.0, -1.0]))
    see = dict(zip(env.unwrapped.observation_names, observation, strict=True))
    assert reward == -1.0 and terminated and not truncated and info["touchdown_time"] > 0 and info["score"] == 0
    assert "stiffness" not in info and see["peak_sensitivity"] == -1 and see["displacement"] == 1
    kept = gym.make("maglev/HMBFree-v0", protocol="quick", budget=1)
    kept.reset(seed=0)
    assert kept.step(np.array([-1.0, 1.0, -1.0]))[1:4] == (-1.0, False, True)


def test_effects_change_what_is_seen_and_the_same_seed_does_not_change_with_the_batch():
    plain = gym.make("maglev/HMBFree-v0", protocol="quick").reset(seed=4)[1]
    late = gym.make("maglev/HMBFree-v0", protocol="quick", effects={"delay": {"time": 5e-5}}).reset(seed=4)[1]
    assert late["phase_margin"] < plain["phase_margin"] - 3 and late["kp"] == plain["kp"]
    for envs in (1, 17):
        batch = gym.make_vec("maglev/HMBFree-v0", num_envs=envs, protocol="quick", threads=envs % 2 + 1)
        assert batch.reset(seed=4)[1]["score"][0] == plain["score"]


def test_sb3_sees_ends_of_episodes_with_their_last_observation():
    with pytest.raises(ValueError, match="SAME_STEP"):
        SB3VecEnv(gym.make_vec("maglev/HMBFree-v0", num_envs=2, protocol="quick"))
    arguments = {"protocol": "quick", "budget": 2}
    env = SB3VecEnv(gym.make_vec("maglev/HMBFree-v0", num_envs=3, autoreset_mode=AutoresetMode.SAME_STEP, **arguments))
    env.seed(11)
    first = env.reset()
    single = gym.make("maglev/HMBFree-v0", **arguments)
    observation, _ = single.reset(seed=12)
    assert np.array_equal(first[1], observation)
    action = np.full((3, 3), 0.1, np.float32)
    for last in (False, True):
        seen, reward, done, infos = env.step(action)
        observation, own_reward, _, _, info = single.step(action[1])
        assert done.tolist() == [last] * 3 and reward[1] == np.float32(own_reward) and infos[1]["kp"] == info["kp"]
    assert np.array_equal(infos[1]["terminal_observation"], observation) and infos[1]["TimeLimit.truncated"]
    assert np.array_equal(seen[1], single.reset()[0]) and infos[1]["score"] == info["score"]
    assert env.get_attr("num_envs") == [3, 3, 3] and env.env_is_wrapped(gym.Wrapper) == [False] * 3
    with pytest.raises(AttributeError, match="share"):
        env.set_attr("threads", 1)
    env.close()


def test_two_axes_are_tuned_together_and_judged_by_the_worse():
    task = make_task("hmb_radial", protocol="quick")
    episode = task.draw(np.random.default_rng(0))
    experiment = task.experiment(episode, task.box.gains(episode.start), 0)
    assert experiment.rig.axes == 2 and experiment.gains.kp == task.box.gains(episode.start)[0]
    assert task.target == score_target(axis_rig(load_rig("hmb_radial"), 0))


def test_a_drawn_ball_is_carried_whatever_it_weighs():
    """The bias of a single magnet that states its geometry too carries one weight; another one had been an error."""
    own = {"mass": 0.0583, "gap": 0.011, "turns": 1200, "pole_area": 1.8878923e-4, "bias_current": 0.9}
    ball = Rig("ball", "electromagnet", clearance=8e-3, control_rate=1000.0, tolerance={"mass": 0.05}, **own)
    drawn = scaled_rig(ball, {"mass": 1.1, "actuator_gain": 0.9})
    assert force_law(drawn).rest_current == pytest.approx(0.9 * np.sqrt(1.1), rel=1e-3)
    assert scaled_rig(ball, {"mass": 1.001}).bias_current == 0.9
    assert len({make_task(ball, randomization="wide").draw(np.random.default_rng(i)).rig.mass for i in range(9)}) == 9
    with pytest.raises(ValueError, match="gap"):
        scaled_rig(ball, {"gap": -1.0})
