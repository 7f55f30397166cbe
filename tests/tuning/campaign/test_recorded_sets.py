"""Recordings with a period of a campaign: what tells nothing is left out, and what is wrong stops."""

import pytest
from campaigns import campaign

from maglev_env.recordings.campaign import load_campaign
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
