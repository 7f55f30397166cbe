"""Requests that nobody can have meant end in a sentence with the figure, before any work and without a trace."""

import os

import pytest
from command_line import maglev

from maglev_lanes.price import check_bytes, check_experiments, check_length, duration


@pytest.mark.parametrize(
    ("command", "words"),
    [
        ("sweep --kp 1:2:1000000 --kd 1:2:1000000", r"1e+12 experiments of 1.2e+05 samples take about 2.5e+02 years"),
        ("sweep --sobol 100000000000000000000", "1e+20 experiments"),
        ("sweep --scheduler local:9999", "up to 256"),
        ("tune --budget 1000000000", "1e+09 experiments take 1.5e+03 GB"),
        ("compare de --rigs 1000000000", "experiments take"),
        ("train --rigs 100000000000", "1e+11 experiments"),
        ("simulate --periods 1000000", "1000001 periods of 20000 samples are 2e+10; the limit is 40000000"),
        ("simulate --excite force=1:9:2@0.4 --fundamental 1e-9", "a period has 2e+13 samples"),
        ("simulate --periods 1500 --sample-rate 80000", "would hold"),
        ("runup --speeds 0:1:1e-320", "inf speeds"),
    ],
)
def test_what_costs_too_much_is_refused_with_its_price(command, words, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert words in maglev(*command.split(), code=2)
    assert not list(tmp_path.iterdir())


def test_prices_are_those_of_the_limits():
    check_experiments(1_000_000, 3.8e7, "sweep")
    check_length(4e6, 10, "rig")
    check_bytes(1 << 30, "recording")
    for call in (
        lambda: check_experiments(1_000_001, 0, "sweep"),
        lambda: check_experiments(1_000_000, 4e7, "sweep"),
        lambda: check_length(4e6, 11, "rig"),
        lambda: check_length(5e6, 1, "rig"),
        lambda: check_bytes((1 << 30) + 1, "recording"),
    ):
        with pytest.raises(ValueError, match="the limit is"):
            call()
    assert [duration(s) for s in (0.5, 90, 7200, 86400 * 30, 1e9)] == [
        "0.5 seconds", "1.5 minutes", "2 hours", "30 days", "32 years",
    ]  # fmt: skip


@pytest.mark.parametrize(
    "command", ["sweep --rig it.toml", "runup --rotor it.toml", "check it.toml", "tune --campaign it.toml"]
)
def test_a_pipe_is_no_toml_file(command, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    os.mkfifo("it.toml")
    assert "it.toml: not a regular file" in maglev(*command.split(), code=2)


def test_a_pipe_is_no_policy(tmp_path):
    os.mkfifo(tmp_path / "p.npz")
    assert "not a regular file" in maglev("tune", "--method", "learned", "--policy", tmp_path / "p.npz", code=2)
