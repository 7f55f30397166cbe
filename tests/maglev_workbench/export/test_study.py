"""A study of `maglev tune` read back from a storage of Optuna."""

import json

import optuna
import pytest
from command_line import maglev

QUICK = ("--protocol", "quick")


@pytest.fixture(scope="module")
def tuned(tmp_path_factory):
    """A study of three experiments, the last of which is far too stiff."""
    folder = tmp_path_factory.mktemp("studies") / "my-study"
    maglev("tune", "--method", "sobol", "--budget", 3, *QUICK, "--out", folder)
    return folder


def read(path, name="my-study"):
    return optuna.load_study(study_name=name, storage=f"sqlite:///{path}")


@pytest.mark.slow
def test_optuna_reads_every_experiment_as_it_was(tuned, tmp_path):
    file = tmp_path / "all.db"
    optuna.create_study(storage=f"sqlite:///{file}", study_name="someone else's")
    assert "my-study: 3 experiments" in maglev("export", tuned, "--out", file)
    maglev("export", tuned, "--out", file)  # again: replaced, not doubled
    data, study = json.loads((tuned / "tune.json").read_text()), read(file)
    assert sorted(optuna.get_all_study_names(f"sqlite:///{file}")) == ["my-study", "someone else's"]
    assert [t.value for t in study.trials] == [one["score"] for one in data["experiments"]]
    assert study.best_value == max(one["score"] for one in data["experiments"])
    for trial, one in zip(study.trials, data["experiments"], strict=True):
        assert trial.params == pytest.approx(one["gains"]) and trial.user_attrs["touchdown"] is one["touchdown"]
        for name, range_ in trial.distributions.items():
            assert range_.low <= one["gains"][name] * (1 + 1e-12) and range_.log == data["box"][name][2]
        assert trial.user_attrs.items() >= one["identified"].items()
    held = next(one for one in data["experiments"] if one["score"] > 0)["identified"]
    assert held["stiffness_low"] < held["stiffness"] < held["stiffness_high"]  # N/m
    assert 1e3 < held["stiffness"] < 1e6


def test_what_cannot_be_written_is_said(tmp_path):
    assert "there is no tune.json" in maglev("export", "hmb_free", "--out", tmp_path / "s.db", code=2)
    folder = tmp_path / "study"
    folder.mkdir()
    (folder / "tune.json").write_text('{"schema": "maglev-tune/1"}')
    assert "tune again" in maglev("export", folder, "--out", tmp_path / "s.db", code=2)
    study = {"schema": "maglev-tune/1", "version": "0", "made_by": {"method": "de"}, "box": {"kp": [1.0, 2.0, True]}}
    trial = {"gains": {"kp": 2.0000000001}, "score": 0.5, "touchdown": False, "identified": {}}
    (folder / "tune.json").write_text(json.dumps(study | {"experiments": [trial]}))
    (tmp_path / "text.db").write_text("no storage" * 99)
    assert "no storage of Optuna" in maglev("export", folder, "--out", tmp_path / "text.db", code=2)
    assert (tmp_path / "text.db").read_text() == "no storage" * 99
    optuna.create_study(storage=f"sqlite:///{tmp_path / 's.db'}", study_name="study")
    assert "of another origin" in maglev("export", folder, "--out", tmp_path / "s.db", code=2)
    assert read(tmp_path / "s.db", "study").trials == []
