"""A gain of the stated controller that is not the one of the recordings is said where no command was recorded."""

import re

import pytest
from campaigns import campaign

from maglev_env.loop.effect import effect
from maglev_workbench.commands.diagnose.minded import minded
from sim2real.diagnosis import diagnose
from sim2real.report import sentence
from sim2real.search import attribute

RIVALS = ("sensor_gain", "actuator_gain", "amplifier_lag", "damping")
SEEN = ("displacement", "current", "force", "injection")


def answer(folder, monkeypatch):
    monkeypatch.setattr(attribute, "single_effects", lambda rig: RIVALS)
    return diagnose(folder)


def mistyped(folder, gain, factor):
    """The campaign, in which every recording states that much of the gain with which it was made."""
    file = folder / "campaign.toml"
    text, times = re.subn(
        rf"\b{gain} = ([0-9.e+-]+)", lambda m: f"{gain} = {factor * float(m[1]):.9g}", file.read_text()
    )
    assert times >= 3
    file.write_text(text)
    return folder


@pytest.mark.slow
@pytest.mark.parametrize(("gain", "factor"), [("kd", 0.88), ("kp", 1.1), ("ki", 2.0)])
def test_a_mistyped_gain_is_said_with_its_value(tmp_path, monkeypatch, gain, factor):
    found = answer(mistyped(campaign(tmp_path / "c", keep=SEEN), gain, factor), monkeypatch)
    said = found.wrong_gain
    assert said is not None and said.gain == gain
    assert abs(said.factor - 1 / factor) < 3 * said.se < 0.2 / factor
    assert said.briefly in sentence(found)
    assert any("controller's code" in said for said in minded(found))
    assert found.to_json()["wrong_gain"]["gain"] == gain


@pytest.mark.slow
@pytest.mark.parametrize("effects", [effect("damping", 4.0), effect("amplifier_lag", 1e-4)])
def test_an_effect_of_the_rig_is_not_put_down_to_a_gain(tmp_path, monkeypatch, effects):
    found = answer(campaign(tmp_path / "c", effects=effects, keep=SEEN), monkeypatch)
    assert found.verdict in ("explained", "ambiguous") and found.wrong_gain is None
