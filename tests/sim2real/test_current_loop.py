"""An amplifier that is a current loop with integral action: found, though no fit of a second pole leads there."""

import campaigns
import pytest

import sim2real
from maglev_env.loop.effect import check_effects, effect
from maglev_env.rig.rig_file import load_rig
from sim2real.lags_in_words import _loop_in_words
from sim2real.report import sentence
from sim2real.search import attribute

FREE = load_rig("hmb_free")
FIRST = FREE.amplifier_time_constant
# L di/dt = P (u - i) + I integral(u - i), with P / L = 1 / FIRST and I / L = (0.5 / FIRST)^2: the natural frequency is
# half that of the nominal pole, and the damping ratio 1.
LOOP = effect("amplifier_lag", 4 * FIRST, feedback=0.25, lead=1.0)


@pytest.mark.slow
def test_a_current_loop_is_named_and_said_by_its_frequency_and_damping(tmp_path, monkeypatch):
    few = ("amplifier_lag", "delay", "damping", "mass", "eddy_current")
    monkeypatch.setattr(attribute, "single_effects", lambda rig: few)
    found = sim2real.diagnose(campaigns.campaign(tmp_path, effects=LOOP))
    assert found.verdict == "explained" and found.cause == ("amplifier_lag",)
    assert found.corrected.effects["amplifier_lag"]["lead"] > 0.5
    assert "the amplifier is a loop of second order of" in sentence(found)


def test_a_loop_is_said_by_what_its_poles_and_its_zero_are():
    said = _loop_in_words(1.5e-4, time_constant=6e-4, feedback=0.25, lead=1.0)
    assert said == "a loop of second order of 531 Hz with a damping ratio of 1, and a zero at 265 Hz"


def test_its_limited_voltage_is_not_simulated():
    beside = {**LOOP, **effect("amplifier_voltage_limit", 1.0)}
    with pytest.raises(ValueError, match=r"amplifier_lag.lead is not simulated beside amplifier_voltage_limit"):
        check_effects(beside, FREE)
    check_effects({**beside, **effect("amplifier_lag", 1e-4)}, FREE)
