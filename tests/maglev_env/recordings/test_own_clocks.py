"""Of a file with two times each channel is read at its own; where that is another clock, nothing is paired silently."""

import numpy as np
import pytest

from maglev_env.recordings.campaign import parse_campaign
from maglev_env.recordings.campaign_file import SCHEMA
from maglev_env.recordings.guess.recording import guess_recording
from maglev_env.recordings.own_clocks import own_times
from maglev_env.redundancy.own_clocks import other_clocks
from maglev_env.redundancy.rules import examine

N, RATE = 2000, 10_000.0
T = np.arange(N) / RATE
GAP = 0.4 + 0.03 * np.sin(300 * T)
CURRENT = 1 + 0.1 * np.cos(300 * T)
HEADER = "Time [s],Position [mm],Time [s],Current [A]"


def _written(folder, header, *values):
    table = np.column_stack(values)
    np.savetxt(folder / "run.csv", table, "%.7f", ",", header=header, comments="")
    return folder / "run.csv"


def _campaign(folder, time="[0]", displacement="Position [mm]", current="Current [A]", **current_has):
    """As the file was described, whatever is guessed now."""
    channels = {
        "time": {"from": time},
        "displacement": {"from": displacement, "scale": 1e-3},
        "current": {"from": current, **current_has},
    }
    table = {
        "file": "run.csv",
        "sample_rate": RATE,
        "role": "fit",
        "excitation": [{"kind": "none"}],
        "channels": channels,
    }
    campaign = parse_campaign(folder, {"schema": SCHEMA, "recording": [table]})
    assert [f for f in examine(campaign) if f.code == "clock"] == other_clocks(campaign, campaign.recordings[0])
    return other_clocks(campaign, campaign.recordings[0])


@pytest.mark.parametrize(
    ("other", "kind"),
    [(T + 0.0123, "contradiction"), (np.arange(N) / 9000, "contradiction"), (T + 0.3 / RATE, "wiring")],
)
def test_a_channel_with_another_clock_is_not_paired_row_by_row(tmp_path, other, kind):
    path = _written(tmp_path, HEADER, T, GAP, other, CURRENT)
    guess = guess_recording(path)
    assert set(guess.channels) == {"time", "displacement"}
    current = next(c for c in guess.columns if c.label == "Current")
    assert "is sampled at the other clock" in current.ask and "from" in current.reason
    (found,) = _campaign(tmp_path)
    assert (found.code, found.channel, found.kind) == ("clock", "current", kind)


def test_the_clock_is_that_of_the_displacement(tmp_path):
    path = _written(tmp_path, "Time [s],Current [A],Time [s],Position [mm]", T, CURRENT, T + 0.0123, GAP)
    found = guess_recording(path).channels
    assert (found["time"].column, set(found)) == ("[2]", {"time", "displacement"})
    (alarm,) = _campaign(tmp_path, time="[2]")
    assert alarm.channel == "current"


def test_a_clock_that_ends_before_the_other_is_one_all_the_same(tmp_path):
    path = _written(tmp_path, HEADER, T, GAP, np.arange(N) / 9000, CURRENT)
    lines = path.read_text().splitlines()
    last = int(0.85 * N)
    path.write_text("\n".join([*lines[:last], *(",".join([*line.split(",")[:2], "", ""]) for line in lines[last:])]))
    assert set(guess_recording(path).channels) == {"time", "displacement"}
    assert [f for f in _campaign(tmp_path) if f.channel == "current"]


@pytest.mark.parametrize("other", [T, T + 0.02 / RATE])
def test_equal_clocks_beside_each_channel_are_one(tmp_path, other):
    found = guess_recording(_written(tmp_path, HEADER, T, GAP, other, CURRENT))
    assert {"displacement", "current"} <= set(found.channels) and not found.channels["current"].ask
    assert not _campaign(tmp_path)


def test_a_stated_delay_says_when_a_channel_was_read(tmp_path):
    _written(tmp_path, HEADER, T, GAP, T + 0.0002, CURRENT)
    assert _campaign(tmp_path) and not _campaign(tmp_path, delay=1e-4)


def test_a_clock_of_the_day_is_asked_for_where_it_stands_between_and_else_says_nothing(tmp_path):
    day = 50_000 + T
    found = guess_recording(_written(tmp_path, "Time [s],Position [mm],clock [s],Current [A]", T, GAP, day, CURRENT))
    assert "was read at the times of the displacement" in found.channels["current"].ask
    assert not _campaign(tmp_path, time="Time [s]")
    for header, values in (
        ("Time [s],clock [s],Position [mm],Current [A]", (T, day, GAP, CURRENT)),
        ("Time [s],Position [mm],Current [A],clock [s]", (T, GAP, CURRENT, T + 0.0123)),
    ):
        found = guess_recording(_written(tmp_path, header, *values))
        assert {"displacement", "current"} <= set(found.channels) and not found.channels["current"].ask
        assert not _campaign(tmp_path, time="Time [s]")


def test_times_belong_to_the_columns_of_their_group():
    names = ["t", "x", "a.t", "a.y", "a.in.z", "b.w", "t2", "i"]
    own = own_times(names, {"t", "a.t", "t2"})
    assert own == {"x": ("t",), "a.y": ("a.t",), "a.in.z": ("a.t",), "b.w": ("t",), "i": ("t2",)}
