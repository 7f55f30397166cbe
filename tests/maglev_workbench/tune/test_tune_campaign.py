"""`maglev tune --campaign` as a user runs it."""

import json
import re
import tomllib
from dataclasses import replace
from functools import partial

import pytest
from command_line import maglev

from maglev_env.design.defaults import with_defaults
from maglev_env.experiment import protocol_experiment
from maglev_env.kernel.simulate import simulate_records
from maglev_env.recordings.campaign import load_campaign
from maglev_env.recordings.campaign_writer import write_campaign
from maglev_env.recordings.formats.text_layout import TextLayout
from maglev_env.recordings.recording import simulated_recording
from maglev_env.rig.rig_file import load_rig
from maglev_env.task.protocol import env_protocol
from maglev_workbench.commands.tune.next_recording import toml_block
from tuning.campaign.next_step import next_step, tuning_task

run = partial(maglev, "tune")
HEAD = 'schema = "maglev-campaign/1"\n'


def recorded(folder, *changes, rig="hmb_free"):
    """A campaign of one recording at the preset, or of as many as it is changed in ways."""
    loaded = with_defaults(load_rig(rig))
    e = protocol_experiment(replace(loaded, protocol=env_protocol(loaded, "quick")), seed=1)
    dataset = simulated_recording(e, simulate_records([e])[0])
    every = [(f"run{i}", "fit", change(dataset), e) for i, change in enumerate(changes or [same], 1)]
    write_campaign(folder, rig, {}, every)
    return folder


def same(dataset):
    return dataset


def touching(dataset):
    y = dataset.displacement.copy()
    y[len(y) // 2] = 0.36e-3
    return dataset.assign(displacement=y)


def test_without_a_recording_it_starts_at_the_preset(tmp_path):
    (tmp_path / "campaign.toml").write_text(HEAD + 'rig = "hmb_free"\n')
    text = run("--campaign", tmp_path, "--json", tmp_path / "a.json")
    assert "Record next kp = 8000 A/m, ki = 2000 A/m, kd = 5.2 A s/m" in text and "preset gains" in text
    block = tomllib.loads((tmp_path / "tune" / "next.toml").read_text())["recording"][0]
    assert block["gains"]["kp"] == 8000.0 and block["file"] == "run1.mat" and len(block["excitation"]) == 2
    data = json.loads((tmp_path / "a.json").read_text())
    assert data["schema"] == "maglev-tune-campaign/2" and data["next"]["kd"] == 5.2 and data["stop"] is None
    assert "To record" in (tmp_path / "tune" / "tune.html").read_text()


def test_ranges_are_taken_as_for_a_simulated_rig(tmp_path):
    """They had been refused: "no gain 'kp=4000:9000'"."""
    (tmp_path / "campaign.toml").write_text(HEAD + 'rig = "hmb_free"\n')
    run("--campaign", tmp_path, "--tune", "kp=4000:9000", "--tune", "kd", "--json", tmp_path / "a.json")
    assert json.loads((tmp_path / "a.json").read_text())["made_by"]["tuned"] == ["kp", "kd"]
    task, _ = tuning_task(load_rig("hmb_free"), [], ("kp", "kd"), None, {"kp": (4000.0, 9000.0)})
    assert task.box.low.tolist() == [4000.0, 1.0] and task.box.high.tolist() == [9000.0, 20.0]


@pytest.mark.slow
def test_the_block_that_it_proposes_is_read_back_and_a_stop_gives_gains(tmp_path):
    recorded(tmp_path)
    data_file = tmp_path / "a.json"
    text = run("--campaign", tmp_path / "campaign.toml", "--tune", "kp", "--tune", "kd", "--json", data_file)
    data = json.loads(data_file.read_text())
    one = data["sets"][0]
    assert one["shown"]["margins"]["peak_sensitivity"] == pytest.approx(2.2, abs=0.6) and one["failed"] is None
    assert abs(data["identified"]["parameters"]["mass"]["value"] / 0.08012 - 1) < 0.01
    assert "Identified rig" in text
    assert data["next"]["ki"] == 2000.0 if data["next"] else data["keep"]["ki"] == 2000.0
    page = (tmp_path / "tune" / "tune.html").read_text()
    assert "Sensitivity of the loop" in page and "What the recordings showed" in page
    run("--campaign", tmp_path, "--budget", 1, "--json", data_file)
    stopped = json.loads(data_file.read_text())
    assert "budget" in stopped["stop"] and stopped["keep"]["kp"] == 8000.0
    assert tomllib.loads((tmp_path / "tune" / "next.toml").read_text())["gains"] == stopped["keep"]


def test_a_touchdown_is_said_and_its_gains_are_not_kept(tmp_path):
    text = run("--campaign", recorded(tmp_path, touching), "--json", tmp_path / "a.json")
    data = json.loads((tmp_path / "a.json").read_text())
    assert "touchdown: the displacement reaches 103%" in data["sets"][0]["failed"]
    assert "STOP" in text and data["keep"] is None


def test_a_rotor_that_falls_is_a_failed_set(tmp_path):
    def fallen(dataset):
        y = dataset.displacement.copy()
        y[len(y) // 4 :] = 0.35e-3
        return dataset.assign(displacement=y)

    text = run("--campaign", recorded(tmp_path, fallen), "--json", tmp_path / "a.json")
    data = json.loads((tmp_path / "a.json").read_text())
    assert "levitation is lost" in data["sets"][0]["failed"] and data["keep"] is None and "STOP" in text


def test_a_clipped_channel_is_a_failed_set(tmp_path):
    def clipped(d):
        return d.assign(command=d.command.clip(-0.4 * float(d.command.max()), 0.4 * float(d.command.max())))

    run("--campaign", recorded(tmp_path, clipped), "--json", tmp_path / "a.json")
    assert "clipped at" in json.loads((tmp_path / "a.json").read_text())["sets"][0]["failed"]


def clipped_force(d):
    return d.assign(force=d.force.clip(-0.5 * float(d.force.max()), 0.5 * float(d.force.max())))


def test_a_clipped_force_sensor_is_left_out_and_says_nothing_of_the_gains(tmp_path):
    """Of a force that drives the rotor the sensor clips, not the loop: it had condemned the gains for ever."""
    text = run("--campaign", recorded(tmp_path, clipped_force, same), "--json", tmp_path / "a.json")
    assert "1 of 10 recordings, and 1 left out, which does not count" in text
    data = json.loads((tmp_path / "a.json").read_text())
    assert [one["recordings"] for one in data["sets"]] == [["run2.npz"]] and data["sets"][0]["failed"] is None
    assert data["left_out"][0]["recording"] == "run1.npz" and "'force'" in data["left_out"][0]["reason"]


def test_gains_that_held_once_have_not_failed_and_the_failure_is_told(tmp_path):
    run("--campaign", recorded(tmp_path, touching, same), "--json", tmp_path / "a.json")
    data = json.loads((tmp_path / "a.json").read_text())
    assert data["sets"][0]["failed"] is None and data["sets"][0]["shown"]["margins"]
    assert any("run1.npz: touchdown" in note for note in data["notes"])


def test_a_probe_that_counts_from_elsewhere_is_left_out(tmp_path):
    def far(dataset):
        return dataset.assign(displacement=dataset.displacement + 1e-3)

    run("--campaign", recorded(tmp_path, far, same), "--json", tmp_path / "a.json")
    assert "its offset" in json.loads((tmp_path / "a.json").read_text())["left_out"][0]["instead"]


def test_the_next_recording_keeps_the_channels_of_the_last(tmp_path):
    recorded(tmp_path)
    toml = (tmp_path / "campaign.toml").read_text()
    toml = toml.replace(
        'displacement = { from = "displacement" }', 'displacement = { from = "displacement", scale = 2.0 }'
    )
    (tmp_path / "campaign.toml").write_text(toml)
    campaign = load_campaign(tmp_path)
    block = toml_block(next_step(campaign.rig, []), campaign)
    (tmp_path / "run2.npz").write_bytes((tmp_path / "run1.npz").read_bytes())
    (tmp_path / "campaign.toml").write_text(toml + "\n" + block)
    again = load_campaign(tmp_path)
    assert again.recordings[1].file == "run2.npz" and again.recordings[1].channels == again.recordings[0].channels
    assert again.recordings[1].excitations == with_defaults(load_rig("hmb_free")).protocol.excitations


def test_the_next_recording_keeps_speed_and_form_of_the_last(tmp_path):
    campaign = load_campaign(recorded(tmp_path))
    layout = TextLayout(separator=";", decimal=",")
    last = replace(campaign.recordings[-1], layout=layout, speed_rpm=1200.0)
    block = toml_block(next_step(campaign.rig, []), replace(campaign, recordings=(last,)))
    (table,) = tomllib.loads(block)["recording"]
    assert table["format"] == {"separator": ";", "decimal": ","} and table["speed_rpm"] == 1200.0
    (plain,) = tomllib.loads(toml_block(next_step(campaign.rig, []), campaign))["recording"]
    assert not {"format", "speed_rpm"} & plain.keys()


def test_a_recording_without_gains_is_left_out_and_the_others_are_used(tmp_path):
    recorded(tmp_path, touching)
    toml = (tmp_path / "campaign.toml").read_text()
    (tmp_path / "run2.npz").write_bytes((tmp_path / "run1.npz").read_bytes())
    head, table = toml.split("[[recording]]")
    second = re.sub(r"\[recording\.gains\]\n(\w+ = .*\n)+", "", table.replace("run1", "run2"))
    (tmp_path / "campaign.toml").write_text(f"{head}[[recording]]{table}\n[[recording]]{second}")
    text = run("--campaign", tmp_path, "--json", tmp_path / "a.json")
    data = json.loads((tmp_path / "a.json").read_text())
    assert [one["recording"] for one in data["left_out"]] == ["run2.npz"] and len(data["sets"]) == 1
    assert "left out" in text and "no gains are stated" in text
    assert "no gains are stated" in (tmp_path / "tune" / "tune.html").read_text()


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("--rig", "hmb_free"), "--rig: not with --campaign"),
        (("--goal", "peak_sensitivity >= 3"), "is a limit of the form <="),
        (("--method", "de", "--effect", "delay=1e-5"), "--method, --effect: not with --campaign"),
        (("--tune", "kq"), "no gain 'kq'"),
    ],
)
def test_options_that_mean_nothing_are_refused(tmp_path, arguments, words):
    (tmp_path / "campaign.toml").write_text(HEAD + 'rig = "hmb_free"\n')
    assert words in run("--campaign", tmp_path, *arguments, code=2)
    assert not (tmp_path / "tune").exists()


def test_campaigns_of_no_use_are_refused(tmp_path):
    assert "two lines" in run("--campaign", tmp_path, code=2)
    (tmp_path / "campaign.toml").write_text(HEAD)
    assert "rig is missing" in run("--campaign", tmp_path, code=2)
    (tmp_path / "campaign.toml").write_text(HEAD + 'rig = "pedestal"\n')
    assert "no controlled magnet" in run("--campaign", tmp_path, code=2)
    (tmp_path / "campaign.toml").write_text(HEAD + 'rig = "hmb_radial"\n')
    assert "two axes" in run("--campaign", tmp_path, code=2)


def test_a_recording_without_gains_is_refused(tmp_path):
    recorded(tmp_path)
    path = tmp_path / "campaign.toml"
    toml = path.read_text()
    start, end = toml.index("[recording.gains]"), toml.index("[[recording.excitation]]")
    path.write_text(toml[:start] + toml[end:])
    assert "no gains are stated" in run("--campaign", tmp_path, code=2)
