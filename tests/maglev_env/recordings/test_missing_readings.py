"""Logs with holes: broken serial lines, empty cells, garbled stamps, values that are no numbers."""

from dataclasses import replace

import numpy as np
import pytest

from maglev_env.recordings.alarms.alarm import alarms_of
from maglev_env.recordings.campaign import load_campaign
from maglev_env.recordings.contents import contents
from maglev_env.recordings.files import read_columns
from maglev_env.recordings.guess.recording import guess_recording
from maglev_env.recordings.masking import masked_samples
from maglev_env.recordings.missing_readings import garbled_stamps
from maglev_env.recordings.recording import read_recording
from maglev_env.recordings.stamped_late import regular_stamps
from maglev_env.redundancy.rules import examine_recording
from maglev_env.rig.excitation import Excitation

SAMPLES, RATE = 1000, 200.0
TIME = 5231 + 5 * np.arange(SAMPLES)  # ms
GAP = 8.0 + 0.5 * np.sin(2 * np.pi * 3 * np.arange(SAMPLES) / RATE)
CURRENT = 0.7 + 0.05 * np.sin(2 * np.pi * 3 * np.arange(SAMPLES) / RATE)


def lines():
    return [f"{t},{y:.4f},{i:.4f}" for t, y, i in zip(TIME, GAP, CURRENT, strict=True)]


def log(folder, rows, name="run.log", header="millis,gap_mm,current_A"):
    (folder / name).write_text("\r\n".join(["Ball levitator v1.3 ready", header, *rows]) + "\r\n", encoding="latin-1")
    return folder / name


def campaign(folder, name, start=""):
    (folder / "campaign.toml").write_text(
        f"""schema = "maglev-campaign/1"
[[recording]]
file = "{name}"
sample_rate = {RATE}
{start}
excitation = {{ kind = "none" }}
[recording.channels]
time = {{ from = "millis", scale = 1e-3 }}
displacement = {{ from = "gap_mm", scale = -1e-3 }}
current = {{ from = "current_A" }}
""",
        encoding="utf-8",
    )
    loaded = load_campaign(folder)
    return loaded, loaded.recordings[0]


def test_broken_lines_are_missing_samples_and_are_said(tmp_path):
    rows = lines()
    rows[100], rows[300], rows[500] = rows[100][:9], rows[300][3:], rows[500].replace("0.", "\xb5", 1)
    rows[700] = "brown-out"
    file = log(tmp_path, rows)
    loaded, spec = campaign(tmp_path, file.name)
    dataset = read_recording(loaded, spec)
    masked = masked_samples(dataset)
    assert set(np.flatnonzero(masked)) == {100, 300, 500, 700} and dataset.sizes["time"] == SAMPLES
    whole = ~masked
    np.testing.assert_allclose(dataset["displacement"].values[whole], -1e-3 * GAP[whole], atol=1e-7)
    np.testing.assert_allclose(dataset["displacement"].values[masked], -1e-3 * GAP[masked], atol=2e-6)
    said = " | ".join(dataset.attrs["notes"])
    assert "2 broken line(s)" in said and "line 103 (sample 100) has 2 values" in said
    assert guess_recording(file).rate.value == RATE


def test_too_many_broken_lines_are_refused_with_the_first(tmp_path):
    rows = lines()
    rows[100:120] = [row[:9] for row in rows[100:120]]
    with pytest.raises(ValueError, match=r"line 103 \(sample 100\) has 2 values"):
        read_columns(log(tmp_path, rows))


def test_blank_lines_need_a_clock(tmp_path):
    rows = lines()
    rows.insert(400, "# button pressed")
    assert any("skipped: line 403" in note for note in read_columns(log(tmp_path, rows)).notes)
    without = [row.partition(",")[2] for row in rows]
    with pytest.raises(ValueError, match=r"line 403.*no column of time"):
        read_columns(log(tmp_path, without, header="gap_mm,current_A"))


def test_few_values_that_are_no_numbers_are_masked_and_many_are_cut(tmp_path):
    rows = lines()
    for j in range(420, 428):
        t, _, i = rows[j].split(",")
        rows[j] = f"{t},NaN,{i}" if j % 2 else f"{t},,{i}"
    loaded, spec = campaign(tmp_path, log(tmp_path, rows).name)
    dataset = read_recording(loaded, spec)
    assert set(np.flatnonzero(masked_samples(dataset))) == set(range(420, 428))
    alarm = examine_recording(loaded, spec)[0]
    assert alarm.kind == "quality" and "'gap_mm': 8 of 1000 values are no numbers, the first at 2.1 s" in alarm.message

    for j in range(420, 440):
        rows[j] = rows[j].partition(",")[0] + ",NaN," + rows[j].rpartition(",")[2]
    loaded, spec = campaign(tmp_path, log(tmp_path, rows, "more.log").name)
    with pytest.raises(ValueError, match=r"20 of 1000 values.*start = 440, samples = 560"):
        read_recording(loaded, spec)
    loaded, spec = campaign(tmp_path, "more.log", "start = 440\nsamples = 560")
    assert not masked_samples(read_recording(loaded, spec)).any()


def test_a_column_with_holes_keeps_its_meaning(tmp_path):
    values = GAP.copy()
    values[50:55] = np.nan
    np.savez(tmp_path / "x.npz", time_s=TIME / 1000, gap_mm=values, current_A=CURRENT)
    guess = guess_recording(tmp_path / "x.npz")
    assert guess.channels["displacement"].column == "gap_mm"
    assert contents(read_columns(tmp_path / "x.npz")).missing == {"gap_mm": 5}


def test_a_stamp_is_garbled_where_its_neighbours_go_on_without_it():
    time = np.arange(20.0)
    time[5], time[9], time[15] = 0.5, 90.0, np.nan
    assert set(np.flatnonzero(garbled_stamps(time))) == {5, 9, 15}
    again = np.r_[np.arange(10.0), np.arange(10.0)]  # a second run: no single stamp is wrong
    assert not garbled_stamps(again).any()


@pytest.mark.parametrize(
    ("stamps", "step"),
    [
        ([f"2024-05-01T23:59:59.{j:03d}Z" for j in range(0, 100, 5)], 5e-3),
        ([f"2024-05-01T12:00:00.{j:03d}+02:00" for j in range(0, 100, 5)], 5e-3),
        ([f"{0.001 * j:g} sec" for j in range(20)], 1e-3),
    ],
)
def test_iso_stamps_and_durations_are_seconds(tmp_path, stamps, step):
    (tmp_path / "x.csv").write_text("Time,y\n" + "".join(f"{t},{j}.5\n" for j, t in enumerate(stamps)))
    np.testing.assert_allclose(np.diff(read_columns(tmp_path / "x.csv").column("Time")), step, atol=1e-9)


def test_json_lines_and_npy_are_columns(tmp_path):
    rows = [
        f'{{"ts": "2024-05-01T12:00:{j / 200:06.3f}Z", "plant": {{"gap": {y:.6f}}}, "i": {i:.4f}, "mode": "AUTO"}}'
        for j, (y, i) in enumerate(zip(GAP, CURRENT, strict=True))
    ]
    rows[300] = rows[300][:20]
    (tmp_path / "x.jsonl").write_text("\n".join(rows) + "\n")
    columns = read_columns(tmp_path / "x.jsonl")
    assert columns.names == ("ts", "plant.gap", "i", "mode")
    gap = columns.column("plant.gap")
    assert np.isnan(gap[300]) and np.isfinite(np.delete(gap, 300)).all()
    np.testing.assert_allclose(np.delete(gap, 300), np.delete(GAP, 300), atol=1e-6)
    np.testing.assert_allclose(np.nanmedian(np.diff(columns.column("ts"))), 1 / RATE)
    with pytest.raises(ValueError, match="'AUTO' in line 1"):
        columns.column("mode")
    assert any("1 broken line(s)" in note and "line 301" in note for note in columns.notes)
    guess = guess_recording(tmp_path / "x.jsonl")
    assert guess.rate.value == RATE and guess.channels["displacement"].column == "plant.gap"

    np.save(tmp_path / "x.npy", np.column_stack([TIME / 1000, GAP, CURRENT]))
    np.testing.assert_array_equal(read_columns(tmp_path / "x.npy").column("array[1]"), GAP)
    np.save(tmp_path / "o.npy", np.array([{"a": 1}], dtype=object), allow_pickle=True)
    with pytest.raises(ValueError, match="truncated or damaged"):
        read_columns(tmp_path / "o.npy")


def test_a_command_at_a_limit_is_used_as_it_stands(tmp_path):
    rng = np.random.default_rng(3)
    command = np.clip(0.7 + 0.2 * rng.normal(size=SAMPLES), 0.0, None)
    command[200:206] = 0.0
    table = np.c_[TIME, GAP, command]
    np.savetxt(tmp_path / "r.csv", table, "%.6f", ",", header="millis,gap_mm,current_A", comments="")
    loaded, spec = campaign(tmp_path, "r.csv")
    as_command = {"command": spec.channels["current"], **{k: v for k, v in spec.channels.items() if k != "current"}}
    for channels, masked in ((spec.channels, 6), (as_command, 0)):
        dataset = read_recording(loaded, replace(spec, channels=channels))
        assert masked_samples(dataset).sum() == masked, list(channels)
        assert any(a.code == "rail" for a in alarms_of(dataset))


@pytest.mark.parametrize("noise", [0.0, 1e-3])
def test_stamps_that_jitter_alone_are_regular_and_true_jitter_is_resampled(noise):
    rng = np.random.default_rng(4)
    regular = np.arange(6000) / RATE
    late = regular + rng.uniform(0, 0.9e-3, regular.size)

    def read(at):
        return np.sin(2 * np.pi * 2.3 * at) + 0.3 * np.sin(2 * np.pi * 11 * at + 1) + noise * rng.normal(size=at.size)

    found = regular_stamps(late, [read(regular)])
    np.testing.assert_allclose(np.diff(found), 1 / RATE, rtol=1e-4)
    assert regular_stamps(late, [read(late)]) is None
    assert regular_stamps(late, [rng.normal(size=late.size)]) is None  # noise does not tell


def test_a_loop_whose_ticks_wander_is_not_taken_for_a_regular_one_with_late_stamps():
    # A slow controller that waits after each tick: what it is late stays, and its readings are coarse.
    rng = np.random.default_rng(5)
    ticks = np.cumsum(0.0204 + rng.uniform(-0.9e-3, 2.1e-3, 2800))
    moved = sum(np.sin(2 * np.pi * f * ticks + f) for f in (0.3, 0.7, 1.9))
    reading = np.round(moved + 0.03 * rng.normal(size=ticks.size), 2)
    assert regular_stamps(np.round(ticks, 3), [reading, np.round(np.gradient(reading), 1)]) is None


@pytest.mark.parametrize(("kind", "severity"), [("none", "warning"), ("multisine", "refuse")])
def test_a_command_that_is_often_at_its_limit_counts_where_it_acts_as_it_was_recorded(tmp_path, kind, severity):
    rng = np.random.default_rng(3)
    command = np.clip(0.7 + 0.5 * rng.normal(size=SAMPLES), 0.0, None)
    np.savetxt(tmp_path / "r.csv", np.c_[TIME, GAP, np.repeat(command[::3], 3)[:SAMPLES]], "%.6f", ",",
               header="millis,gap_mm,current_A", comments="")  # fmt: skip
    loaded, spec = campaign(tmp_path, "r.csv")
    as_command = {"command": spec.channels["current"], **{k: v for k, v in spec.channels.items() if k != "current"}}
    spec = replace(spec, channels=as_command)
    if kind != "none":
        spec = replace(spec, excitations=(Excitation("multisine", "current", RATE / 500, (1, 9), 0.1),))
    dataset = read_recording(loaded, spec, alarmed=True)
    assert [a.severity for a in alarms_of(dataset) if a.code == "rail"] == [severity]
