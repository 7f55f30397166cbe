"""Units that headers state: less usual ones, those within a name, beside the names of JSON, and unknown ones."""

import json

import numpy as np
import pytest

from maglev_env.recordings.contents import Contents
from maglev_env.recordings.guess.columns.columns import guess_columns
from maglev_env.recordings.guess.rate import guess_rate
from maglev_env.recordings.guess.recording import guess_recording
from maglev_env.recordings.guess.units import header_unit

N = 2000
GAP = 0.4 + 0.03 * np.sin(np.arange(N) / 9)
CURRENT = 1 + 0.1 * np.cos(np.arange(N) / 9)


def columns(**values):
    return {c.column: c for c in guess_columns(Contents(values, {}, {}, ()))}


@pytest.mark.parametrize(
    ("header", "name", "si", "scale"),
    [
        ("Time [min]", "Time", "s", 60.0),
        ("Zeit / h", "Zeit", "s", 3600.0),
        ("time (d)", "time", "s", 86400.0),
        ("Time (usec)", "Time", "s", 1e-6),
        ("t_msec", "t", "s", 1e-3),
        ("time [milliseconds since 2024-05-01 13:22:01]", "time", "s", 1e-3),
        ("time [days since 1970-01-01]", "time", "s", 86400.0),
        ("probe X (mil)", "probe X", "m", 25.4e-6),
        ("gap [in]", "gap", "m", 25.4e-3),
        ("gap_inch", "gap", "m", 25.4e-3),
        ("force [lbf]", "force", "N", 4.4482216152605),
        ("Kraft / daN", "Kraft", "N", 10.0),
        ("load (kgf)", "load", "N", 9.80665),
        ("gap_um_filtered", "gap_filtered", "m", 1e-6),
        ("i_mA_raw", "i_raw", "A", 1e-3),
    ],
)
def test_less_usual_units_and_their_places(header, name, si, scale):
    called, unit = header_unit(header)
    assert (called, unit.si) == (name, si)
    assert unit.scale == pytest.approx(scale, rel=1e-12)


@pytest.mark.parametrize("header", ["gap_min", "pos (min)", "u_in", "pos_in", "kd_d", "i_h", "Drehzahl count/min"])
def test_what_may_as_well_be_a_minimum_an_input_or_an_index_is_no_unit(header):
    assert header_unit(header) == (header, None)


def test_units_within_a_name_leave_ratios_alone():
    assert header_unit("vel_mm_s")[1].si == "m/s"


@pytest.mark.parametrize(("unit", "seconds", "rate"), [("min", 60.0, 100), ("h", 3600.0, 100), ("usec", 1e-6, 50_000)])
def test_a_time_in_a_stated_unit_is_not_judged_by_its_size(unit, seconds, rate):
    time = np.arange(N) / rate / seconds
    found = columns(**{f"Time [{unit}]": time, "gap [mm]": GAP})[f"Time [{unit}]"]
    assert (found.channel, found.scale, found.ask) == ("time", pytest.approx(seconds), "")
    assert guess_rate(time, found.scale, {}).value == pytest.approx(rate, rel=1e-4)


@pytest.mark.parametrize("begin", [45413.5, 739373.5])
def test_days_of_a_spreadsheet_or_of_matlab_are_asked_for_and_never_taken_as_seconds(begin):
    time = begin + np.arange(N) / 100 / 86400
    found = columns(Timestamp=time, gap_mm=GAP)["Timestamp"]
    assert (found.channel, found.scale, found.ask) == ("time", 86400.0, "unit of time")
    assert guess_rate(time, found.scale, {}).value == pytest.approx(100, rel=1e-3)


def test_a_unit_that_is_not_known_is_asked_for_and_never_told_by_the_size():
    values = {"Time [s]": np.arange(N) / 1e3, "gap [furl]": 8000 * GAP, "current (stA)": 900 * CURRENT}
    found = columns(**values)
    for name, ask in (("gap [furl]", "scale in m per furl"), ("current (stA)", "scale in A per stA")):
        assert (found[name].scale, found[name].ask) == (1.0, ask)
    (time,) = [
        c for c in columns(**{"Time [jiffy]": np.arange(0.0, 4 * N, 4), "gap [mm]": GAP}).values() if "T" in c.column
    ]
    assert (time.scale, time.ask) == (1.0, "scale in s per jiffy")


@pytest.mark.parametrize("header", ["gap (raw)", "gap (filt)", "gap (DE)", "gap (left)", "gap (2)", "gap (sensor)"])
def test_other_words_in_brackets_leave_the_unit_to_the_size(header):
    found = columns(**{"Time [s]": np.arange(N) / 1e3, header: GAP, "current [A]": CURRENT})[header]
    assert (found.scale, found.ask) == (1e-3, "unit of this column")


@pytest.mark.parametrize("first", ["name", "unit"])
def test_units_beside_the_names_of_json_are_units_and_no_names(tmp_path, first):
    channels = []
    for name, unit, values in (("position", "um", 1e3 * GAP), ("current", "mA", 1e3 * CURRENT)):
        beside = {"name": name, "unit": unit}
        channels.append({first: beside[first], **beside, "data": values.tolist()})
    (tmp_path / "run.json").write_text(json.dumps({"fs": 10_000, "channels": channels}))
    found = guess_recording(tmp_path / "run.json").channels
    assert (found["displacement"].label, found["displacement"].scale) == ("position", 1e-6)
    assert (found["current"].label, found["current"].scale) == ("current", 1e-3)
    assert not found["displacement"].ask and not found["current"].ask
