"""Recordings with a period of a campaign: what tells nothing is left out, and what is wrong stops."""

from types import SimpleNamespace

import numpy as np
import pytest
from campaigns import campaign

from maglev_env.recordings.campaign import load_campaign
from maglev_env.rig.excitation import Excitation
from tuning.campaign import lines_shown as module
from tuning.campaign.recorded_sets import recorded_sets


@pytest.fixture(scope="module")
def loaded(tmp_path_factory):
    return load_campaign(campaign(tmp_path_factory.mktemp("p") / "c", names=("base", "half")))


def test_a_wrong_statement_stops_with_its_message_and_file(loaded, monkeypatch):
    def refuse(*_):
        raise ValueError("mass = -1 must be positive")

    monkeypatch.setattr(module, "frequency_response", refuse)
    with pytest.raises(ValueError, match=r"base\.npz: mass = -1 must be positive"):
        recorded_sets(loaded)


def test_a_period_that_shows_nothing_is_left_out_with_what_to_do_instead(loaded, monkeypatch):
    monkeypatch.setattr(module, "LEAST_LINES", 1000)
    with pytest.raises(ValueError, match="shows nothing of the loop; excite 1000 lines or more at the force"):
        recorded_sets(loaded)


def test_a_noise_current_below_that_of_its_meter_is_as_uncertain_as_it_says(monkeypatch):
    """Seen on balls of another simulator: 0.80 mA behind a meter of 2 mA was claimed to be 0.86 to 0.96 mA."""
    monkeypatch.setattr(module, "per_period", lambda signals: 1000)
    rig, rng = SimpleNamespace(noise=SimpleNamespace(current=2e-3)), np.random.default_rng(4)

    def recorded(own):
        current = np.tile(rng.standard_normal(1000), 6) + np.hypot(own, 2e-3) * rng.standard_normal(6000)
        signals = SimpleNamespace(periodic=True, channels={"current": current}, left_out=())
        return module._noise_current(signals, rig, 0)

    found = np.array([recorded(0.8e-3) for _ in range(200)])
    assert 0.8 < np.median(found[:, 1]) * 0.8e-3 / found[:, 0].std() < 1.2
    assert recorded(20e-3)[1] < 0.015 and np.isnan(recorded(1e-5)[0]) | (recorded(1e-5)[1] > 1)


def test_a_transient_and_masked_periods_are_no_noise(monkeypatch):
    monkeypatch.setattr(module, "per_period", lambda signals: 1000)
    rig, rng = SimpleNamespace(noise=SimpleNamespace(current=0.0)), np.random.default_rng(4)
    current = 1e-3 * rng.standard_normal(8000) + 0.1 * np.exp(-np.arange(8000) / 250)
    current[5100:5200] = 0.3
    signals = SimpleNamespace(periodic=True, channels={"current": current}, left_out=(5,))
    noise, _ = module._noise_current(signals, rig, 3)
    assert noise == pytest.approx(1e-3, rel=0.05)


def test_what_repeats_may_be_a_block_of_periods():
    excitation = Excitation("multisine", "current", 3.0, (1, 2), 1.0)
    assert module.per_period(SimpleNamespace(excitations=(excitation,), sample_rate=20000.0)) == 20000
