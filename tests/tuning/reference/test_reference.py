"""References: what they reach is measured as that of gains, and no search knows better than the limits of all."""

import numpy as np
import pytest

from maglev_env.design.goals import goal_of
from maglev_env.evaluation.goal_score import met
from maglev_env.linear.loop import loop_response
from maglev_env.loop.gains import of_axis
from maglev_env.task.episodes import Episode
from maglev_env.task.task import make_task
from tuning.reference import reference as searched
from tuning.reference.kinds import kind_of, scales_of
from tuning.reference.reference import held_by, limits_of, loops, reference, without_gains
from tuning.study.study import experiments

GOAL = "peak_sensitivity <= 3, phase_margin >= 30, noise_current <= 0.03, best compliance near 2e-5"


def task_of(rig="hmb_free", goal=GOAL, **rest):
    task = make_task(rig, goal=goal, protocol="quick", **rest)
    return task, Episode(task.rig, task.target, task.box.point(of_axis(task.rig.gains, 0)), 0)


@pytest.fixture
def short(monkeypatch):
    monkeypatch.setattr(searched, "ROUNDS", 3)
    monkeypatch.setattr(searched, "ROUND", 12)


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["lqg", "h-infinity"])
def test_a_reference_meets_a_goal_and_is_measured_as_gains_are(short, kind):
    if kind == "h-infinity":
        pytest.importorskip("slycot")
    task, episode = task_of(effects={"delay": 50e-6})
    found = reference(task, episode, kind, 3)
    again = reference(task, episode, kind, 3)
    assert found.controllers == again.controllers and found.verdict.score == again.verdict.score
    values = {n: np.array([found.verdict.required[f"required_{n}"]]) for n in ("peak_sensitivity", "phase_margin")}
    values |= {n: np.array([found.verdict.required[f"required_{n}"]]) for n in ("noise_current", "compliance")}
    assert met(goal_of(task.rig), values)[0] and found.verdict.score > 0.7
    whole, _ = loops(task, episode)
    frequency = np.geomspace(5, 2000, 2000)
    loop = loop_response(type(whole)(**{**vars_of(whole), "gains": found.controllers}), frequency)
    assert values["peak_sensitivity"][0] == pytest.approx(np.abs(loop.sensitivity).max(), rel=0.05)
    assert values["compliance"][0] == pytest.approx(np.abs(loop.receptance[frequency < 250]).max(), rel=0.1)
    for name, limit in limits_of(task, episode).items():
        value = found.verdict.loop.get(name, found.verdict.required.get(f"required_{name}", np.nan))
        assert not (value < limit if name in ("peak_sensitivity", "noise_current") else value > limit)


def vars_of(e):
    return {n: getattr(e, n) for n in ("rig", "gains", "excitations", "effects", "sensor")}


@pytest.mark.slow
def test_an_x_y_rig_has_a_controller_for_each_axis(short):
    task, episode = task_of("hmb_radial")
    found = reference(task, episode, "lqg", 0)
    assert isinstance(found.controllers, tuple) and len(found.controllers) == 2 and found.verdict.score > 0.3


@pytest.mark.slow
def test_the_preset_held_as_a_reference_is_the_preset():
    task, episode = task_of()
    own = experiments(task, [episode], episode.start[None], [0])
    bare = held_by(without_gains(task), [episode], [task.box.applied(task.rig.gains, task.box.gains(episode.start))])
    assert bare.score[0] == own.score[0] and bare.info[0]["peak_sensitivity"] == own.info[0]["peak_sensitivity"]


def test_the_scales_are_those_of_the_rigs_own_loop():
    task, episode = task_of()
    whole, (view,) = loops(task, episode)
    scales = scales_of(view)
    loop = loop_response(whole, np.array([scales.crossover * 0.99, scales.crossover * 1.03]))
    assert abs(loop.loop_gain[0]) > 1 > abs(loop.loop_gain[1])
    assert 3e-5 < scales.compliance < 1e-4 and 3e4 < scales.effort < 2e5


def test_an_unknown_kind_and_a_missing_package_are_refused(monkeypatch):
    with pytest.raises(ValueError, match="use one of lqg, h-infinity"):
        kind_of("mpc")
    monkeypatch.setattr("tuning.reference.kinds.find_spec", lambda name: None)
    assert kind_of("lqg").words == "LQG"
    with pytest.raises(ModuleNotFoundError, match="slycot"):
        kind_of("h-infinity")
