"""Every command that reads a campaign refuses what contradicts, and says what is doubtful in text and JSON."""

import json
import shutil

import campaigns
import numpy as np
import pytest
from command_line import maglev

from maglev_env.loop.effect import effect
from maglev_env.redundancy.finding import Finding
from maglev_workbench.warned import shown


@pytest.fixture(scope="module")
def wrong(tmp_path_factory):
    """The force doubled and the injection times 2.83: estimates as from another rig, with a peak |S| below 1."""
    folder = campaigns.campaign(tmp_path_factory.mktemp("wrong"), names=("base",))
    columns = dict(np.load(folder / "base.npz"))
    columns["force"] *= 2.0
    columns["injection"] *= 2.83
    np.savez(folder / "base.npz", **columns)
    return folder


@pytest.mark.parametrize("command", [("estimate",), ("diagnose",), ("tune", "--campaign")])
def test_a_contradiction_is_refused_before_any_work(wrong, command):
    text = maglev(*command, wrong, code=2)
    assert "base.npz: force: factor 2 +- " in text and "(2 more: `maglev check` shows all)" in text
    assert not (wrong / "diagnosis").exists()


def test_check_shows_every_contradiction_and_calls_nothing_good(wrong, tmp_path):
    text = maglev("check", wrong, "--json", tmp_path / "c.json")
    assert text.count("ALARM") >= 2 and "yes" not in text.partition("good for")[2].partition("page")[0]
    data = json.loads((tmp_path / "c.json").read_text())
    assert {w["kind"] for w in data["warnings"]} >= {"contradiction"} and data["recordings"]


def test_a_contradicted_recording_is_known_by_its_name_whatever_that_holds(wrong, tmp_path):
    shutil.copytree(wrong, tmp_path / "c")
    (tmp_path / "c" / "base.npz").rename(tmp_path / "c" / "run, first.npz")
    toml = tmp_path / "c" / "campaign.toml"
    toml.write_text(toml.read_text().replace("base.npz", "run, first.npz"))
    maglev("check", tmp_path / "c", "--json", tmp_path / "c.json")
    data = json.loads((tmp_path / "c.json").read_text())
    assert {data["commands"][0][command]["usable"] for command in ("estimate", "diagnose")} == {"no"}
    assert "usable" not in data["answer"].partition("ot usable")[0]
    assert all(verdict.startswith("no") for verdict in data["recordings"][0]["can"].values())


def test_an_effect_is_a_warning_that_names_diagnose(tmp_path):
    folder = campaigns.campaign(tmp_path / "rig", effects=effect("mass", 0.5), names=("base",))
    text = maglev("estimate", folder, "--band-width", 60, "--band-overlap", 20, "--json", tmp_path / "e.json")
    assert text.startswith("warning base.npz: ") and "or an effect (" in text and "run `maglev diagnose`" in text
    (warning, *_) = json.loads((tmp_path / "e.json").read_text())["warnings"]
    assert warning["kind"] == "effect" and "mass" in warning["channel"]
    assert warning["interval"][0] < warning["value"] < warning["interval"][1]


def test_what_one_rule_says_of_several_recordings_stands_once_and_an_alarm_each_time(capsys):
    def finding(recording, value, kind):
        return Finding("balance", recording, "current", value, None, f"off by {value}", kind)

    shown([finding("a.csv", 1.0, "effect"), finding("b.csv", -3.0, "effect"), finding("c.csv", 2.0, "effect")])
    text = " ".join(capsys.readouterr().out.split())
    assert text == "warning b.csv: off by -3.0 (likewise, though less: a.csv; c.csv)"
    shown([finding("a.csv", 1.0, "contradiction"), finding("b.csv", 2.0, "contradiction")])
    assert capsys.readouterr().out.count("ALARM") == 2


def test_a_coil_recording_is_checked_too(tmp_path):
    time = np.arange(4000) / 250e3
    wave = np.sign(np.sin(2 * np.pi * 25e3 * time + 0.1))
    np.savez(tmp_path / "c.npz", i=0.1 * np.cumsum(wave), u=24 * wave, y=1e-3 * np.sin(2 * np.pi * 100 * time))
    (tmp_path / "campaign.toml").write_text(
        'schema = "maglev-campaign/1"\nrig = "hmb_free"\n[[recording]]\nfile = "c.npz"\nsample_rate = 250e3\n'
        'excitation = { kind = "none" }\n[recording.channels]\ncurrent = { from = "i" }\nvoltage = { from = "u" }\n'
        'displacement = { from = "y" }\n'
    )
    text = maglev("selfsense", "estimate", tmp_path, "--out", tmp_path / "e.html", code=2)
    assert "displacement: it moves over 0.002 m, and the rig's clearance leaves 0.0007 m" in text
