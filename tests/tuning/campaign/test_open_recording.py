"""Recordings without a period, of a bench of another hand, tell the loop or say why they do not."""

import numpy as np
import pytest
from bench_loop import Bench, write_campaign

from maglev_env.experiment import Experiment
from maglev_env.linear.loop import loop_response
from maglev_env.recordings.campaign import load_campaign
from tuning.campaign.next_step import next_step
from tuning.campaign.recorded_sets import recorded_sets


def sets_of(folder, *kinds):
    loaded = load_campaign(write_campaign(folder, Bench(), dict.fromkeys(kinds, "fit"), 2.0, 0))
    return loaded.rig, recorded_sets(loaded)[1]


@pytest.mark.parametrize("kind", ["noise", "chirp", "steps"])
def test_what_drove_the_loop_tells_its_sensitivity_with_its_noise(tmp_path, kind):
    rig, (found,) = sets_of(tmp_path, kind)
    assert found.open and found.untold is None and found.failed is None and found.receptance is None
    s = found.sensitivity
    true = loop_response(Experiment(rig, found.gains, ()), s.frequency).sensitivity
    z = np.abs(s.value - true) / np.sqrt(s.variance)
    assert np.sqrt(np.mean(z**2)) == pytest.approx(1.0, abs=0.15)
    assert abs(np.abs(s.value).max() / np.abs(true).max() - 1) < 0.06


@pytest.mark.parametrize("kind", ["sine", "hover"])
def test_what_tells_no_margins_is_said_and_the_designed_recording_is_proposed_at_the_same_gains(tmp_path, kind):
    rig, sets = sets_of(tmp_path, kind)
    (found,) = sets
    assert found.untold and found.failed is None
    advice = next_step(rig, sets)
    assert advice.stop is None and advice.next == found.gains
    assert "designed" in advice.why and found.untold in advice.why and f"{kind}.npz: {found.untold}" in advice.notes
    assert next_step(rig, sets, budget=1).stop


def test_a_recording_that_tells_stands_for_its_gains(tmp_path):
    _, (both,) = sets_of(tmp_path, "sine", "chirp")
    assert both.files == ("sine.npz", "chirp.npz") and both.open and both.untold is None


@pytest.mark.slow
def test_a_step_or_a_stop_follows_from_a_chirp(tmp_path):
    rig, sets = sets_of(tmp_path, "chirp")
    advice = next_step(rig, sets, ("kp", "kd"))
    assert advice.identified is not None and not advice.identified.contradicted
    told = advice.identified.told()
    assert abs(told["mass"][0] / told["mass"][2] - 1) < 4 * told["mass"][1] / told["mass"][2] + 0.02
    assert advice.shown[0].margins.peak_sensitivity == pytest.approx(2.47, abs=0.1)
    assert advice.next is not None or advice.keep == 0
