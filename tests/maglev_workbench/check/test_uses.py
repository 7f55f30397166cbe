"""What `check` says of every command is what the command itself says, with what to record instead."""

import json

import numpy as np
import pytest
from bench_loop import Bench, excitation, write_campaign
from campaigns import campaign
from command_line import maglev

from maglev_env.recordings.alarms.alarm import Alarm
from maglev_env.recordings.campaign import load_campaign
from maglev_workbench.commands.check.report import grouped, said_once
from maglev_workbench.commands.check.uses import COMMANDS, INSTEAD, Use, check_answer, uses
from sim2real.recorded.records import read_records
from tuning.campaign.recorded_sets import recorded_sets


@pytest.fixture(scope="module")
def periodic(tmp_path_factory):
    return load_campaign(campaign(tmp_path_factory.mktemp("p") / "c", names=("base",)))


def by_command(loaded, alarms=()):
    return {use.command: use for use in uses(loaded, loaded.recordings[0], alarms)}


def test_a_full_recording_is_good_for_all(periodic):
    found = by_command(periodic)
    assert tuple(found) == COMMANDS and {use.verdict for use in found.values()} == {"yes"}
    assert "from 4 to " in found["estimate"].reason and not any(use.instead for use in found.values())


def test_with_an_alarm_nothing_is_simply_yes(periodic):
    alarm = Alarm("stuck", "displacement", 0.5, "warning", "the displacement is stuck from 0.5 s on")
    found = by_command(periodic, [alarm])
    assert {use.verdict for use in found.values()} == {"with care"}
    assert found["tune"].reason.endswith("stuck at 0.5 s") and found["tune"].instead == INSTEAD["tune"]


def test_an_unstored_excitation_is_for_estimate_and_diagnose(tmp_path):
    loaded = load_campaign(write_campaign(tmp_path, Bench(), {"noise": "fit"}, 0.5, 0))
    found = by_command(loaded)
    assert {name for name, use in found.items() if use.verdict == "yes"} == {"estimate", "diagnose"}
    assert found["margins"].verdict == "no" and found["tune"].verdict == "with care"
    assert "inject" in found["margins"].instead


def test_the_reasons_are_the_commands_own(tmp_path):
    """Without gains, command and current neither diagnosis nor tuning can begin; each refuses in the same words."""
    folder = write_campaign(tmp_path, Bench(), {"noise": "fit"}, 0.5, 0)
    text = (folder / "campaign.toml").read_text()
    lines = [line for line in text.splitlines() if not line.startswith(("gains", "command", "current"))]
    (folder / "campaign.toml").write_text("\n".join(lines))
    loaded = load_campaign(folder)
    found = by_command(loaded)
    for name, rule in (("diagnose", read_records), ("tune", recorded_sets)):
        with pytest.raises(ValueError) as refused:
            rule(loaded)
        assert found[name].verdict == "no" and found[name].reason in str(refused.value)
        assert str(folder) not in found[name].reason


def test_the_sentence_of_several_recordings():
    yes, care, no = (Use("", v, "because", "") for v in ("yes", "with care", "no"))
    assert check_answer([("a", (yes, care, yes, no))], 0) == (
        "Usable for estimate and diagnose, with care for margins; not for tune (because)."
    )
    assert check_answer([("a", (yes,) * 4), ("b", (no,) * 4)], 0, ["b"]).endswith(
        "(1 of 2). First mend or take out b: a contradicted recording makes every command refuse."
    )
    assert "take out" not in check_answer([("b", (no,) * 4)], 0, ["b"])  # nothing is usable beside it
    assert check_answer([("a", (yes,) * 4), ("b", (no,) * 4)], 1) == (
        "Usable for estimate (1 of 2), margins (1 of 2), diagnose (1 of 2) and tune (1 of 2); 1 of 2 recording(s) with "
        "an alarm."
    )
    assert check_answer([("a", (no,) * 4)], 0) == ("Not usable for estimate, margins, diagnose and tune (because).")
    other = Use("tune", "no", "rig mine: its gains are of another form; state others", "")
    assert "not for tune (its gains are of another form)." in check_answer([("a", (yes, yes, yes, other))], 0)


@pytest.mark.parametrize("kind", ["recorded", "none"])
def test_check_fits_no_rig_to_say_that_it_could(tmp_path, monkeypatch, kind):
    folder = write_campaign(tmp_path, Bench(), {"chirp": "fit"}, 1.0, 0)
    columns = dict(np.load(folder / "chirp.npz"))
    injection, _ = excitation("chirp", 1.0, np.random.default_rng(0))
    np.savez(folder / "chirp.npz", injection=injection, **columns)
    text = (folder / "campaign.toml").read_text().replace('{ kind = "none" }', f'{{ kind = "{kind}", at = "current" }}')
    (folder / "campaign.toml").write_text(text + '\ninjection = { from = "injection" }\n')

    def refuse(*_):
        raise AssertionError("the rig is fitted")

    monkeypatch.setattr("maglev_workbench.commands.estimate.recordings.pooled", refuse)
    found = by_command(load_campaign(folder))
    assert found["estimate"].verdict == "yes"


def test_the_command_begins_with_its_answer_and_a_bare_file_needs_no_rig(tmp_path):
    t, lines = np.arange(4000) / 1000.0, np.arange(1, 26)
    drives = np.exp(2j * np.pi * (2 * np.outer(lines, t) + lines[:, None] ** 2 / 50))
    w = 2 * np.pi * 2 * lines
    moved = drives / (1e3 - 0.1 * w**2 + 2j * w)[:, None]  # 0.1 kg on 1000 N/m and 2 N s/m
    noise = 1e-6 * np.random.default_rng(0).standard_normal(t.size)
    table = np.stack([t, drives.real.sum(axis=0), moved.real.sum(axis=0) + noise], axis=1)
    np.savetxt(tmp_path / "run.csv", table, delimiter=",", header="time,force_N,displacement_m", comments="")
    text = maglev("check", tmp_path / "run.csv", "--json", tmp_path / "c.json")
    data = json.loads((tmp_path / "c.json").read_text())
    assert data["answer"].startswith("Usable with care for estimate;") and " ".join(text.split()).startswith(
        data["answer"]
    )
    assert {one["what"] for one in data["guesses"]} >= {"sample_rate", "excitation"}
    (one,) = data["notes"]
    assert one["recording"] == "run.csv" and one["note"].startswith("intersample is not stated") and one["note"] in text
    assert all(f"guess: {one['what']}: " in " ".join(text.split()) for one in data["guesses"])
    (own,) = data["commands"]
    assert own["file"] == "run.csv" and "rig is missing" in own["diagnose"]["why"] and own["diagnose"]["instead"]
    page = (tmp_path / "run-check.html").read_text()
    assert "What each command makes of it" in page and "rig is missing" in page


def test_a_rate_is_not_taken_for_a_campaign(tmp_path):
    folder = write_campaign(tmp_path, Bench(), {"chirp": "fit"}, 0.5, 0)
    assert "--rate is for one file" in maglev("check", folder, "--rate", 17, code=2)


def test_what_is_the_same_of_several_recordings_or_commands_is_said_once():
    same = [Use(name, "no", "clipped", "less amplitude") for name in COMMANDS]
    other = [Use("estimate", "yes", "fitted", ""), *same[1:]]
    assert [(commands, files) for commands, files, _ in grouped([("a", same), ("b", same)])] == [
        ("estimate, margins, diagnose, tune", "all")
    ]
    found = grouped([("a", other), ("b", same), ("c", same)])
    assert [(commands, files, use.verdict) for commands, files, use in found] == [
        ("estimate", "a", "yes"),
        ("estimate", "b, c", "no"),
        ("margins, diagnose, tune", "all", "no"),
    ]
    assert said_once([("a", "x"), ("b", "x"), ("a", "y")], 2) == ["x", "a: y"]


def test_a_page_of_the_folder_that_one_is_in_has_its_name(tmp_path, monkeypatch):
    folder = tmp_path / "bench"
    folder.mkdir()
    write_campaign(folder, Bench(), {"chirp": "fit"}, 0.5, 0)
    monkeypatch.chdir(folder)
    maglev("check", ".")
    assert "<h1>Check of bench</h1>" in (folder / "check.html").read_text()
