"""`maglev selfsense record` and `estimate` as a user runs them: what was simulated comes back, faults are flagged."""

import json
from dataclasses import replace
from functools import partial
from importlib import resources
from pathlib import Path

import numpy as np
import pytest
from command_line import maglev
from scipy.io import savemat

from maglev_env.design.defaults import with_defaults
from maglev_env.recordings.campaign import load_campaign
from maglev_env.recordings.recording import read_recording
from maglev_env.rig.rig_file import load_rig
from maglev_env.rig.self_sensor import rig_sensors
from maglev_workbench.commands.selfsense.record.recording import Motion, recorded_coil
from selfsense.design import design_pi
from selfsense.simulate import simulate

run = partial(maglev, "selfsense")
GAP, RATE = 0.35e-3, 262.5e3
MOTION = Motion(100.0, 50e-6, 0.1, 0.1)
SENSOR = rig_sensors(with_defaults(load_rig("hmb_free")))[0]
HEAD = 'schema = "maglev-campaign/1"\n'


def estimated(folder, *arguments):
    """JSON, page and estimated gaps of `estimate`."""
    text = run("estimate", *arguments, "--out", folder / "e.html", "--json", folder / "e.json")
    data = json.loads((folder / "e.json").read_text())
    gaps = [dict(np.load(r["estimate"])) for r in data["recordings"]]
    return data, (folder / "e.html").read_text(), gaps, text


def recording(file, channels, rest=""):
    lines = [f'[[recording]]\nfile = "{file}"\nsample_rate = {RATE}\nexcitation = {{ kind = "none" }}\n{rest}']
    lines += ["[recording.channels]"] + [f'{name} = {{ from = "{name}" }}' for name in channels]
    return "\n".join(lines) + "\n"


@pytest.fixture(scope="module")
def coil():
    dataset = recorded_coil(SENSOR, MOTION, 0)
    return {str(name): dataset[name].values for name in dataset.data_vars}


@pytest.fixture
def campaign(tmp_path, coil):
    """A function that writes a campaign of one recording with changed channels."""

    def write(rig="hmb_free", rest="", **changed):
        channels = {n: v for n, v in {**coil, **changed}.items() if v is not None}
        np.savez(tmp_path / "coil.npz", **channels)
        (tmp_path / "campaign.toml").write_text(f'{HEAD}rig = "{rig}"\n' + recording("coil.npz", channels, rest))
        return tmp_path

    return write


def test_a_strong_drive_is_not_taken_for_the_switching(campaign, tmp_path):
    t = (np.arange(26_250) + 1) / RATE
    gap = GAP + 30e-6 * np.sin(2 * np.pi * 100 * t)
    sensed = simulate([SENSOR], gap, 0.5 * np.sin(2 * np.pi * 2000 * t))
    folder = campaign(current=sensed.current[0], voltage=24 * sensed.switching[0], displacement=GAP - gap)
    (found,) = estimated(tmp_path, folder)[0]["recordings"]
    assert found["pwm_frequency"] == pytest.approx(25e3, abs=10)
    assert found["valid_share"] > 0.9 and found["comparison"]["rms"] < 3e-6


@pytest.mark.parametrize("data_format", ["npz", "mat", "csv"])
def test_a_recorded_coil_reads_back_bit_for_bit(tmp_path, data_format):
    options = ["--seconds", 0.02, "--seed", 4, "--frequency", 150, "--duty-swing", 0.05, "--format", data_format]
    text = run("record", *options, "--out", tmp_path / "c", "--json", tmp_path / "r.json")
    assert "5250 samples" in text and "262.5 kHz, 12 bits over ±5 A, 2 mA rms noise" in text
    campaign = load_campaign(tmp_path / "c")
    spec = campaign.recordings[0]
    assert campaign.rig == load_rig("hmb_free") and spec.sample_rate == RATE and spec.gains is None
    assert [e.kind for e in spec.excitations] == ["none"] and spec.intersample is None
    read = read_recording(campaign, spec)
    written = recorded_coil(SENSOR, Motion(150.0, 50e-6, 0.05, 0.02), 4)
    assert list(read.data_vars) == ["current", "voltage", "displacement"]
    for name in (*read.data_vars, "time"):
        assert read[name].values.tobytes() == written[name].values.tobytes()
        assert read[name].attrs == written[name].attrs
    summary = json.loads((tmp_path / "r.json").read_text())
    assert summary["schema"] == "maglev-selfsense-record/1" and summary["seed"] == 4
    assert summary["samples"] == 5250 and summary["sample_rate"] == RATE


def test_the_recording_is_the_simulated_coil(coil):
    t = (np.arange(26_250) + 1) / RATE
    gap = GAP + 50e-6 * np.sin(2 * np.pi * 100 * t)
    sensed = simulate([SENSOR], gap, 0.2 * np.cos(2 * np.pi * 100 * t))
    assert np.array_equal(coil["current"], sensed.current[0]) and np.array_equal(coil["displacement"], GAP - gap)
    assert np.array_equal(coil["voltage"], 24 * sensed.switching[0]) and np.abs(coil["voltage"]).max() <= 24 + 1e-9


def test_record_and_estimate_agree_with_the_simulation(tmp_path, coil):
    run("record", "--out", tmp_path / "c")
    data, page, gaps, text = estimated(tmp_path, tmp_path / "c")
    assert data["schema"] == "maglev-selfsense-estimate/1" and data["rig"] == "hmb_free"
    assert data["settings"] == {"source": str(tmp_path / "c"), "voltage_sampling": "mean"}
    (found,) = data["recordings"]
    valid = np.isfinite(gaps[0]["gap"])
    t = (np.arange(26_250) + 1) / RATE
    drive = 0.2 * np.cos(2 * np.pi * 100 * t)
    sensed = simulate([SENSOR], GAP - coil["displacement"], drive).estimate[0]
    assert np.abs(gaps[0]["gap"] - sensed)[valid].max() < 20e-9
    error = (gaps[0]["gap"] - GAP + coil["displacement"])[valid]
    assert found["comparison"]["rms"] == pytest.approx(np.sqrt(np.mean(error**2)))
    assert found["comparison"]["rms"] == pytest.approx(1.5e-6, rel=0.1) and abs(found["comparison"]["bias"]) < 0.1e-6
    line = np.polyfit(-coil["displacement"][valid], gaps[0]["gap"][valid] - GAP, 1)
    assert [found["comparison"][n] for n in ("gain", "offset")] == pytest.approx(line)
    assert found["pwm_frequency"] == 25e3 and found["samples"] == 26_250 and found["sample_rate"] == RATE
    assert found["kp"] == SENSOR.estimator.kp and found["ki"] == SENSOR.estimator.ki
    assert found["valid_share"] == valid.mean() > 0.97
    assert found["stretches"] == [
        {"start": 0, "stop": int((~valid).sum()), "reason": "converging", "from": 0.0, "to": (~valid).sum() / RATE}
    ]
    assert found["gap_mean"] == pytest.approx(gaps[0]["gap"][valid].mean())
    assert found["gap_rms"] == pytest.approx(50e-6 / np.sqrt(2), rel=0.01)
    assert np.allclose(gaps[0]["displacement"][valid], GAP - gaps[0]["gap"][valid]) and gaps[0]["time"][1] == 1 / RATE
    assert "98.28" in text and "coil.npz: 0.000 to 1.722 ms: converging" in text and "lag counted" in text
    assert page.count('class="plotly-graph-div"') == 2 and "no gap: converging" in page and "98.28 %" in page


def test_one_file_with_scaled_columns_says_the_same_as_a_campaign(tmp_path, coil):
    run("record", "--out", tmp_path / "c")
    expected = estimated(tmp_path, tmp_path / "c")[2][0]["gap"]
    columns = {"i": 10 * coil["current"], "u": coil["voltage"] / 24}
    np.savetxt(tmp_path / "o.csv", np.column_stack(list(columns.values())), "%.17g", ",", header="i,u", comments="")
    savemat(tmp_path / "o.mat", columns, oned_as="column")
    for file in ("o.csv", "o.mat"):
        options = ["--rate", RATE, "--current", "i*0.1", "--voltage", "u*24"]
        data, page, gaps, _ = estimated(tmp_path, tmp_path / file, *options)
        assert np.allclose(gaps[0]["gap"], expected, rtol=1e-9, equal_nan=True)
        assert data["recordings"][0]["comparison"] is None and data["recordings"][0]["file"] == file
        assert "recorded gap" not in page
        # A gap is proportional to the coil's constants: whose they are goes with the result.
        sensor = data["recordings"][0]["sensor"]
        assert sensor["coil"]["turns"] == SENSOR.coil.turns and sensor["coil"]["pole_area"] == SENSOR.coil.pole_area
        (assumed,) = data["notes"]
        assert assumed.startswith("no rig is named: the coil of hmb_free is assumed") and assumed in page
    named, page, *_ = estimated(tmp_path, tmp_path / "o.mat", *options, "--rig", "hmb_free")
    assert named["notes"] == [] and "no rig is named" not in page


def test_faults_are_flagged_and_left_out_of_the_gap(tmp_path, campaign, coil):
    current, voltage = coil["current"].copy(), coil["voltage"].copy()
    fault = slice(8000, 9000)
    voltage[fault], current[fault] = 24.0, current[8000] + 0.002 * np.random.default_rng(0).standard_normal(1000)
    data, page, gaps, text = estimated(tmp_path, campaign(current=current, voltage=voltage))
    (found,) = data["recordings"]
    assert np.isnan(gaps[0]["gap"][8100:9000]).all() and np.isfinite(gaps[0]["gap"][[7800, 10_000]]).all()
    (stretch,) = [s for s in found["stretches"] if s["reason"] == "no ripple"]
    assert 7800 < stretch["start"] < 8050 and 9000 <= stretch["stop"] < 9200
    assert {s["reason"] for s in found["stretches"]} >= {"converging", "no ripple"}
    samples = sum(s["stop"] - s["start"] for s in found["stretches"] if s["reason"] == "converging")
    assert found["reasons"]["converging"] == pytest.approx(samples / 26_250)
    # What remains is as good as without the fault.
    assert found["comparison"]["rms"] == pytest.approx(1.5e-6, rel=0.1)
    assert (
        "no gap: no ripple" in page
        and "no ripple" in text
        and found["valid_share"] == np.isfinite(gaps[0]["gap"]).mean()
    )


def test_a_clipped_current_is_flagged_not_refused(tmp_path, campaign, coil):
    source = resources.files("maglev_env") / "rigs" / "hmb_free.toml"
    rig = tmp_path / "rig.toml"
    rig.write_text(source.read_text() + "\n[self_sensing]\ncurrent_range = 2.2\n")
    folder = campaign(rig="rig.toml", current=np.clip(coil["current"], -2.2, 2.2))
    data, _, gaps, _ = estimated(tmp_path, folder)
    clipped = np.abs(coil["current"]) >= 2.2
    assert clipped.mean() > 0.05 and np.isnan(gaps[0]["gap"][clipped]).all()
    assert data["recordings"][0]["reasons"]["current clipped"] > 0.3
    assert data["recordings"][0]["comparison"]["rms"] < 2e-6
    # An ideal converter does not clip, and what is cut off then shows as a wrong gap.
    rig.write_text(source.read_text() + "\n[self_sensing]\nadc_bits = 0\n")
    assert "current clipped" not in estimated(tmp_path, folder)[0]["recordings"][0]["reasons"]


def test_what_lies_between_current_and_channel_is_undone(tmp_path, campaign, coil):
    late = 3
    for stated, current in (
        ("polynomial = [-1.0, 2.0]", coil["current"] / 2 + 0.5),
        (f"delay = {late / RATE}", np.roll(coil["current"], late)),
    ):
        folder = campaign(current=current)
        file = folder / "campaign.toml"
        file.write_text(file.read_text().replace('from = "current"', f'from = "current", {stated}'))
        (found,) = estimated(tmp_path, folder)[0]["recordings"]
        assert found["gap_mean"] == pytest.approx(GAP, rel=0.01) and found["valid_share"] > 0.95
        assert found["comparison"]["rms"] == pytest.approx(1.5e-6, rel=0.1)


def test_lost_rows_cost_what_lies_beside_them(tmp_path, campaign, coil):
    stamped = {**coil, "time": np.arange(26_250) / RATE}
    kept = np.delete(np.arange(26_250), [9000, *range(15_000, 15_040)])
    data, page, gaps, text = estimated(tmp_path, campaign(**{name: v[kept] for name, v in stamped.items()}))
    (found,) = data["recordings"]
    assert found["samples"] == 26_250 and found["comparison"]["rms"] == pytest.approx(1.5e-6, rel=0.1)
    assert 0.9 < found["valid_share"] < 0.98
    assert np.isnan(gaps[0]["gap"][[9000, *range(15_000, 15_040)]]).all()
    assert "samples lost" in found["reasons"] and "samples lost" in text and "no gap: samples lost" in page


def test_a_clipped_probe_costs_no_gap(tmp_path, campaign, coil):
    high = np.quantile(coil["displacement"], 0.995)
    (found,) = estimated(tmp_path, campaign(displacement=np.minimum(coil["displacement"], high)))[0]["recordings"]
    assert found["valid_share"] > 0.97 and list(found["reasons"]) == ["converging"]


def test_both_axes_of_an_xy_recording_from_start_on(tmp_path, campaign, coil):
    other = recorded_coil(SENSOR, Motion(60.0, 30e-6, 0.05, 0.1), 1)
    both = {f"{name}_x": coil[name] for name in coil} | {f"{name}_y": other[name].values for name in coil}
    nothing = dict.fromkeys(coil)
    folder = campaign("hmb_radial", "start = 1000\nsamples = 20000", **both, **nothing)
    data, page, gaps, text = estimated(tmp_path, folder)
    assert [(r["axis"], r["samples"]) for r in data["recordings"]] == [("x", 20_000), ("y", 20_000)]
    assert [Path(r["estimate"]).name for r in data["recordings"]] == ["e-coil-x.npz", "e-coil-y.npz"]
    for gap, name, rms in zip(gaps, ("displacement_x", "displacement_y"), (1.5e-6, 1.15e-6), strict=True):
        error = gap["gap"] - (GAP - both[name][1000:21_000])
        assert np.sqrt(np.nanmean(error**2)) == pytest.approx(rms, rel=0.1)
    assert "coil.npz, y" in text and "coil.npz, x: gap" in page


def test_instants_of_the_voltage(tmp_path):
    rate = 1e6
    fast = replace(SENSOR, acquisition=replace(SENSOR.acquisition, rate=rate))
    current = recorded_coil(fast, Motion(100.0, 1e-9, 0.0, 0.03), 0)["current"].values
    t = (np.arange(current.size) + 1) / rate
    np.savez(tmp_path / "p.npz", current=current, voltage=np.where((t * 25e3) % 1 < 0.5, 24.0, -24.0))
    options = [tmp_path / "p.npz", "--rate", rate, "--point-voltage"]
    data = estimated(tmp_path, *options)[0]
    assert data["settings"]["voltage_sampling"] == "point"
    assert data["recordings"][0]["gap_mean"] == pytest.approx(GAP, rel=0.01)
    # The gains are those for this rate, not the rig's.
    found = design_pi(replace(fast, coil=fast.estimator.coil), at=4000.0)
    assert data["recordings"][0]["kp"] == pytest.approx(found.kp, rel=1e-3) != SENSOR.estimator.kp
    np.savez(tmp_path / "s.npz", current=current[::5], voltage=np.where((t[::5] * 25e3) % 1 < 0.5, 24.0, -24.0))
    text = run("estimate", tmp_path / "s.npz", "--rate", 200e3, "--point-voltage", "--out", tmp_path / "q.html", code=2)
    assert "misplaces its edges" in text


def test_what_looks_odd_is_said(tmp_path, campaign, coil):
    data, page, _, text = estimated(
        tmp_path, campaign(voltage=0.7 * coil["voltage"], displacement=-coil["displacement"])
    )
    (found,) = data["recordings"]
    assert found["gap_mean"] == pytest.approx(GAP / 0.7, rel=0.02) and found["comparison"]["gain"] < 0
    for words in ("the voltage reaches 16.8 V, the rig", "its sign is reversed"):
        assert words in text and words in page and any(words in note for note in found["notes"])
    slow = replace(SENSOR, supply=replace(SENSOR.supply, frequency=21e3))
    other = recorded_coil(slow, MOTION, 0)
    found = estimated(tmp_path, campaign(**{n: other[n].values for n in coil}))[0]["recordings"][0]
    assert found["pwm_frequency"] == pytest.approx(21e3, abs=10) and "switches at 21 kHz" in found["notes"][0]


def test_a_stated_inductance_that_is_not_counted_on_is_said(tmp_path, campaign):
    text = (resources.files("maglev_env") / "rigs" / "hmb_free.toml").read_text()
    (tmp_path / "mine.toml").write_text(text.replace("coil_inductance = 0.57e-3", "coil_inductance = 1.0e-3"))
    data, page, _, told = estimated(tmp_path, campaign(), "--rig", tmp_path / "mine.toml")
    for words in ("states a coil_inductance of 1 mH", "counts on the 0.571 mH"):
        assert words in told and any(words in note for note in data["recordings"][0]["notes"])
        assert page.count(words) == 2
    assert "coil_inductance" not in estimated(tmp_path, campaign())[3]


def test_a_wrong_rate_shows_in_the_pwm_frequency(tmp_path, coil):
    np.savez(tmp_path / "coil.npz", **coil)
    text = run("estimate", tmp_path / "coil.npz", "--rate", 100e3, "--out", tmp_path / "k.html", code=2)
    assert "switches at 9.524 kHz" in text and "check the rate" in text and not (tmp_path / "k.html").exists()


def test_several_recordings_and_the_rig_of_the_command_line(tmp_path, coil):
    for folder in ("a", "b"):
        (tmp_path / folder).mkdir()
        np.savez(tmp_path / folder / "coil.npz", **coil)
    text = "".join(recording(f"{f}/coil.npz", coil) for f in "ab")
    (tmp_path / "campaign.toml").write_text(HEAD + text)
    data, page, gaps, text = estimated(tmp_path, tmp_path / "campaign.toml", "--rig", "hmb_radial")
    assert data["rig"] == "hmb_radial" and len(gaps) == 2 and np.array_equal(*(g["gap"] for g in gaps), equal_nan=True)
    assert [Path(r["estimate"]).name for r in data["recordings"]] == ["e-a-coil.npz", "e-b-coil.npz"]
    assert "2 coils: 98.28 to 98.28 % of their samples carry a gap" in text and "a/coil.npz: gap" in page


@pytest.mark.parametrize(
    ("changed", "words"),
    [
        ({"voltage": None}, "coil.npz: there is a channel current, but no voltage"),
        ({"current": None}, "coil.npz: there is a channel voltage, but no current"),
        ({"current": None, "voltage": None}, "coil.npz: there are no channels current and voltage"),
        ({"current": np.ones(26_000)}, "column 'current' has 26000 samples, column 'voltage' 26250"),
        ({"current": np.zeros(26_250)}, "coil.npz: no sample of 26250 carries a gap: 'no ripple'"),
        ({"voltage": np.zeros(26_250)}, "coil.npz: voltage: no switching stands out"),
        ({"voltage": np.full(26_250, np.nan)}, "coil.npz: column 'voltage': 26250 of 26250 values are no numbers"),
        ({"current": np.full(26_250, np.nan)}, "coil.npz: column 'current': 26250 of 26250 values are no numbers"),
        ({"rest": "start = 30000"}, "coil.npz: start = 30000 go beyond"),
        ({"rig": "pedestal"}, "no coil whose inductance follows the gap"),
    ],
)
def test_bad_recordings_end_with_one_message_and_code_2(tmp_path, campaign, changed, words):
    text = run("estimate", campaign(**changed), "--out", tmp_path / "e.html", code=2)
    assert words in text and text.startswith("maglev:") and not (tmp_path / "e.html").exists()


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["estimate", "c.npz"], "--rate HZ"),
        (["estimate", "c.npz", "--rate", "-1"], "--rate HZ"),
        (["estimate", "c.npz", "--rate", "20000"], "below twice the PWM frequency of rig hmb_free, 25000 Hz"),
        (["estimate", "c.npz", "--rate", "262500", "--current", "amps"], "there is no column 'amps'"),
        (["estimate", "c.npz", "--rate", "262500", "--current", "current*x"], "write name or name*scale"),
        (["estimate", "c.npz", "--rate", "262500", "--voltage", "voltage*0"], "a number other than zero"),
        (["estimate", "c.npz", "--rate", "262500", "--out", "c.html"], "would overwrite the recording"),
        (["estimate", "c.npz", "--rate", "262500", "--rig", "missing.toml"], "missing.toml"),
        (["estimate", ".", "--rate", "262500"], "the campaign . states its own"),
        (["record", "--amplitude", "4e-4"], "--amplitude 0.0004 m"),
        (["record", "--duty-swing", "0.6"], "use 0 to 0.5"),
        (["record", "--frequency", "-3"], "--frequency -3 Hz"),
        (["record", "--seconds", "11"], "use up to 10"),
    ],
)
def test_bad_options_end_with_one_message_and_code_2(arguments, words, tmp_path, monkeypatch, coil):
    monkeypatch.chdir(tmp_path)
    np.savez("c.npz", **coil)
    Path("campaign.toml").write_text(HEAD + recording("c.npz", coil))
    before = set(tmp_path.iterdir())
    text = run(*arguments, code=2)
    assert words in text and text.startswith("maglev:") and set(tmp_path.iterdir()) == before
