"""Runs whose channels lie in files of their own."""

import tomllib

import h5py
import numpy as np
import pytest
import scipy
from command_line import maglev

from maglev_env.recordings.files import read_columns
from maglev_workbench.commands.new.joined import runs_of_file


def instruments(folder, run, rate, other, offset=0.0):
    t = np.arange(int(4 * rate)) / rate
    slow = np.arange(int(4 * other)) / other + offset
    gap = 4 + 0.1 * np.sin(2 * np.pi * 3 * t)
    current = 1.2 + 0.1 * np.cos(2 * np.pi * 3 * slow)
    np.savetxt(folder / f"{run}_laser.csv", np.c_[t, gap], "%.7f", ",", header="time_s,laser_mm", comments="")
    np.savetxt(folder / f"{run}_amp.csv", np.c_[slow, current], "%.7f", ",", header="time_s,current_A", comments="")
    return slow, current


def test_files_of_one_run_are_joined_at_the_slower_rate_and_said(tmp_path):
    slow, current = instruments(tmp_path, "run1", 2000.0, 800.0)
    instruments(tmp_path, "run2", 2000.0, 800.0)
    result = maglev("new", tmp_path)
    assert "Read 2 of 2 file(s)" in result and "run1_laser.csv (2000 Hz)" in result
    joined = read_columns(tmp_path / "run1_joined.csv")
    assert joined.names == ("time [s]", "laser_mm", "current_A")
    np.testing.assert_allclose(joined.column("current_A"), current, atol=1e-6)
    np.testing.assert_allclose(joined.column("laser_mm"), 4 + 0.1 * np.sin(2 * np.pi * 3 * slow), atol=1e-5)
    again = maglev("new", tmp_path, "--force")
    assert "Read 2 of 2 file(s)" in again
    assert "check" in maglev("check", tmp_path)


def test_a_joined_clock_that_counts_from_1970_keeps_its_rate(tmp_path):
    t = 1.7e9 + np.arange(2000) / 1000.0
    for name, column in (("laser_mm", 4 + 0.1 * np.sin(20 * t)), ("current_A", 1.2 + 0.1 * np.cos(20 * t))):
        head = f"time_s,{name}"
        np.savetxt(tmp_path / f"run1_{name[:5]}.csv", np.c_[t, column], "%.6f", ",", header=head, comments="")
    maglev("new", tmp_path)
    joined = read_columns(tmp_path / "run1_joined.csv")
    np.testing.assert_array_equal(joined.column("time [s]"), np.round(t, 6))
    (recording,) = tomllib.loads((tmp_path / "campaign.toml").read_text())["recording"]
    assert recording["sample_rate"] == 1000.0


def test_clocks_that_do_not_overlap_are_not_joined(tmp_path):
    instruments(tmp_path, "run1", 1000.0, 1000.0, offset=100.0)
    output = maglev("new", tmp_path)
    assert "Read 1 of 2 file(s)" in output and "copy its columns" in output.replace("\n", "")


def channels_of(folder):
    (recording,) = tomllib.loads((folder / "campaign.toml").read_text())["recording"]
    return recording["channels"]


def test_what_is_stated_of_a_column_holds_in_a_run_of_several_files(tmp_path):
    instruments(tmp_path, "run1", 2000.0, 800.0)
    stated = ("--scale", "laser=0.002", "--zero", "laser=4")
    maglev("new", tmp_path, *stated)
    assert channels_of(tmp_path)["displacement"] == {"from": "laser_mm", "scale": 0.002, "offset": -0.008}
    assert "there are time, laser, current" in maglev("new", tmp_path, "--force", "--scale", "laser_1=0.002", code=2)


def test_columns_of_one_name_keep_that_of_their_group_and_the_clock_its_rate(tmp_path):
    rng = np.random.default_rng(4)
    slow, fast = np.arange(4000) / 1e3, np.arange(40000) / 1e4
    gap = 8 + 0.2 * np.convolve(rng.normal(size=4000), np.full(50, 1 / 50), "same")
    current = 1 + 0.3 * (np.interp(fast, slow, gap) - 8)
    with h5py.File(tmp_path / "run.h5", "w") as file:
        for group, time, values in (("position", slow, gap), ("current", fast, current), ("command", fast, current)):
            file[f"{group}/time"], file[f"{group}/value"] = time, values
    text = maglev("new", tmp_path, "--rate", "10000")
    assert "position value (1000 Hz)" in " ".join(text.split())
    channels = channels_of(tmp_path)
    assert {name: channels[name]["from"] for name in ("displacement", "current", "command")} == {
        "displacement": "position value", "current": "current value", "command": "command value"
    }  # fmt: skip
    assert "sample_rate = 1000.0" in (tmp_path / "campaign.toml").read_text()


def test_texts_of_a_file_stay_in_their_place_of_a_joined_table(tmp_path):
    t, fast = np.arange(2000) / 1e3, np.arange(20000) / 1e4
    odd = 'the gap,\n"of" the\trotor ' + 300 * "x"
    with h5py.File(tmp_path / "run.h5", "w") as file:
        for name, values, attributes in (
            ("slow/time", t, {"units": "s"}),
            ("slow/gap", 8 + 0.2 * np.sin(9 * t), {"units": "mm", "long_name": odd}),
            ("fast/time", fast, {"units": "s"}),
            ("fast/current", 1 + 0.1 * np.sin(9 * fast), {"units": "A"}),
        ):
            file.create_dataset(name, data=values).attrs.update(attributes)
    maglev("new", tmp_path)
    names = read_columns(tmp_path / "run_joined.csv").names
    assert len(names) == 3 and names[1].startswith('gap the gap, "of" the rotor xxx') and len(names[1]) < 100
    assert channels_of(tmp_path)["displacement"]["from"] == names[1]


def test_a_file_of_two_rasters_becomes_one_run(tmp_path):
    """The motion at 1 kHz beside the currents at 10 kHz, each group with a time of its own."""
    rng = np.random.default_rng(4)
    slow, fast = np.arange(4000) / 1e3, np.arange(40000) / 1e4
    gap = 8 + 0.2 * np.convolve(rng.normal(size=4000), np.full(50, 1 / 50), "same")
    with h5py.File(tmp_path / "run.h5", "w") as file:
        for group, columns in (
            ("slow", {"time": (slow, "s"), "gap": (gap, "mm")}),
            ("fast", {"time": (fast, "s"), "coil_current": (1 + 0.3 * (np.interp(fast, slow, gap) - 8), "A")}),
        ):
            for name, (values, unit) in columns.items():
                file.create_dataset(f"{group}/{name}", data=values).attrs["units"] = unit
    for again in ((), ("--force",)):  # what was joined is not taken for another run
        text = maglev("new", tmp_path, *again)
        assert "joined on their clocks, at the 1000" in " ".join(text.split()) and "Read 1 of 1" in text
    (recording,) = tomllib.loads((tmp_path / "campaign.toml").read_text())["recording"]
    assert recording["file"] == "run_joined.csv" and recording["sample_rate"] == 1000.0
    assert {"displacement", "current"} <= recording["channels"].keys()


@pytest.mark.parametrize(
    ("names", "count"), [(("run1", "run2", "run3"), 3), (("axis1", "axis2"), 1), (("up", "down"), 1)]
)
def test_every_run_of_a_file_becomes_a_recording_and_an_axis_does_not(tmp_path, names, count):
    rng, t = np.random.default_rng(5), np.arange(3000) / 1e3
    with h5py.File(tmp_path / "all.h5", "w") as file:
        for i, name in enumerate(names):
            moved = np.convolve(rng.normal(size=t.size), np.full(30, 1 / 30), "same")
            for column, values, unit in (("t", t, "s"), ("pos", moved, "mm"), ("i_coil", 0.1 * (i + 1) * moved, "A")):
                file.create_dataset(f"{name}/{column}", data=values).attrs["units"] = unit
    for again in ((), ("--force",)):
        assert f"Read {count} of {count} file(s)" in maglev("new", tmp_path, *again)
    recordings = tomllib.loads((tmp_path / "campaign.toml").read_text())["recording"]
    assert len(recordings) == count and all({"displacement", "current"} <= r["channels"].keys() for r in recordings)
    if count > 1:
        assert {r["file"] for r in recordings} == {f"all_{name}_joined.csv" for name in names}


def test_columns_of_one_name_keep_that_of_their_group_in_each_of_several_runs(tmp_path):
    rng, t = np.random.default_rng(5), np.arange(3000) / 1e3
    with h5py.File(tmp_path / "all.h5", "w") as file:
        for run in ("run1", "run2"):
            gap = 8 + 0.2 * np.convolve(rng.normal(size=3000), np.full(50, 1 / 50), "same")
            file[f"{run}/time"] = t
            file[f"{run}/position/value"], file[f"{run}/current/value"] = gap, 1 + 0.3 * (gap - 8)
    runs = runs_of_file(tmp_path / "all.h5")
    assert [[*run.columns] for run in runs] == 2 * [["time [s]", "current value", "position value"]]


def controldesk(clocks, quantities):
    """A capture as ControlDesk writes it: axes X and signals Y, each with its name, unit and raster beside its data."""
    x = [{"Name": f"Time {r}", "Unit": "s", "Raster": r, "Data": t} for r, t in clocks.items()]
    y = [{"Name": f'"{n}"', "Unit": u, "Raster": r, "Data": v} for n, u, r, v in quantities]
    return {"X": np.array(x, dtype=object), "Y": np.array(y, dtype=object)}


def test_names_and_units_beside_the_data_stay_in_a_joined_run(tmp_path):
    rng = np.random.default_rng(4)
    fast, slow = np.arange(8000) / 1e4, np.arange(1600) / 2e3
    gap = np.convolve(rng.normal(size=8000), np.full(50, 1 / 50), "same")
    moved = np.interp(slow, fast, gap)
    signals = (("Position", "um", "fast", 40 * gap), ("Coil current", "mA", "slow", 300 * moved))
    signals += (("Command", "mA", "slow", 310 * moved + 5 * rng.normal(size=1600)),)
    scipy.io.savemat(tmp_path / "rec.mat", {"rec": controldesk({"fast": fast, "slow": slow}, signals)})
    maglev("new", tmp_path)
    names = read_columns(tmp_path / "rec_joined.csv").names
    assert names == ("time [s]", "Position [um]", "Coil current [mA]", "Command [mA]")
    channels = channels_of(tmp_path)
    assert {name: channels[name].get("scale", 1.0) for name in ("displacement", "current", "command")} == {
        "displacement": 1e-6, "current": 1e-3, "command": 1e-3
    }  # fmt: skip


def test_names_and_units_beside_the_data_stay_in_each_run(tmp_path):
    rng, t = np.random.default_rng(5), np.arange(3000) / 1e3
    made = {}
    for run in ("run1", "run2"):
        gap = 30 * np.convolve(rng.normal(size=3000), np.full(50, 1 / 50), "same")
        ch = [{"Name": n, "Unit": u, "Data": v} for n, u, v in (("Position", "um", gap), ("Current", "mA", 9 * gap))]
        made[run] = {"time": t, "ch": np.array(ch, dtype=object)}
    scipy.io.savemat(tmp_path / "all.mat", made)
    runs = runs_of_file(tmp_path / "all.mat")
    assert [[*run.columns] for run in runs] == 2 * [["time [s]", "Position [um]", "Current [mA]"]]
