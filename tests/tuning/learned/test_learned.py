"""Policies: what they see, how they are stored, how they are trained, and as tuners."""

import json
import pickle
import zipfile
from dataclasses import replace

import numpy as np
import pytest

from maglev_env.loop.effect import effect
from maglev_env.loop.gains import of_axis
from maglev_env.rig.rig_file import load_rig
from maglev_env.task.episodes import Episode
from maglev_env.task.task import make_task
from tuning.comparison.rigs import held_out
from tuning.learned import policy as policy_module
from tuning.learned import tuner as tuner_module
from tuning.learned.encounters import acquainted
from tuning.learned.familiar import SHARE, Familiar, familiar
from tuning.learned.policy import HistoryPolicy, load_policy, save_policy, shape_for, stack
from tuning.learned.training import Plan, train
from tuning.learned.tuner import SHIPPED, LearnedTuner, shipped_policy
from tuning.learned.worlds import World
from tuning.lockstep import side_by_side
from tuning.methods import make_tuner
from tuning.search.corrected.tuner import ModelCorrected
from tuning.study.study import experiments

TASK = make_task(protocol="quick", randomization="wide", draw_target=True)
SHAPE = shape_for(TASK, 4, 16)


def test_the_newest_observation_comes_first_and_empty_places_say_so():
    seen = np.arange(12.0).reshape(1, 4, 3)
    found = stack(seen, 6).reshape(6, 4)
    np.testing.assert_array_equal(found[0], [9, 10, 11, 1])
    np.testing.assert_array_equal(found[3], [0, 1, 2, 1])
    assert not found[4:].any()
    np.testing.assert_array_equal(stack(seen, 2).reshape(2, 4)[:, :3], seen[0, :1:-1])


def test_a_checkpoint_comes_back_whole(tmp_path):
    made, path = HistoryPolicy(SHAPE), tmp_path / "p.npz"
    save_policy(path, made, {"seed": 3, "command": "maglev train"})
    found, by = load_policy(path)
    seen = np.random.default_rng(0).uniform(-1, 1, (5, 3, len(SHAPE.names)))
    np.testing.assert_array_equal(found.act(seen), made.act(seen))
    assert by == {"seed": 3, "command": "maglev train"} and found.shape == SHAPE


class Evil:
    def __reduce__(self):
        return (exec, ("raise SystemExit('executed')",))


UNSOUND = {
    "infinite weight": {"net.0.bias": np.full(16, np.nan, np.float32)},
    "mean of another size": {"familiar_mean": np.zeros(3)},
    "no inverse": {"familiar_inverse": np.zeros(len(SHAPE.names))},
    "no limit": {"familiar_limit": np.array(np.nan)},
    "text": {"familiar_mean": np.full(len(SHAPE.names), "a")},
}


@pytest.mark.parametrize("kind", UNSOUND)
def test_unsound_numbers_are_refused(tmp_path, kind):
    path, policy, n = tmp_path / "p.npz", HistoryPolicy(SHAPE), len(SHAPE.names)
    policy.familiar = Familiar(np.zeros(n), np.eye(n), np.array(1.0))
    save_policy(path, policy, {})
    load_policy(path)
    np.savez(path, **{**np.load(path), **UNSOUND[kind]})
    with pytest.raises(ValueError, match="not a policy of this workbench"):
        load_policy(path)


def test_a_policy_with_too_short_a_history_is_refused(tmp_path):
    save_policy(tmp_path / "p.npz", HistoryPolicy(replace(SHAPE, history=1)), {})
    with pytest.raises(ValueError, match="history"):
        load_policy(tmp_path / "p.npz")


def test_policies_that_act_or_give_way_differently_have_other_digests():
    policy, n = HistoryPolicy(SHAPE), len(SHAPE.names)
    found = {policy.digest}
    for limit in (1.0, 2.0):
        policy.familiar = Familiar(np.zeros(n), np.eye(n), np.array(limit))
        found.add(policy.digest)
    other = HistoryPolicy(replace(SHAPE, ends=tuple((low, 2 * high) for low, high in SHAPE.ends)))
    other.load_state_dict(policy.state_dict())
    other.familiar = policy.familiar
    assert len(found | {other.digest}) == 4


@pytest.mark.parametrize("kind", ["pickle", "object", "zip", "text", "schema", "weights", "large"])
def test_hostile_and_foreign_files_are_refused(tmp_path, kind, monkeypatch):
    path = tmp_path / "p.npz"
    save_policy(path, HistoryPolicy(SHAPE), {})
    stored = dict(np.load(path))
    if kind == "pickle":
        path.write_bytes(pickle.dumps(Evil()))
    elif kind == "object":
        np.savez(path, **{**stored, "net.0.bias": np.array([Evil()], dtype=object)})
    elif kind == "zip":
        with zipfile.ZipFile(path, "w") as archive:
            archive.writestr("data.pkl", pickle.dumps(Evil()))
    elif kind == "text":
        path.write_text("policy")
    elif kind == "schema":
        head = json.dumps({"schema": "maglev-policy/9", "shape": {}, "made_by": {}}).encode()
        np.savez(path, **{**stored, "head": np.frombuffer(head, np.uint8)})
    elif kind == "weights":
        np.savez(path, **{**stored, "net.0.bias": np.zeros(3, np.float32)})
    else:
        monkeypatch.setattr(policy_module, "MOST_BYTES", 1000)
    with pytest.raises(ValueError, match="not a policy of this workbench"):
        load_policy(path)


def test_a_policy_for_other_rigs_is_refused(tmp_path, monkeypatch):
    for what, other in (
        ("gains", make_task(protocol="quick", tuned=("kp", "kd"))),
        ("observations", make_task(protocol="full")),
    ):
        with pytest.raises(ValueError, match=f"other {what}.*maglev train"):
            LearnedTuner(other, other.draw(np.random.default_rng(0)), HistoryPolicy(SHAPE), 0)
        monkeypatch.setattr(tuner_module, "SHIPPED", tmp_path)
        save_policy(tmp_path / "mine.npz", HistoryPolicy(SHAPE), {})
        with pytest.raises(ValueError, match=r"\(mine\) serve other rigs"):
            shipped_policy(other)
    with pytest.raises(ValueError, match=r"\(mine\) serve other rigs"):  # the same names, and bounds of its own
        shipped_policy(make_task("hmb_radial", protocol="quick"))
    assert shipped_policy(TASK).shape == SHAPE


@pytest.mark.slow
@pytest.mark.parametrize("protocol", ["quick", "full"])
def test_the_shipped_policies_tune_rigs_that_they_have_not_seen(protocol):
    path = SHIPPED / f"hmb_free-{protocol}.npz"
    policy, made_by = load_policy(path)
    assert made_by["command"].startswith("maglev train --rig hmb_free --by imitation") and path.stat().st_size < 500_000
    task = make_task(protocol=protocol, randomization="wide")
    assert shipped_policy(task).digest == policy.digest
    _, lanes, seeds = held_out(task, 12, 1, 99)
    tuners = [LearnedTuner(task, e, policy, s) for e, s in zip(lanes, seeds, strict=True)]
    first, third = np.array([t.score for t in side_by_side(task, lanes, tuners, 3)])[:, [0, 2]].T
    assert np.median(third) > 0.95 > 0.5 > np.median(first)


def test_every_round_of_training_needs_a_rig():
    with pytest.raises(ValueError, match="rigs = 5; give at least one for each of the 6 rounds"):
        Plan(rigs=5)


PLAN = Plan(rigs=20, rounds=2, search=30, epochs=30, history=4, width=32)
WORLD = World(load_rig("hmb_free"), budget=4)


@pytest.mark.slow
def test_training_learns_and_goes_on_after_a_kill(tmp_path):
    def killed(text, rigs):
        if text.startswith("round 2"):
            raise KeyboardInterrupt

    whole, log = train(WORLD.draw, PLAN, 1)
    with pytest.raises(KeyboardInterrupt):
        train(WORLD.draw, PLAN, 1, tmp_path, killed)
    again, _ = train(WORLD.draw, PLAN, 1, tmp_path)
    seen = np.random.default_rng(0).uniform(-1, 1, (5, 3, len(SHAPE.names)))
    np.testing.assert_array_equal(again.act(seen), whole.act(seen))
    assert len(log) == 2 and log[1]["second"] > log[0]["second"]  # at random in the first round
    np.testing.assert_array_equal(again.familiar.inverse, whole.familiar.inverse)
    assert acquainted(WORLD.draw, whole, PLAN.rigs, 1).limit == whole.familiar.limit
    with pytest.raises(ValueError, match="history = 5; the tasks have 4"):
        train(WORLD.draw, replace(PLAN, history=5), 1)
    (tmp_path / "round-1-001.npz").write_bytes(b"PK")
    with pytest.raises(ValueError, match="damaged"):
        train(WORLD.draw, PLAN, 1, tmp_path)


@pytest.mark.slow
def test_a_learned_tuner_begins_at_the_safe_start_and_sees_what_it_saw_in_training():
    """A task that leaves the target out, with a budget of its own, gives the policy the same inputs."""
    episode = TASK.draw(np.random.default_rng(0))
    plain = make_task(protocol="quick", randomization="wide", budget=300)
    trained = make_task(protocol="quick", randomization="wide", draw_target=True, budget=SHAPE.history)
    policy = HistoryPolicy(SHAPE)
    tuner = LearnedTuner(plain, episode, policy, 0)
    points, seen = tuner.ask(1), []
    np.testing.assert_array_equal(points[0], episode.start)
    for t in range(SHAPE.history - 1):
        tuner.tell(experiments(plain, [episode], points, t + 1))
        seen.append(experiments(trained, [episode], points, t + 1).observation[0])
        points = tuner.ask(1)
        np.testing.assert_array_equal(points, policy.act(np.array([seen])))
    several = tuner.ask(3)
    assert several.shape == (3, 3) and (abs(several) <= 1).all() and not np.array_equal(several[0], several[1])
    assert abs(tuner.ask(1) - points).max() == 0
    assert tuner.note is None
    model = ModelCorrected(plain, episode, 0)
    model.tell(tuner._told)
    last = experiments(plain, [episode], points, SHAPE.history)
    for one in (tuner, model):
        one.tell(last)
    assert tuner.note == "the policy was trained for 4 experiments; the model-corrected tuner goes on"
    np.testing.assert_array_equal(tuner.ask(2), model.ask(2))


@pytest.mark.slow
def test_a_policy_out_of_its_depth_gives_way_and_says_so():
    policy = shipped_policy(TASK)
    assert policy.familiar is not None
    notes = {}
    for name, effects in (("plain", {}), ("strange", effect("hysteresis", 0.5))):
        task = make_task(protocol="quick", effects=effects)
        episode = Episode(task.rig, task.target, task.box.point(of_axis(task.rig.gains, 0)), 3)
        tuner = make_tuner("learned", task, episode, 0, 4)
        (trials,) = side_by_side(task, [episode], [tuner], 4)
        notes[name] = tuner.note
    assert notes["plain"] is None
    assert "out of its depth: experiment 2 lies" in notes["strange"] and trials.score.max() > 0.95


@pytest.mark.slow
@pytest.mark.parametrize(("protocol", "rigs"), [("quick", 40), ("full", 20)])
def test_a_shipped_policy_is_in_its_depth_on_rigs_like_those_of_its_training(protocol, rigs, budget=10):
    """At every experiment of its history: on no more rigs than if every experiment had its own chance to be one of the
    few that do not count as familiar. All had switched at the tenth."""
    task = World(load_rig("hmb_free"), protocol).task()
    _, lanes, seeds = held_out(task, rigs, 1, 4711, affected=True)
    tuners = [LearnedTuner(task, e, shipped_policy(task), s) for e, s in zip(lanes, seeds, strict=True)]
    side_by_side(task, lanes, tuners, budget)
    assert sum("out of its depth" in t.note for t in tuners) <= (1 - SHARE) * (budget - 1) * rigs


@pytest.mark.slow
def test_start_gains_are_never_judged_and_the_note_names_the_experiment_that_is_far():
    policy = HistoryPolicy(SHAPE)
    size = len(SHAPE.names)
    policy.familiar = Familiar(np.zeros(size), np.eye(size), np.array(0.0))  # nothing is familiar
    episode = TASK.draw(np.random.default_rng(0))
    tuner = LearnedTuner(TASK, episode, policy, 0)
    tuner.tell(experiments(TASK, [episode] * 3, tuner.ask(3), 1))
    assert tuner.note is None
    own = experiments(TASK, [episode] * 3, tuner.ask(3), 4)
    tuner.tell(replace(own, observation=own.observation * np.array([[0.5], [1.0], [0.1]], np.float32)))
    assert "experiment 5 lies" in tuner.note


@pytest.mark.slow
def test_what_is_familiar_to_any_policy_comes_from_all_of_its_experiments_but_the_start():
    world = World(load_rig("hmb_free"), budget=SHAPE.history)
    policy = HistoryPolicy(SHAPE)
    one, two = (acquainted(world.draw, policy, 60, 3) for _ in range(2))
    np.testing.assert_array_equal(one.inverse, two.inverse)
    left = SHAPE.names.index("experiments_left")
    assert one.mean[left] == pytest.approx(np.mean([0.0, -0.5, -1.0]), abs=0.05)  # of 4: the 2nd, 3rd and 4th
    assert policy.familiar is None
    with pytest.raises(ValueError, match="another number of experiments"):
        acquainted(World(load_rig("hmb_free"), budget=9).draw, policy, 2, 0)


def test_a_rig_without_a_policy_is_tuned_by_the_model_and_the_reason_is_said():
    task = make_task("eframe", protocol="quick")
    episode = task.draw(np.random.default_rng(0))
    tuner = make_tuner("learned", task, episode, 0, 4)
    assert isinstance(tuner, ModelCorrected)
    assert "serve other rigs" in tuner.note and "the model-corrected tuner works instead" in tuner.note


def test_what_is_familiar_is_kept_in_the_checkpoint_and_counts_most_of_what_was_seen(tmp_path):
    rng = np.random.default_rng(0)
    seen = rng.normal(0.2, 0.1, (200, 4, len(SHAPE.names)))
    made = HistoryPolicy(SHAPE)
    made.familiar = familiar(seen)
    save_policy(tmp_path / "p.npz", made, {})
    found = load_policy(tmp_path / "p.npz")[0].familiar
    rows = seen[:, 1:].reshape(-1, len(SHAPE.names))
    assert np.mean(found.distance(rows) <= found.limit) == pytest.approx(SHARE, abs=0.005)
    assert found.distance(rows[:1] + 1.0)[0] > found.limit
