"""The examples run, do what they say, and stay short."""

import sys
from pathlib import Path

import numpy as np
import pytest

EXAMPLES = Path(__file__).parents[2] / "examples"


@pytest.fixture(autouse=True)
def on_the_path(monkeypatch):
    monkeypatch.syspath_prepend(str(EXAMPLES))


def test_they_are_short():
    files = [*sorted(EXAMPLES.glob("env_*.py")), EXAMPLES / "optuna_study.py"]
    assert len(files) >= 5
    assert {f.name: n for f in files if (n := len(f.read_text().splitlines())) > 40} == {}


def test_the_sweep_finds_good_gains():
    from env_gain_sweep import sweep

    best, gains = sweep(steps=1)
    assert best > 0.5 and set(gains) == {"kp", "ki", "kd"} and sweep(steps=1) == (best, gains)


@pytest.mark.slow
def test_the_tuner_in_ten_lines_tunes():
    from env_hand_written_tuner import tune

    scores = tune(seed=0)
    assert len(scores) == 10 and scores[-1] > 0.95 and scores[-1] > scores[0]


@pytest.mark.slow
def test_the_optuna_study_finds_better_gains_than_the_preset():
    from optuna_study import run

    study = run(trials=64)
    assert len(study.trials) == 64 and study.best_value > study.trials[0].value + 0.02
    assert study.best_trial.user_attrs["peak_sensitivity"] > 1


@pytest.mark.slow
def test_ppo_trains_and_is_measured(monkeypatch):
    import env_ppo_evaluation
    from env_sb3_ppo import train

    model = train(experiments=64, num_envs=8, rollout=64)
    assert model.num_timesteps == 64
    monkeypatch.setattr(env_ppo_evaluation, "RIGS", 16)
    mean, half = env_ppo_evaluation.mean_return(lambda seen: model.predict(seen, deterministic=True)[0])
    assert -10 <= mean <= 10 and 0 < half < 5
    assert np.isfinite([mean, half]).all() and "env_sb3_ppo" in sys.modules


def test_three_users_get_what_they_came_for(tmp_path, capsys):
    """The scripts of a bearing engineer, a control engineer and an RL researcher, of about 20 lines each."""
    from bearing_engineer import study as bearing
    from control_engineer import study as loop
    from rl_researcher import episode

    table = bearing(str(tmp_path / "stiffness.png"))
    assert (np.diff(table["stiffness"]) > 0).all() and (tmp_path / "stiffness.png").stat().st_size > 10_000
    assert (table["stiffness_low"] < table["stiffness"]).all() and "best number 1" in capsys.readouterr().out
    modelled, measured, step = loop()
    assert measured == pytest.approx(modelled, abs=1.0) and np.isfinite(step.outputs).all()
    best = episode(rigs=4, steps=2)
    assert best.shape == (4,) and np.isfinite(best).all()
    for name in ("bearing_engineer", "control_engineer", "rl_researcher"):
        assert len((EXAMPLES / f"{name}.py").read_text().splitlines()) <= 26
