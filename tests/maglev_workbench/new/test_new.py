"""`maglev new`: files of other programs become a campaign that `maglev check` takes."""

import json
import shutil
import tomllib
from io import StringIO
from pathlib import Path

import numpy as np
import pytest
from campaigns import planned
from command_line import maglev
from foreign_files import LAYOUTS
from typer.testing import CliRunner

from maglev_env.kernel.simulate import simulate_records
from maglev_env.recordings.campaign import load_campaign
from maglev_env.recordings.guess.recording import guess_recording
from maglev_env.recordings.recording import read_recording, simulated_recording
from maglev_env.rig.rig_file import RIG_FOLDER, load_rig
from maglev_workbench.cli import app
from maglev_workbench.commands.new import questions

RATE, FUNDAMENTAL = 20000.0, 4.0


@pytest.fixture(scope="module")
def record() -> dict[str, np.ndarray]:
    experiment = planned(load_rig("hmb_free"), names=("base",))[0].experiment
    dataset = simulated_recording(experiment, simulate_records([experiment])[0])
    return {"time": dataset.time.values, **{str(n): dataset[n].values for n in dataset.data_vars}}


@pytest.fixture(scope="module")
def foreign(record, tmp_path_factory) -> dict[str, Path]:
    """Every layout in one folder."""
    folder = tmp_path_factory.mktemp("foreign")
    return {layout.__name__: layout(folder, record) for layout in LAYOUTS}


@pytest.mark.parametrize("layout", [f.__name__ for f in LAYOUTS])
def test_every_layout_is_read_as_what_it_is(foreign, record, layout):
    guess = guess_recording(foreign[layout], rate=RATE if layout == "timeless" else None)
    stored = {"displacement", "command", "current"} | ({"force", "injection"} if layout != "headerless" else set())
    assert stored == set(guess.channels) - {"time"}
    assert guess.rate.value == RATE
    for name in stored:
        column = guess.channels[name]
        raw = _column(foreign[layout], column.column) * column.scale
        np.testing.assert_allclose(raw, record[name], rtol=1e-5, atol=1e-9 + 1e-6 * (name != "displacement"))
    if layout == "headerless":  # what was injected is not in the file: neither it nor the controller can be told
        assert guess.excitation.value == "none" and guess.gains is None and guess.excitation.ask
    else:
        assert {e["at"] for e in guess.excitations} == {"current", "force"}
        assert {e["fundamental"] for e in guess.excitations} == {FUNDAMENTAL}
        assert guess.gains["kp"] == pytest.approx(8000.0, rel=1e-3) and guess.gains["kd"] == pytest.approx(
            5.2, rel=1e-3
        )
    assert all(g.reason for g in guess.guesses)


def _column(file: Path, name: str) -> np.ndarray:
    from maglev_env.recordings.files import read_columns

    return read_columns(file).column(name)


@pytest.mark.slow
def test_check_runs_on_what_new_wrote_after_one_edit_that_a_comment_asks_for(foreign, tmp_path):
    folder = tmp_path / "all"
    shutil.copytree(next(iter(foreign.values())).parent, folder)
    text = maglev("new", folder, "--json", tmp_path / "new.json")
    assert "next maglev check" in text
    target = folder / "campaign.toml"
    written = target.read_text()
    assert written.count("sample_rate = 0.0") == 1  # of the file without time; a comment above it asks
    before = written[: written.index("sample_rate = 0.0")].splitlines()
    assert any("please state: sample rate in Hz" in line for line in before[-3:])
    assert "timeless.csv" in maglev("check", folder, code=2)
    target.write_text(written.replace("sample_rate = 0.0", "sample_rate = 20000.0"))
    maglev("check", folder, "--json", tmp_path / "check.json")
    checked = json.loads((tmp_path / "check.json").read_text())
    verdicts = {r["file"]: r["can"] for r in checked["recordings"]}
    assert len(verdicts) == len(LAYOUTS) and "no excitation is stated" in verdicts.pop("log.txt")["estimate"]
    assert all(can["stiffness and damping"] == "yes" for can in verdicts.values()), verdicts
    guesses = json.loads((tmp_path / "new.json").read_text())["recordings"]
    assert all(0 <= g["confidence"] <= 1 and g["reason"] for r in guesses for g in r["guesses"])
    assert tomllib.loads((folder / "rig.toml").read_text())["gains"]["kp"] == pytest.approx(8000.0, rel=1e-3)


def test_every_guess_stands_in_the_campaign_with_its_evidence(foreign, tmp_path):
    maglev("new", foreign["csv_units"], "--out", tmp_path / "c", "--mass", 0.08, "--rig", "hmb_free")
    written = (tmp_path / "c" / "campaign.toml").read_text()
    assert "20000 Hz: mean step of column Time" in written and 'called "Gap sensor" in um' in written
    campaign = load_campaign(tmp_path / "c")
    assert campaign.mass == 0.08 and campaign.rig.name == "hmb_free"
    dataset = read_recording(campaign, campaign.recordings[0])
    assert {"displacement", "force", "injection"} <= set(dataset.data_vars)
    assert (tmp_path / "c" / "units.csv").exists() and not (tmp_path / "c" / "rig.toml").exists()


def test_nothing_is_overwritten_without_force(foreign, tmp_path):
    target = tmp_path / "campaign.toml"
    target.write_text("mine")
    (tmp_path / "rig.toml").write_text("mine too")
    shutil.copy(foreign["npz"], tmp_path)
    assert "--force" in maglev("new", tmp_path, code=2) and target.read_text() == "mine"
    target.unlink()
    maglev("new", tmp_path)
    assert (tmp_path / "rig.toml").read_text() == "mine too"
    (tmp_path / "rig.toml").unlink()
    for magnet in ("electromagnet_pair", "electromagnet"):
        maglev("new", tmp_path, "--force", "--magnet", magnet)
        assert f'magnet = "{magnet}"' in (tmp_path / "rig.toml").read_text()


def test_a_rig_that_is_filled_in_is_kept(foreign, tmp_path):
    shutil.copy(foreign["npz"], tmp_path)
    own = (
        'schema = "maglev-rig/1"\nname = "own"\nmagnet = "electromagnet_pair"\n[parameters]\nmass = 0.08\n'
        "actuator_gain = 5.7\nnegative_stiffness = -1e4\nbias_current = 0.5\ngap = 4e-4\n"
    )
    (tmp_path / "rig.toml").write_text(own)
    maglev("new", tmp_path)
    assert "filled in, and kept" in maglev("new", tmp_path, "--force")
    assert (tmp_path / "rig.toml").read_text() == own


def test_a_skeleton_that_was_filled_in_only_where_it_asks_is_kept(foreign, tmp_path):
    """Mass and rate stand in a skeleton, too: values that the user wrote there are the user's."""
    shutil.copy(foreign["npz"], tmp_path)
    own = tmp_path / "rig.toml"
    maglev("new", tmp_path, "--mass", "0.08")
    filled = own.read_text().replace("mass = 0.08", "mass = 0.0583").replace('"mine"', '"lab ball"')
    own.write_text(filled)
    maglev("new", tmp_path, "--force")
    assert own.read_text() == filled
    # Even what is commented out may be a note.
    own.unlink()
    maglev("new", tmp_path, "--force")
    noted = own.read_text().replace("# mass = 0.005", "# mass = 0.002")
    own.write_text(noted)
    maglev("new", tmp_path, "--force")
    assert own.read_text() == noted


def test_the_rig_of_the_folder_may_be_named(foreign, tmp_path):
    """It is not replaced by itself, which would delete it."""
    shutil.copy(foreign["npz"], tmp_path)
    own = tmp_path / "rig.toml"
    maglev("new", tmp_path, "--magnet", "none", "--mass", "0.08")
    before = own.read_text()
    maglev("new", tmp_path, "--rig", own, "--force")
    assert own.read_text() == before
    assert 'rig = "rig.toml"' in (tmp_path / "campaign.toml").read_text()


@pytest.mark.parametrize("wrong", ["gap = 4e-4 m", "gapp = 4e-4"])
def test_a_rig_with_a_mistake_is_kept_and_the_mistake_said(foreign, tmp_path, wrong):
    shutil.copy(foreign["npz"], tmp_path)
    maglev("new", tmp_path, "--magnet", "electromagnet_pair", "--mass", "0.08")
    skeleton = (tmp_path / "rig.toml").read_text()
    own = skeleton.replace("[parameters]", f"[parameters]\n{wrong}")
    (tmp_path / "rig.toml").write_text(own)
    text = " ".join(maglev("new", tmp_path, "--force").split())
    assert "is kept, but is no rig yet" in text and ("gapp" in text or "line" in text)
    assert (tmp_path / "rig.toml").read_text() == own


def test_a_rig_from_elsewhere_takes_the_place_of_a_skeleton_that_nobody_wrote_into(foreign, tmp_path):
    campaign, rig = tmp_path / "campaign", tmp_path / "rig.toml"
    campaign.mkdir()
    shutil.copy(foreign["npz"], campaign)
    shutil.copy(RIG_FOLDER / "hmb_free.toml", rig)
    maglev("new", campaign)
    maglev("new", campaign, "--rig", rig, "--force")
    assert (campaign / "rig.toml").read_bytes() == rig.read_bytes()
    (campaign / "rig.toml").write_text(rig.read_text().replace("mass = ", "mass = 1"))
    assert "exists and is not" in maglev("new", campaign, "--rig", rig, "--force", code=2)


def test_a_file_that_cannot_be_read_is_left_out_and_named(foreign, tmp_path):
    shutil.copy(foreign["npz"], tmp_path / "good.npz")
    (tmp_path / "bad.mat").write_bytes(b"not a file of MATLAB")
    text = maglev("new", tmp_path)
    assert "left out" in text and "bad.mat" in text
    assert [r.file for r in load_campaign(tmp_path).recordings] == ["good.npz"]


@pytest.mark.parametrize(
    ("layout", "answers"),
    [("timeless", ["20000", "0.08", "electromagnet"]), ("npz", [*["", "mA", "", "", ""], "", ""])],
)
def test_a_terminal_is_asked_what_the_file_does_not_tell(foreign, tmp_path, monkeypatch, layout, answers):
    monkeypatch.setattr(questions, "interactive", lambda: True)
    file = shutil.copy(foreign[layout], tmp_path)
    result = CliRunner().invoke(app, ["new", str(file)], input="\n".join(answers) + "\n")
    assert result.exit_code == 0, result.output
    campaign = load_campaign(tmp_path)
    assert campaign.recordings[0].sample_rate == RATE
    assert campaign.mass == (0.08 if layout == "timeless" else None)
    if layout == "npz":  # columns in the file's order: x, i_ref, ...
        assert campaign.recordings[0].channels["command"].scale == 1e-3


def test_names_in_a_file_cannot_write_into_the_campaign(tmp_path, record):
    rows = np.column_stack([record["time"], record["displacement"], record["force"]])[:2000]
    header = '"t","y""]\nrole = ""holdout","F\t[N]"'
    text = header + "\n" + "\n".join(",".join(f"{v:.9g}" for v in row) for row in rows)
    (tmp_path / "odd.csv").write_text(text.replace("\nrole", " role"))
    maglev("new", tmp_path)
    assert load_campaign(tmp_path).recordings[0].role == "fit"


def test_check_and_estimate_take_one_bare_file(foreign, tmp_path):
    file = shutil.copy(foreign["semicolon"], tmp_path)
    text = maglev("check", file)
    assert "guess: sample_rate" in text and "stiffness and damping" in text
    text = maglev("estimate", file, "--mass", 0.0801, "--band-width", 80, "--band-overlap", 40, "--method", "ml")
    assert "guess:" in text and "stiffness" in text
    assert "--rate" in maglev("check", shutil.copy(foreign["timeless"], tmp_path), code=2)


def test_columns_that_nothing_names_are_what_the_user_says(tmp_path):
    noise = np.random.default_rng(4).normal(size=(4000, 3))
    np.savetxt(tmp_path / "run.csv", noise, delimiter=",", header="V1,V2,V3", comments="")
    assert "such as --channel V3=displacement" in maglev("new", tmp_path, "--rate", 600, code=2)
    stated = ["--channel", "V1=force", "--channel", "V2=displacement", "--channel", "V3=unused", "--scale", "V2=1e-3"]
    maglev("new", tmp_path, "--rate", 600, "--magnet", "none", *stated)
    (recording,) = tomllib.loads((tmp_path / "campaign.toml").read_text())["recording"]
    assert recording["channels"] == {"force": {"from": "V1"}, "displacement": {"from": "V2", "scale": 1e-3}}
    wrong = {
        "V4=force": "no file has such a column; there are V1",
        "V1=flow": "flow",
        "V1": "write",
        "V3=force": "force is stated of 2 columns (V1, V3)",
    }
    for told, why in wrong.items():
        assert why in maglev("new", tmp_path, "--rate", 600, "--force", *stated, "--channel", told, code=2)


def test_a_stated_scale_and_zero_go_into_channels_and_gains(tmp_path):
    """A probe in volts, 2 mm/V and 2.5 V at rest, whose controller counts in volts."""
    rng, n, rate = np.random.default_rng(3), 4000, 1000.0
    wanted = np.repeat(rng.uniform(-1e-3, 1e-3, 10), n // 10)
    moved = np.convolve(wanted, np.full(60, 1 / 60), "same") + 1e-6 * rng.normal(size=n)
    command = 250.0 * (wanted - moved) - 2.5 * np.diff(moved, prepend=moved[0]) * rate
    table = np.column_stack([np.arange(n) / rate, 2.5 + moved / 2e-3, 2.5 + wanted / 2e-3, command])
    np.savetxt(tmp_path / "run.csv", table, delimiter=",", header="t [s],probe [V],ref [V],i_cmd [A]", comments="")
    both = [f"{name}={value}" for name in ("probe", "ref") for value in ("0.002",)]
    text = maglev("new", tmp_path, *(part for one in both for part in ("--scale", one)), "--zero", "probe=2.5",
                  "--zero", "ref=2.5")  # fmt: skip
    (recording,) = tomllib.loads((tmp_path / "campaign.toml").read_text())["recording"]
    assert "m per V" not in text
    assert recording["channels"]["displacement"] == {"from": "probe [V]", "scale": 0.002, "offset": -0.005}
    assert recording["controller"]["kp"] == pytest.approx(250.0, rel=1e-2)
    assert recording["controller"]["derivative_on"] == "measurement"
    skeleton = tomllib.loads((tmp_path / "rig.toml").read_text())
    assert skeleton["gains"] == recording["controller"] and skeleton["parameters"]["control_rate"] == rate
    assert "--scale COLUMN=VALUE" in maglev("new", tmp_path, "--force")
    for wrong, words in (
        ("prob=0.002", "there are"), ("probe=x", "COLUMN=VALUE"), ("probe=0", "probe=0: a scale of 0 leaves nothing"),
        ("probe=nan", "COLUMN=VALUE"), ("probe=-inf", "COLUMN=VALUE"),
    ):  # fmt: skip
        assert words in maglev("new", tmp_path, "--force", "--scale", wrong, code=2)


def test_a_question_commands_no_terminal(capsys, monkeypatch):
    monkeypatch.setattr("sys.stdin", StringIO("20000\n"))
    assert questions.ask_rate("run\x1b[2J.csv") == 20000.0
    assert "run\ufffd[2J.csv" in capsys.readouterr().out


@pytest.mark.parametrize("answer", ["inf", "nan", "0", "much"])
def test_an_answer_that_is_no_finite_number_is_refused(answer):
    with pytest.raises(ValueError, match="must be a positive number"):
        questions._positive(answer, "mass")


def test_a_named_rig_leaves_nothing_to_edit_of_a_ball_below_a_coil(tmp_path):
    t = np.arange(3000) / 1000.0
    gap = 8.0 + 0.3 * np.convolve(np.where(t < 1.5, 0.0, 1.0), np.full(80, 1 / 80), "same")
    table = np.column_stack([t, gap, 0.9 + 0.2 * (gap - 8.0) + 1e-3 * np.random.default_rng(1).normal(size=t.size)])
    np.savetxt(tmp_path / "run.csv", table, delimiter=",", header="t [s],gap [mm],i [A]", comments="", fmt="%.6f")
    (tmp_path / "ball.toml").write_text(
        'schema = "maglev-rig/1"\nname = "ball"\nmagnet = "electromagnet"\n[parameters]\nmass = 0.05\ngap = 8e-3\n'
        "bias_current = 0.9\nclearance = 4e-3\n"
    )
    text = maglev("new", tmp_path, "--rig", tmp_path / "ball.toml")
    (recording,) = tomllib.loads((tmp_path / "campaign.toml").read_text())["recording"]
    assert recording["channels"]["displacement"] == {"from": "gap [mm]", "scale": -1e-3, "offset": 8e-3}
    assert recording["channels"]["current"] == {"from": "i [A]", "total": True}
    assert "edit " not in text and "total = true" not in text
