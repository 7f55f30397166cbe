"""Folders of results belong to one process at a time, and to the run that began them."""

import json
import signal
import subprocess
import sys

import pytest

from maglev_env.recordings.result_folder import HOLDER, claim, is_empty, locked

HOLD = """
import sys, time
from pathlib import Path
from maglev_env.recordings.result_folder import locked
with locked(Path(sys.argv[1])):
    print("held", flush=True)
    time.sleep(60)
"""


def test_the_second_process_hears_who_holds_the_folder_until_that_one_is_killed(tmp_path):
    with subprocess.Popen([sys.executable, "-c", HOLD, tmp_path], stdout=subprocess.PIPE, text=True) as first:
        assert first.stdout.readline() == "held\n"
        said = json.loads((tmp_path / HOLDER).read_text())
        with pytest.raises(BlockingIOError) as refused, locked(tmp_path):
            pass
        for part in (str(tmp_path), f"process {first.pid} on {said['host']}, since {said['since']}", said["command"]):
            assert part in str(refused.value)
        assert first.poll() is None
        first.send_signal(signal.SIGKILL)
    assert (tmp_path / HOLDER).exists()  # what a killed process leaves
    with locked(tmp_path):
        assert json.loads((tmp_path / HOLDER).read_text())["process"] != first.pid
    assert not (tmp_path / HOLDER).exists() and is_empty(tmp_path)
    with locked(tmp_path):
        (tmp_path / HOLDER).unlink()
        with pytest.raises(BlockingIOError, match="another process works there; wait"), locked(tmp_path):
            pass


def test_a_folder_of_another_version_is_refused_in_words(tmp_path):
    path = tmp_path / "study.json"
    claim(path, {"schema": "a/1", "version": "0.1.0+abc", "seed": 1}, "study")
    with pytest.raises(
        ValueError, match=r"holds a study of another version of maglev \('0\.1\.0\+abc', not '0\.2\.0'\)"
    ):
        claim(path, {"schema": "a/1", "version": "0.2.0", "seed": 2}, "study")


def test_what_differs_within_a_description_is_named(tmp_path):
    """Two goals on one rig had been said to be those of another rig."""
    path = tmp_path / "study.json"
    rig = {"name": "a", "mass": 1.0, "target": {"band": [1, 2], "goal": "match"}, "effects": {}}
    claim(path, {"seed": 1, "rig": rig}, "study")
    other = {**rig, "target": {**rig["target"], "goal": "phase_margin >= 30"}}
    with pytest.raises(ValueError, match=r"of another goal \('match', not 'phase_margin >= 30'\); choose another"):
        claim(path, {"seed": 1, "rig": other}, "study")
    with pytest.raises(ValueError, match=r"another rig, whose mass is 1.0, not 2.0; choose"):
        claim(path, {"seed": 1, "rig": {**rig, "mass": 2.0}}, "study")
    with pytest.raises(ValueError, match=r"another rig, whose effects differ; choose"):
        claim(path, {"seed": 1, "rig": {**rig, "effects": {"delay": {"delay": 1e-5}}}}, "study")
    with pytest.raises(ValueError, match=r"another rig \(\{.*\}, not 'b'\); choose"):
        claim(path, {"seed": 1, "rig": "b"}, "study")
