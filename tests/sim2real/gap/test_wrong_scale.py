"""A force transducer or a current meter of another scale is said beside what it looks like."""

import numpy as np
import pytest
from campaigns import campaign

from maglev_env.loop.effect import effect
from sim2real.diagnosis import diagnose
from sim2real.gap.wrong_scale import WrongScale
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
    assert found.verdict != "no_gap" and found.scale is not None
    assert found.scale.channel == channel and abs(found.scale.change - (1 / factor - 1)) < 3 * found.scale.se < 0.07
    assert found.scale.briefly in sentence(found)
    assert found.to_json()["wrong_scale"]["channel"] == channel
    assert any("scale_tolerance" in note for note in found.notes)


@pytest.mark.slow
@pytest.mark.parametrize("effects", [effect("sensor_gain", 0.25), effect("delay", 7.5e-5)])
def test_what_the_scale_of_no_channel_explains_is_not_put_down_to_one(tmp_path, monkeypatch, effects):
    found = answer(campaign(tmp_path / "c", effects=effects), monkeypatch)
    assert found.verdict in ("explained", "ambiguous") and found.scale is None


def test_its_words():
    said = WrongScale("force", 0.0617, 0.011)
    assert said.briefly == "a force that reads 6.2 % too little would explain as much"
    assert "+6.17 +- 2 %, 95 %" in said.in_words()
    assert WrongScale("current_x", -0.05, 1e-3).briefly.startswith("a current_x that reads 5 % too much")
