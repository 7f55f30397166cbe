"""Lengths that are read as metres although their column says another unit, or as counts of a converter."""

import numpy as np
import pytest

from maglev_env.recordings.campaign import load_campaign
from maglev_env.recordings.guess.recording import guess_recording
from maglev_env.redundancy.rules import examine

TIME = np.arange(2000) / 1000.0
SWING = np.sin(2 * np.pi * 4 * TIME) + 0.3 * np.sin(2 * np.pi * 11 * TIME)


def found(folder, column, values, source, channel="displacement", kind="contradiction"):
    np.savetxt(folder / "run.csv", np.column_stack([TIME, values]), "%.6f", ",", header=f"t,{column}", comments="")
    (folder / "campaign.toml").write_text(
        f"""schema = "maglev-campaign/1"
[[recording]]
file = "run.csv"
sample_rate = 1000.0
excitation = {{ kind = "none" }}
[recording.channels]
{channel} = {{ from = "{column}"{source} }}
""",
        encoding="utf-8",
    )
    return [(f.code, f.message) for f in examine(load_campaign(folder)) if f.kind == kind]


@pytest.mark.parametrize("column", ["GapSensor_V", "gap [mm]"])
def test_a_length_in_another_unit_needs_a_scale(tmp_path, column):
    (code, message), *_ = found(tmp_path, column, 0.05 * SWING, "")
    assert code == "unit" and "no scale is stated" in message
    assert not found(tmp_path, column, 0.05 * SWING, ", scale = 1.6e-3")


def test_milliamperes_are_no_amperes_and_a_probe_in_volts_is_looked_at(tmp_path):
    assert found(tmp_path, "i [mA]", 50 * SWING, "", "current")[0][0] == "unit"
    assert not found(tmp_path, "i [mA]", 50 * SWING, ", scale = 1e-3", "current")
    assert not found(tmp_path, "i [V]", 0.05 * SWING, "", "current")
    ((code, message),) = found(tmp_path, "i [V]", 0.05 * SWING, "", "current", "wiring")
    assert code == "unit" and "1 V counts as 1 A; state scale" in message


def test_a_length_in_metres_needs_none(tmp_path):
    assert not found(tmp_path, "gap [m]", 1e-4 * SWING, "")
    assert not found(tmp_path, "gap", 1e-4 * SWING, "")


def test_nothing_levitated_moves_over_metres(tmp_path):
    ((code, message),) = found(tmp_path, "hall", np.rint(400 + 100 * SWING), "")
    assert code == "clearance" and "state the scale of column 'hall'" in message


def test_counts_of_a_converter_are_asked_for_their_scale(tmp_path):
    columns = [5231 + 1000 * TIME, np.rint(400 + 100 * SWING), np.rint(120 + 20 * SWING)]
    np.savetxt(tmp_path / "x.csv", np.column_stack(columns), "%d", ",", header="millis,hall,pwm", comments="")
    guess = guess_recording(tmp_path / "x.csv")
    assert guess.channels["displacement"].ask == "scale in m per count" and guess.channels["displacement"].scale == 1
    assert guess.channels["command"].ask == "scale in A per count"


def test_a_motion_that_no_magnet_makes_is_in_a_smaller_unit(tmp_path):
    swing = np.sin(2 * np.pi * 60 * TIME) + 0.5 * np.sin(2 * np.pi * 90 * TIME)  # 20 mm so fast would be 300 g
    np.savetxt(tmp_path / "x.csv", np.column_stack([TIME, 20 * swing, swing]), "%.6f", ",", header="t,x,i", comments="")
    assert guess_recording(tmp_path / "x.csv").channels["displacement"].scale == 1e-6
    slow = np.sin(2 * np.pi * 2 * TIME)
    np.savetxt(tmp_path / "y.csv", np.column_stack([TIME, 20 * slow, slow]), "%.6f", ",", header="t,x,i", comments="")
    assert guess_recording(tmp_path / "y.csv").channels["displacement"].scale == 1e-3
