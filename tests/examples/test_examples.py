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
