"""Recordings that tell nothing are left out by name, with the reason and what to record; the others are used."""

import json
import tomllib
from dataclasses import replace

import numpy as np
import pytest
from bench_loop import Bench, write_campaign
from command_line import maglev

from maglev_env.recordings.campaign import load_campaign, parse_campaign
from sim2real.compared.standing import standing
from sim2real.recorded.records import read_records


def current_driven(folder, kinds, seconds=0.5):
    """A campaign whose controller is not known: the measured current drives the simulation."""
    path = write_campaign(folder, Bench(), kinds, seconds, 0) / "campaign.toml"
    lines = path.read_text().splitlines()
    path.write_text("\n".join(line for line in lines if not line.startswith(("gains", "command"))))
    return folder


def changed(folder, file, channel, change):
    held = dict(np.load(folder / file))
    held[channel] = change(held[channel])
    np.savez(folder / file, **held)


def rest(folder, file):
    """What a calm rotor shows: noise of the probe, and a current that moves nothing beyond it."""
    changed(folder, file, "displacement", lambda y: np.random.default_rng(1).normal(scale=1e-6, size=y.size))
    changed(folder, file, "current", lambda i: 1e-3 * i)


def fallen(y):
    """The rotor lies at its stop from the middle on."""
    y = y.copy()
    y[y.size // 2 :] = 0.175e-3
    return y


def test_a_hover_is_left_out_and_nothing_else_changes(tmp_path):
    folder = current_driven(tmp_path, {"noise": "fit", "hover": "fit"})
    rest(folder, "hover.npz")
    told, records = read_records(folder)
    assert [r.name for r in records] == [spec.file for spec in told.recordings] == ["noise.npz"]
    (left,) = told.left_out
    assert left.recording == "hover.npz" and "no more than the noise does" in left.reason
    assert left.instead.startswith("record larger steps")
    loaded = load_campaign(folder)
    (alone,) = read_records(replace(loaded, recordings=loaded.recordings[:1]))[1]
    assert np.array_equal(alone.driving("current"), records[0].driving("current"))


def test_of_two_recordings_in_one_file_only_the_one_that_rests_is_left_out(tmp_path):
    """Neither was, because both had the name of the file: none seemed to be left to fit."""
    folder = current_driven(tmp_path, {"noise": "fit", "hover": "fit"})
    rest(folder, "hover.npz")
    parts = [dict(np.load(folder / f"{kind}.npz")) for kind in ("noise", "hover")]
    np.savez(folder / "both.npz", **{name: np.concatenate([part[name] for part in parts]) for name in parts[0]})
    tables = tomllib.loads((folder / "campaign.toml").read_text())
    count = len(parts[0]["displacement"])
    for i, table in enumerate(tables["recording"]):
        table |= {"file": "both.npz", "start": i * count, "samples": count}
    told, records = read_records(parse_campaign(folder, tables))
    assert [r.name for r in records] == [spec.name for spec in told.recordings] == ["both.npz from sample 0"]
    assert [left.recording for left in told.left_out] == [f"both.npz from sample {count}"]


@pytest.mark.slow
def test_a_hover_under_a_known_controller_does_not_enter_the_fit(tmp_path):
    """What drives it is the rounding of its command, which moves the rotor by a thousandth of its motion."""
    folder = tmp_path
    write_campaign(folder, Bench(noise=1e-7, current_noise=1e-4), {"noise": "fit", "hover": "fit"}, 0.5, 3)
    command = np.load(folder / "hover.npz")["command"]
    assert np.ptp(command)
    told, records = read_records(folder)
    assert len(records) == 2
    quiet = replace(records[1], waves={at: 1e-3 * wave for at, wave in records[1].waves.items()})
    campaign, kept = standing(told, [records[0], quiet])
    assert [r.name for r in kept] == ["noise.npz"]
    assert "moves the rotor no more than the noise" in campaign.left_out[0].reason
    assert len(standing(told, [quiet])[1]) == 1, "alone, it is for the caller to say that nothing is bounded"


def test_a_periodic_recording_without_gains_is_compared_as_one_without_a_period(tmp_path):
    path = write_campaign(tmp_path, Bench(), {"noise": "fit", "sine": "fit"}, 0.5, 0) / "campaign.toml"
    text = path.read_text()
    head, _, sine = text.rpartition("[[recording]]")
    lines = [line for line in sine.splitlines() if not line.startswith(("gains", "excitation"))]
    at = next(i for i, line in enumerate(lines) if line.startswith("sample_rate"))
    lines.insert(at, 'excitation = { kind = "sphs", at = "current", fundamental = 20.0, lines = [1], amplitude = 0.1 }')
    path.write_text(head + "[[recording]]" + "\n".join(lines) + "\n")
    told, records = read_records(tmp_path)
    names = [r.name for r in records] + [one.recording for one in told.left_out]
    assert sorted(names) == ["noise.npz", "sine.npz"] and "noise.npz" in [r.name for r in records]


def test_each_reason_is_given_where_none_is_left(tmp_path):
    folder = current_driven(tmp_path, {"hover": "fit", "sine": "fit", "noise": "holdout"})
    rest(folder, "hover.npz")
    changed(folder, "sine.npz", "displacement", np.zeros_like)
    with pytest.raises(ValueError) as refused:
        read_records(folder)
    text = str(refused.value)
    assert "hover.npz: what is recorded of the drive moves the rotor no more than the noise does" in text
    assert "sine.npz: levitation is lost" in text and "noise.npz" not in text


def test_a_recording_in_whose_simulation_the_nominal_rig_falls_is_left_out_where_another_stands(tmp_path):
    told, records = read_records(current_driven(tmp_path, {"noise": "fit", "steps": "fit"}))
    thrown = [replace(r, waves={at: 60 * wave for at, wave in r.waves.items()}) for r in records]
    campaign, kept = standing(told, [records[0], thrown[1]])
    assert [r.name for r in kept] == [s.file for s in campaign.recordings] == ["noise.npz"]
    assert campaign.left_out[0].recording == "steps.npz" and "touches down" in campaign.left_out[0].reason
    campaign, kept = standing(told, thrown)
    assert len(kept) == 2 and campaign == told, "where it falls in all of them, the rig is wrong, not the recordings"


@pytest.mark.slow
def test_estimate_names_a_recording_that_touched_down(tmp_path):
    folder = current_driven(tmp_path, {"noise": "fit", "chirp": "fit"})
    changed(folder, "chirp.npz", "displacement", fallen)
    text = maglev("estimate", folder, "--json", tmp_path / "e.json")
    data = json.loads((tmp_path / "e.json").read_text())
    (left,) = data["left_out"]
    assert left["recording"] == "chirp.npz" and "levitation is lost from" in left["reason"] and left["instead"]
    assert "left out chirp.npz: levitation is lost" in " ".join(text.split()) and "in 1 recording(s)" in text
    assert "chirp.npz: levitation is lost" in (folder / "estimate.html").read_text()
