"""Comparisons: the same rigs for every tuner, regrets that are those of a retest, and folders that go on."""

import numpy as np
import pytest
from filelock import FileLock

from maglev_env.recordings.result_folder import LOCK
from maglev_env.task.task import make_task
from tuning.comparison.compare import SPEC, compare
from tuning.comparison.rigs import held_out
from tuning.comparison.twin import _read
from tuning.methods import make_tuner
from tuning.study.study import experiments

TASK = make_task(protocol="quick", randomization="wide")
RIGS, BUDGETS, SEED = 3, (2, 4), 5


def run(folder, methods=("sobol", "rule"), rigs=RIGS, budgets=BUDGETS, repeats=1, seed=SEED, **rest):
    return compare(TASK, methods, rigs, budgets, repeats, seed, folder, **rest)


@pytest.fixture(autouse=True)
def short_search(monkeypatch):
    monkeypatch.setattr("tuning.comparison.compare.SEARCH", 120)
    monkeypatch.setattr("tuning.search.corrected.tuner.ROUNDS", 2)


def same(a, b, method):
    np.testing.assert_array_equal(a.results[method].score, b.results[method].score)
    np.testing.assert_array_equal(a.results[method].touchdowns, b.results[method].touchdowns)


@pytest.mark.slow
def test_the_model_has_less_regret_and_takes_the_time(tmp_path):
    found = run(tmp_path, ("sobol", "model"), budgets=(2,))
    assert found.checkpoints == (1, 2) and list(found.results) == ["sobol", "model"]
    for method, result in found.results.items():
        assert result.score.shape == result.touchdowns.shape == (RIGS, 1, 2)
        assert (found.regret(method, 2) >= 0).all()
        assert (np.diff(result.seconds) > 0).all() and (result.tuner_seconds < result.seconds).all()
    assert np.median(found.regret("model", 2)) < 0.05 and (found.regret("sobol", 2) > 0.05).all()
    own = {m: r.tuner_seconds[-1] / r.seconds[-1] for m, r in found.results.items()}
    assert own["sobol"] < 0.5 < own["model"]


@pytest.mark.slow
def test_scores_are_those_of_a_retest_of_each_rig_alone(tmp_path):
    found = run(tmp_path, ("sobol",), repeats=2).results["sobol"]
    rigs, lanes, seeds = held_out(TASK, RIGS, 2, SEED)
    assert len(rigs) == RIGS and lanes[2].rig is lanes[3].rig is rigs[1].rig and lanes[2].seed != lanes[3].seed
    for lane in (2, 3):  # the second rig
        episode = lanes[lane]
        points = make_tuner("sobol", TASK, episode, seeds[lane], 4).ask(4)
        trials = experiments(TASK, [episode] * 4, points, 1)
        assert found.touchdowns[1, lane - 2, -1] == trials.touchdown.sum()
        again = experiments(TASK, [episode] * 64, np.tile(points[trials.best], (64, 1)), 1000).score
        spread = again.std() * np.sqrt(1 / 8 + 1 / 64)
        assert abs(found.score[1, lane - 2, -1] - again.mean()) < 4 * spread


@pytest.mark.slow
def test_an_interrupted_comparison_goes_on(tmp_path):
    def stop(name, count):
        if name == "rule":
            raise KeyboardInterrupt

    whole = run(tmp_path / "whole")
    with pytest.raises(KeyboardInterrupt):
        run(tmp_path / "a", progress=stop)
    again = run(tmp_path / "a")
    assert again.results["sobol"].reused and not again.results["rule"].reused
    for method in ("sobol", "rule"):
        same(again, whole, method)
    np.testing.assert_array_equal(again.best, whole.best)
    more = run(tmp_path / "a", ("de", "sobol", "sobol"))
    assert list(more.results) == ["de", "sobol"] and more.results["sobol"].reused and not more.results["de"].reused
    same(more, whole, "sobol")


@pytest.mark.slow
def test_what_belongs_to_another_comparison_is_refused(tmp_path):
    one = {"methods": ("sobol",), "rigs": 1}
    run(tmp_path, **one)
    for changed, words in (({"seed": 6}, r"another seed \(5, not 6"), ({"budgets": (2,)}, "another budgets")):
        with pytest.raises(ValueError, match=words):
            run(tmp_path, **one, **changed)
    (tmp_path / "sobol.npz").write_bytes(b"PK\x03\x04 no")
    with pytest.raises(ValueError, match=r"sobol\.npz is damaged"):
        run(tmp_path, **one)
    (tmp_path / SPEC).write_text("{")
    with pytest.raises(ValueError, match="not the description"):
        run(tmp_path, **one)
    with FileLock(tmp_path / LOCK), pytest.raises(BlockingIOError, match="another process"):
        run(tmp_path, **one)


def test_a_folder_of_something_else_is_refused(tmp_path):
    (tmp_path / "notes.txt").write_text("mine")
    with pytest.raises(ValueError, match="not empty and holds no comparison"):
        run(tmp_path)


def test_rigs_come_from_the_seed_and_are_held_out():
    few, many = (held_out(TASK, n, 1, SEED)[0] for n in (2, 4))
    masses = [e.rig.mass for e in many]
    assert [e.rig.mass for e in few] == masses[:2] and len(set(masses)) == 4
    drawn = [TASK.draw(np.random.default_rng(s)).rig.mass for s in range(10)]
    assert not set(drawn) & set(masses)
    assert held_out(TASK, 1, 1, SEED + 1)[0][0].rig.mass not in masses


@pytest.mark.parametrize(
    ("changed", "words"),
    [
        ({"methods": ("annealing",)}, "'annealing' is unknown; use one of grid"),
        ({"methods": ()}, "no method"),
        ({"rigs": 0}, "rigs = 0"),
        ({"repeats": 0}, "repeats = 0"),
        ({"budgets": (4, 2)}, "budgets = 4, 2: give increasing"),
        ({"budgets": (2, 2)}, "give increasing"),
        ({"budgets": (0, 2)}, "give increasing"),
        ({"budgets": ()}, "give increasing"),
    ],
)
def test_bad_input_is_refused_before_any_work(tmp_path, changed, words):
    with pytest.raises(ValueError, match=words):
        run(tmp_path / "new", **changed)
    assert not (tmp_path / "new").exists()


@pytest.mark.parametrize("text", ["", "[]", '{"by": []}', '{"by": {"twin": 3}}', "{"])
def test_a_damaged_case_of_a_comparison_on_twins_is_made_again(tmp_path, text):
    (tmp_path / "c.json").write_text(text)
    assert _read(tmp_path / "c.json") is None
