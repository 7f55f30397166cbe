"""A force transducer or a current meter of another scale, or behind a filter, is said beside what it looks like."""

import numpy as np
import pytest
from campaigns import campaign
from scipy.signal import lfilter

from maglev_env.loop.effect import effect
from sim2real.diagnosis import diagnose
from sim2real.gap.wrong_reading import WrongReading
from sim2real.report import sentence
from sim2real.search import attribute

RIVALS = ("sensor_gain", "actuator_gain", "mass", "delay")


def answer(folder, monkeypatch):
    monkeypatch.setattr(attribute, "single_effects", lambda rig: RIVALS)
    return diagnose(folder)


def scaled(folder, channel, factor):
    """Every recording, in which a channel reads that much of what it should."""
    for file in folder.glob("*.npz"):
        columns = dict(np.load(file))
        columns[channel] = factor * columns[channel]
        np.savez(file, **columns)
    return folder


@pytest.mark.slow
@pytest.mark.parametrize(("channel", "factor"), [("force", 0.92), ("current", 1.05)])
def test_a_channel_that_reads_too_much_or_too_little_is_said_with_its_size(tmp_path, monkeypatch, channel, factor):
    found = answer(scaled(campaign(tmp_path / "c"), channel, factor), monkeypatch)
    assert found.verdict != "no_gap" and found.misread is not None
    assert (
        found.misread.channel == channel and abs(found.misread.change - (1 / factor - 1)) < 3 * found.misread.se < 0.07
    )
    assert found.misread.briefly in sentence(found)
    assert found.to_json()["wrong_reading"]["channel"] == channel
    assert any("scale_tolerance" in note for note in found.notes)


@pytest.mark.slow
def test_a_current_behind_a_filter_of_its_meter_is_read_late_by_that(tmp_path, monkeypatch):
    folder = campaign(tmp_path / "c")
    for file in folder.glob("*.npz"):
        columns = dict(np.load(file))
        columns["current"] = lfilter([0.7], [1, -0.3], columns["current"])
        np.savez(file, **columns)
        step = np.diff(columns["time"]).mean()
    found = answer(folder, monkeypatch)
    assert found.misread is not None and found.misread.of_time and found.misread.channel == "current"
    # What the filter lags by at low frequencies; beside a lag of the amplifier within its tolerance.
    assert abs(found.misread.change - 0.3 / 0.7 * step) < 3 * found.misread.se < 0.2 * step
    assert any("delay_tolerance" in note for note in found.notes)


@pytest.mark.slow
@pytest.mark.parametrize("effects", [effect("sensor_gain", 0.25), effect("delay", 7.5e-5)])
def test_what_the_scale_of_no_channel_explains_is_not_put_down_to_one(tmp_path, monkeypatch, effects):
    found = answer(campaign(tmp_path / "c", effects=effects), monkeypatch)
    assert found.verdict in ("explained", "ambiguous") and found.misread is None


def test_its_words():
    said = WrongReading("force", False, 0.0617, 0.011)
    assert said.briefly == "a force that reads 6.2 % too little would explain as much"
    assert "+6.17 +- 2 %, 95 %" in said.in_words()
    late = WrongReading("current", True, 7.82e-5, 7e-7, better=True)
    assert late.briefly == "a current that is read 78.2 µs late would explain more than anything in the rig"
    assert "+78.2 +- 1 us, 95 %)" in late.in_words()
    assert WrongReading("current_x", False, -0.05, 1e-3).briefly.startswith("a current_x that reads 5 % too much")
