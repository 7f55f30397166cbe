"""Studies: the same whether interrupted or not, refused where they are another's."""

import json

import numpy as np
import pytest
from filelock import FileLock

from maglev_env.recordings.result_folder import LOCK
from maglev_env.task.task import make_task
from tuning.search.evolution import DifferentialEvolution
from tuning.search.space_filling import Sobol
from tuning.study.study import JOURNAL, run_study

pytestmark = pytest.mark.slow
TASK = make_task(protocol="quick")
EPISODE = TASK.draw(np.random.default_rng(0))


def study(folder, tuner=None, budget=12, batch=4, made_by=None, **rest):
    return run_study(
        folder, TASK, EPISODE, tuner or Sobol(3, 5), made_by or {"method": "sobol", "seed": 5}, budget, batch, **rest
    )


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    return study(tmp_path_factory.mktemp("s") / "whole")


def same(a, b):
    for name in ("points", "score", "observation", "touchdown"):
        np.testing.assert_array_equal(getattr(a.trials, name), getattr(b.trials, name))
    assert [sorted(i) for i in a.trials.info] == [sorted(i) for i in b.trials.info]


def test_scores_are_those_of_the_rig(whole):
    trials = whole.trials
    assert len(trials) == 12 and whole.reused == 0 and not whole.dropped
    assert ((trials.score >= 0) & (trials.score <= 1)).all() and trials.score.max() > 0
    good = trials.info[trials.best]
    assert good["kp"] == pytest.approx(TASK.box.gains(trials.points[trials.best])[0])


def test_an_interrupted_study_goes_on(tmp_path, whole):
    def stop(done, reused):
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        study(tmp_path, progress=stop)
    again = study(tmp_path)
    same(again, whole)
    assert again.reused == 4 and study(tmp_path).reused == 12


def test_more_budget_goes_on_too(tmp_path, whole):
    study(tmp_path, budget=8)
    same(study(tmp_path), whole)


@pytest.mark.parametrize("make", [lambda: Sobol(3, 5), lambda: DifferentialEvolution(3, 1, population=2)])
def test_a_budget_that_ends_within_a_batch_can_grow(tmp_path, make):
    first = study(tmp_path, make(), budget=6)
    more = study(tmp_path, make(), budget=12)
    assert more.reused == 6 and len(more.trials) == 12
    np.testing.assert_array_equal(more.trials.score[:6], first.trials.score)
    same(study(tmp_path, make(), budget=12), more)


def test_a_budget_that_ends_among_experiments_made_together_is_refused_in_true_words(tmp_path):
    study(tmp_path, budget=8)
    with pytest.raises(ValueError, match=r"experiments 5 to 8 were made together.*--budget 8 or 4"):
        study(tmp_path, budget=6)
    assert len(study(tmp_path, budget=4).trials) == 4


def test_a_broken_record_is_made_again(tmp_path, whole):
    study(tmp_path)
    journal = tmp_path / JOURNAL
    text = journal.read_bytes()
    journal.write_bytes(text[:-40])
    again = study(tmp_path)
    same(again, whole)
    assert again.dropped and again.reused == 8
    assert journal.read_bytes() == text


@pytest.mark.parametrize(
    ("record", "line", "words"),
    [
        (1, b'{"points": [[0', "line 2 of 3"),
        (0, {"score": [np.nan] * 4}, "0 .. 1"),
        (0, {"asked": 3}, "asked for"),
        (0, {"points": [[2] * 3] * 4}, "box"),
    ],
)
def test_a_damaged_record_before_the_last_is_named_and_nothing_is_deleted(tmp_path, record, line, words):
    study(tmp_path)
    journal = tmp_path / JOURNAL
    lines = journal.read_bytes().splitlines(keepends=True)
    lines[record] = line if isinstance(line, bytes) else json.dumps(json.loads(lines[record]) | line).encode()
    damaged = b"".join([*lines[:record], lines[record] + b"\n", *lines[record + 1 :]])
    journal.write_bytes(damaged)
    with pytest.raises(ValueError, match=words):
        study(tmp_path)
    assert journal.read_bytes() == damaged


def test_an_unsound_last_record_is_made_again(tmp_path, whole):
    study(tmp_path)
    journal = tmp_path / JOURNAL
    lines = journal.read_text().splitlines()
    lines[-1] = json.dumps(json.loads(lines[-1]) | {"score": [7.0] * 4})
    journal.write_text("\n".join(lines) + "\n")
    again = study(tmp_path)
    same(again, whole)
    assert again.dropped and again.reused == 8


def test_a_search_that_learns_goes_on_as_it_would_have(tmp_path):
    def search():
        return DifferentialEvolution(3, 1, population=2)

    spec = {"method": "de"}
    one = study(tmp_path / "a", search(), 18, 3, spec)
    study(tmp_path / "b", search(), 9, 3, spec)
    same(study(tmp_path / "b", search(), 18, 3, spec), one)


def test_what_belongs_to_another_study_is_refused(tmp_path):
    study(tmp_path, budget=4)
    with pytest.raises(ValueError, match="another seed"):
        study(tmp_path, made_by={"method": "sobol", "seed": 6})
    with pytest.raises(ValueError, match="another batch"):
        study(tmp_path, batch=2)
    with pytest.raises(ValueError, match="asks for other gains"):
        study(tmp_path, Sobol(3, 6))
    spec = json.loads((tmp_path / "study.json").read_text())
    (tmp_path / "study.json").write_text(json.dumps({**spec, "version": "0.0.1"}))
    with pytest.raises(ValueError, match="another version"):
        study(tmp_path)
    (tmp_path / "study.json").write_text("[1]")
    with pytest.raises(ValueError, match="not the description of a study"):
        study(tmp_path)


def test_two_processes_do_not_share_a_study(tmp_path):
    with FileLock(tmp_path / LOCK), pytest.raises(BlockingIOError, match="another process"):
        study(tmp_path)
    with pytest.raises(ValueError, match="at least one"):
        study(tmp_path, budget=0)
