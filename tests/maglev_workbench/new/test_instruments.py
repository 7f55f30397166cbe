"""`maglev new` on files of further programs and instruments: what is said above a table is used."""

import json

import numpy as np
import pytest
from campaigns import planned
from command_line import maglev
from foreign_instruments import FIVE, NAMED, UNNAMED, lvm_packets, rigol, tektronix_beside, twincat

from maglev_env.kernel.simulate import simulate_records
from maglev_env.recordings.files import read_columns
from maglev_env.recordings.guess.recording import guess_recording
from maglev_env.recordings.recording import simulated_recording
from maglev_env.rig.rig_file import load_rig

RATE, FUNDAMENTAL = 20000.0, 4.0


@pytest.fixture(scope="module")
def record() -> dict[str, np.ndarray]:
    experiment = planned(load_rig("hmb_free"), names=("base",))[0].experiment
    dataset = simulated_recording(experiment, simulate_records([experiment])[0])
    columns = {"time": dataset.time.values, **{str(n): dataset[n].values for n in dataset.data_vars}}
    return {name: values[:15000] for name, values in columns.items()}  # three periods


@pytest.mark.parametrize("layout", NAMED)
def test_named_channels_are_read_with_their_units_rate_and_controller(layout, record, tmp_path):
    file = layout(tmp_path, record)
    guess = guess_recording(file)
    assert set(guess.channels) - {"time"} == set(FIVE)
    assert guess.rate.value == RATE
    for name in FIVE:
        column = guess.channels[name]
        raw = read_columns(file).column(column.column) * column.scale
        np.testing.assert_allclose(raw, record[name], rtol=1e-5, atol=1e-8)
    assert {e["at"] for e in guess.excitations} == {"current", "force"}
    assert {e["fundamental"] for e in guess.excitations} == {FUNDAMENTAL}
    assert guess.gains["kp"] == pytest.approx(8000.0, rel=1e-3)
    assert not any("which column" in g.ask for g in guess.guesses)


@pytest.mark.parametrize("layout", UNNAMED)
def test_of_channels_without_a_quantity_the_scale_is_asked(layout, record, tmp_path):
    guess = guess_recording(layout(tmp_path, record))
    assert guess.rate.value == pytest.approx(RATE)
    assert set(guess.channels) - {"time"} == {"displacement", "command", "current"}
    asked = {name: c.ask for name, c in guess.channels.items()}
    assert ("scale in m per V" in asked["displacement"]) == (layout.__name__ != "to_file")
    if layout.__name__ in ("tektronix", "rigol", "keysight"):
        assert "scale in A per V" in asked["current"] and "scale in A per V" in asked["command"]


def test_a_preamble_beside_the_first_samples_hides_none_of_them(record, tmp_path):
    file = tektronix_beside(tmp_path, record)
    guess = guess_recording(file)
    assert guess.rate.value == RATE and guess.channels["displacement"].column == "[4]"
    np.testing.assert_allclose(read_columns(file).column("[4]"), record["displacement"] * 1e4, atol=1e-6)


@pytest.mark.slow
def test_check_runs_without_an_edit(record, tmp_path):
    for layout in (lvm_packets, twincat, rigol):
        layout(tmp_path, record)
    maglev("new", tmp_path)
    maglev("check", tmp_path, "--json", tmp_path / "check.json")
    checked = json.loads((tmp_path / "check.json").read_text())
    can = {r["file"]: r["can"] for r in checked["recordings"]}
    assert can.keys() == {"packets.lvm", "twincat.csv", "rigol.csv"}
    assert can["packets.lvm"]["stiffness and damping"] == can["twincat.csv"]["stiffness and damping"] == "yes"
