"""The commands as a user runs them: results, JSON, exit codes and messages."""

import errno
import json
import os
import resource
import signal
import subprocess
import sys
import time
from importlib.metadata import version
from pathlib import Path

import pytest
from command_line import maglev

from maglev_workbench.cli import COMMANDS

RIG = """
schema = "maglev-rig/1"
name = "bench"
magnet = "none"
[parameters]
mass = 0.5
support_stiffness = 2e4
support_damping = 6.0
[noise]
displacement = 1e-6
force = 1e-3
[protocol]
periods = 5
transient_periods = 2
band_width = 60.0
band_overlap = 30.0
[[protocol.excitation]]
kind = "sphs"
at = "force"
fundamental = 5.0
amplitude = 1.0
harmonics = [1, 40]
"""


@pytest.fixture
def campaign(tmp_path):
    (tmp_path / "bench.toml").write_text(RIG)
    maglev("simulate", "--rig", tmp_path / "bench.toml", "--out", tmp_path / "rec", "--seed", 5)
    return tmp_path / "rec"


def test_help_answers_at_once_and_lists_every_command():
    before = resource.getrusage(resource.RUSAGE_CHILDREN).ru_utime
    result = subprocess.run(
        [sys.executable, "-m", "maglev_workbench.cli", "--help"], capture_output=True, text=True, check=True
    )
    used = resource.getrusage(resource.RUSAGE_CHILDREN).ru_utime - before
    assert used < 1.0  # seconds of processor; a quarter on an idle machine, and heavy imports would take several
    heavy = (
        "import sys, maglev_workbench.cli; print({'numba', 'xarray', 'torch', 'plotly', 'scipy'} & sys.modules.keys())"
    )
    assert subprocess.run([sys.executable, "-c", heavy], capture_output=True, text=True).stdout.strip() == "set()"
    assert all(name in result.stdout for name in COMMANDS)


def test_a_wrong_call_is_answered_before_the_long_imports(tmp_path):
    """The numerical libraries take a second or more to import, which is long for a misspelt name."""
    (tmp_path / "bad.toml").write_text("name = [")
    (tmp_path / "text.csv").write_text("nothing\n")
    calls = (
        "sweep --rig no", "sweep --kp 1:2", "simulate --effect no=1", "tune --rig bad.toml", "tune --method no",
        "tune --campaign no", "compare no", "compare --twin no", "train --rig no", "train --rig bad.toml",
        "estimate no", "estimate text.csv", "check no", "check text.csv", "diagnose no", "new no", "runup --rotor no",
        "explore no", "bench --compare no", "reproduce no", "coverage no", "blind answer no", "blind open no",
        "blind score no",
        "selfsense estimate no", "selfsense calibrate no", *(
            f"selfsense {name} --rig no"
            for name in ("design", "record", "levitate", "demodulate", "noise", "rate-limit", "robustness", "rivals")
        ),
    )  # fmt: skip
    program = f"""
import sys
from typer.testing import CliRunner
from maglev_workbench.cli import app
heavy = {{"numba", "scipy.signal", "scipy.stats", "scipy.optimize", "torch", "optuna", "matplotlib", "plotly"}}
for call in {calls!r}:
    code, loaded = CliRunner().invoke(app, call.split()).exit_code, heavy & sys.modules.keys()
    assert code == 2 and not loaded, (call, code, loaded)
"""
    made = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, cwd=tmp_path)
    assert made.returncode == 0, made.stderr


def test_matrices_are_multiplied_on_one_thread_unless_the_user_says_otherwise():
    """Small ones take longer on several, and the last bits of a result would depend on their number."""
    program = """
import os, sys
from typer.testing import CliRunner
from maglev_workbench.cli import app
assert "numpy" not in sys.modules
CliRunner().invoke(app, ["check", "nothing"])
print(os.environ["OPENBLAS_NUM_THREADS"])
"""
    for said in ({}, {"OPENBLAS_NUM_THREADS": "3"}):
        environment = {name: value for name, value in os.environ.items() if name != "OPENBLAS_NUM_THREADS"} | said
        made = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, env=environment)
        assert made.stdout.split() == [said.get("OPENBLAS_NUM_THREADS", "1")], made.stderr


def test_the_version_and_another_way_to_call_it():
    said = subprocess.run(
        [sys.executable, "-m", "maglev_workbench", "--version"], capture_output=True, text=True, check=True
    )
    assert said.stdout.split() == ["maglev-workbench", version("maglev-workbench")]


def test_simulate_check_and_estimate_agree_with_the_rig(campaign, tmp_path):
    out = tmp_path / "e.json"
    text = maglev("estimate", campaign, "--json", out, "--method", "both")
    assert "natural frequency" in text and 2e5 < (campaign / "estimate.html").stat().st_size <= 1.6e6
    data = json.loads(out.read_text())
    assert data["schema"] == "maglev-estimate/1"
    record = data["recordings"][0]
    keys = {"f_lo", "f_hi", "stiffness", "stiffness_se", "stiffness_ci", "damping", "damping_se", "damping_ci"}
    assert keys | {"r2_adjusted", "method", "ls_biased", "informative"} <= record["bands"][0].keys()
    assert record["natural_frequency"] == pytest.approx(31.83, abs=0.04) and record["stability"] is None
    band = next(b for b in record["bands"] if b["method"] == "ml" and b["f_lo"] < 32 < b["f_hi"])
    assert band["stiffness_ci"][0] <= 2.0003e4 and band["stiffness_ci"][1] >= 1.9997e4
    checked = tmp_path / "c.json"
    maglev("check", campaign, "--json", checked)
    assert json.loads(checked.read_text())["recordings"][0]["can"]["stiffness and damping"] == "yes"


def test_an_excitation_of_ones_own_replaces_the_protocols(tmp_path):
    out = tmp_path / "own"
    options = ["--excite", "force=1:39:2@0.4", "--excite", "current=2:80:6@0.1", "--fundamental", 10, "--periods", 4]
    maglev("simulate", "--out", out, *options)
    text = maglev("estimate", out, "--band-width", 100, "--band-overlap", 50)
    assert "peak sensitivity" in text and "injection" in text


def test_one_file_can_be_looked_at_without_a_campaign(campaign, tmp_path):
    file = campaign / "run1.npz"
    common = ["--rate", 20000, "--fundamental", 5, "--lines", "1:40", "--band-width", 60]
    text = maglev("estimate", file, *common, "--estimate-mass", "--json", tmp_path / "o.json")
    assert "mass" in text
    found = json.loads((tmp_path / "o.json").read_text())["recordings"][0]
    # Without a word on the force between samples it is taken as continuous, and the output says so.
    assert found["mass"] == pytest.approx(0.5, rel=5e-3) and "intersample is not stated" in text
    maglev(
        "estimate",
        file,
        *common,
        "--mass",
        0.5,
        "--intersample",
        "zoh",
        "--json",
        tmp_path / "o.json",
        "--method",
        "ml",
    )
    maglev("estimate", campaign, "--band-width", 60, "--json", tmp_path / "c.json", "--method", "ml")
    one, two = (json.loads((tmp_path / f"{n}.json").read_text())["recordings"][0]["bands"] for n in "oc")
    assert [b["stiffness"] for b in one][:3] == pytest.approx([b["stiffness"] for b in two][:3], rel=1e-3)
    assert "sample rate" in maglev("estimate", file, "--mass", 0.5, "--lines", "1:40", code=2)
    assert "guess: sample_rate: 20000 Hz" in maglev("estimate", file, "--mass", 0.5)
    assert "force" in maglev("estimate", file, *common, "--mass", 0.5, "--force", "F", code=2)


def test_sweep_writes_table_page_dataset_and_json(tmp_path):
    out, js = tmp_path / "s", tmp_path / "s.json"
    text = maglev("sweep", "--kp", "7000:9000:2", "--kd", "5:6:2", "--out", out, "--json", js)
    assert "4 gain sets, 4 feasible" in text and (out / "sweep.nc").exists()
    assert 2e5 < (out / "sweep.html").stat().st_size <= 1.6e6
    data = json.loads(js.read_text())
    assert data["schema"] == "maglev-sweep/1" and data["n"] == data["stable"] == data["feasible"] == 4
    assert {"gains", "score", "terms"} <= data["best"].keys() and data["experiments_per_second"] > 0
    again = maglev("sweep", "--kp", "7000:9000:2", "--kd", "5:6:2", "--out", out)
    assert "4 reused" in again


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["sweep", "--rig", "missing.toml"], "missing.toml"),
        (["sweep", "--kp", "1:2"], "lo:hi:n"),
        (["sweep", "--rig", "pedestal", "--kp", "1:2:2"], "nothing to sweep"),
        (["simulate", "--protocol", "party", "--out", "x"], "party"),
        (["simulate", "--excite", "force=1:250", "--out", "x"], "place=first:last:step@peak"),
        (["simulate", "--excite", "force=1:9@1", "--excite", "current=9:20@1", "--out", "x"], "line 9"),
        (["simulate", "--excite", "force=5:1@1", "--out", "x"], "no harmonic"),
        (["simulate", "--excite", "force=1:9@1", "--protocol", "diagnosis", "--out", "x"], "plans its own lines"),
        (["simulate", "--excite", "force=1:9@1", "--fundamental", "0", "--out", "x"], "fundamental = 0.0 Hz must be"),
        (["check", "here.npz", "--rate", "inf"], "sample rate of inf Hz"),
        (["new", "here.npz", "--rate", "inf"], "--rate inf"),
        (["new", "here.npz", "--mass", "inf"], "--mass inf"),
        (["simulate", "--kp", "500", "--ki", "0", "--kd", "0.1", "--out", "x"], "touched down"),
        (["simulate", "--rig", "pedestal", "--kp", "5", "--out", "x"], "no magnets"),
        (["estimate", "nowhere"], "does not exist"),
        (["estimate", "here.npz", "--band-width", "-4"], "--band-width"),
        (["sweep", "--rig", "pedestal"], "no controlled magnet"),
        (["explore", "pedestal"], "no control loop to explore"),
        (["simulate", "--rig", "pedestal", "--excite", "current=1:9@1", "--out", "x"], "only a force can excite"),
        (["estimate", "here.npz", "--method", "magic"], "magic"),
    ],
)
def test_bad_input_ends_with_one_message_and_code_2(arguments, words, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    Path("here.npz").write_bytes(b"")
    text = maglev(*arguments, code=2)
    assert words in text and text.startswith("maglev:") and "Traceback" not in text
    assert not Path("x").exists() or not any(Path("x").iterdir())


def test_a_full_disk_is_named(campaign, tmp_path):
    if not os.access("/dev/full", os.W_OK):
        pytest.skip("no /dev/full here")
    assert "maglev:" in maglev("estimate", campaign, "--json", "/dev/full/e.json", code=2)


def test_a_device_is_not_replaced_by_a_file(campaign):
    assert "is not a regular file" in maglev("estimate", campaign, "--json", os.devnull, code=2)
    assert not Path(os.devnull).is_file()


def test_a_full_disk_in_the_middle_of_the_work_says_how_to_go_on(tmp_path, monkeypatch):
    def full(*_):
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr("tuning.sweep_run.save_arrays", full)
    said = maglev("sweep", "--kp", "8000", "--out", tmp_path / "s", code=2)
    assert "No space left on device; nothing that was finished is lost: make room" in said
    monkeypatch.undo()
    assert "1 gain set is" in maglev("sweep", "--kp", "8000", "--out", tmp_path / "s")


@pytest.mark.slow
def test_ctrl_c_stops_a_sweep_with_130_and_the_next_run_goes_on(tmp_path):
    command = [sys.executable, "-m", "maglev_workbench.cli", "sweep", "--sobol", "768", "--out", str(tmp_path / "s")]
    process = subprocess.Popen(
        command,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL),  # ignored where tests run in the background
    )
    chunks = tmp_path / "s" / "chunks"
    for _ in range(6000):
        if chunks.exists() and any(chunks.glob("*.npz")):
            break
        time.sleep(0.01)
    process.send_signal(signal.SIGINT)
    out, err = process.communicate(timeout=60)
    assert process.returncode == 130 and "interrupted" in err and "continue" in out
    assert all(p.suffix == ".npz" for p in chunks.iterdir())
    finished = subprocess.run(command, capture_output=True, text=True, timeout=120)
    assert finished.returncode == 0 and "reused" in finished.stdout


def test_what_simulate_writes_is_estimated_though_its_lines_are_wide_apart(tmp_path):
    """The rig's bands of 15 Hz hold fewer than two of these lines, which are 10 Hz apart."""
    maglev("simulate", "--excite", "force=1:49:2@0.4", "--fundamental", 5, "--out", tmp_path / "c")
    maglev("estimate", tmp_path / "c", "--json", tmp_path / "e.json")
    bands = json.loads((tmp_path / "e.json").read_text())["recordings"][0]["bands"]
    assert len(bands) >= 2
