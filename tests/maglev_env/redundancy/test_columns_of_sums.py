"""Channels that are sums of columns: one column that stands still is named, and the sum is printed as it is."""

import numpy as np
import pytest

from maglev_env.recordings.alarms.alarm import alarms_of
from maglev_env.recordings.campaign import load_campaign
from maglev_env.recordings.campaign_tables import ChannelSource
from maglev_env.recordings.recording import read_recording

CAMPAIGN = """schema = "maglev-campaign/1"
[[recording]]
file = "run.npz"
sample_rate = 1000.0
excitation = { kind = "none" }
[recording.channels]
displacement = { from = "y", scale = 1e-6 }
current = { from = ["top", "bottom"], weights = [0.5, -0.5] }
"""


def alarms(folder, bottom):
    rng = np.random.default_rng(1)
    y, i = np.cumsum(rng.normal(size=(2, 4000)), axis=1)
    (folder / "campaign.toml").write_text(CAMPAIGN)
    np.savez(folder / "run.npz", y=y, top=2 + 0.01 * i, bottom=bottom(2 - 0.01 * i))
    campaign = load_campaign(folder)
    return alarms_of(read_recording(campaign, campaign.recordings[0], alarmed=True))


def held(values):
    return np.where(np.arange(values.size) < 1500, values, values[1500])


@pytest.mark.parametrize(("bottom", "says"), [(np.full_like, "in every sample"), (held, "is stuck at")])
def test_one_of_two_coils_that_stands_still_is_named(bottom, says, tmp_path):
    one = (lambda v: np.full_like(v, 2.0)) if bottom is np.full_like else bottom
    (alarm,) = alarms(tmp_path, one)
    assert (alarm.channel, alarm.severity) == ("current", "refuse")
    assert "column 'bottom'" in alarm.sentence and says in alarm.sentence


def test_coils_that_move_are_not_accused(tmp_path):
    assert not alarms(tmp_path, lambda v: v)


@pytest.mark.parametrize(
    ("weights", "text"), [((0.5, -0.5), "0.5 a - 0.5 b"), ((1.0, 1.0), "a + b"), ((-1.0, 2.0), "-a + 2 b")]
)
def test_a_sum_is_printed_with_its_weights(weights, text):
    assert ChannelSource(("a", "b"), weights).expression == text
    assert ChannelSource(("a",), (1.0,)).expression == "a"
