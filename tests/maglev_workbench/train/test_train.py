"""`maglev train` as a user runs it."""

from functools import partial

import numpy as np
import pytest
from command_line import maglev

from maglev_env.rig.rig_file import load_rig
from tuning.learned.policy import HistoryPolicy, load_policy, save_policy, shape_for
from tuning.learned.worlds import World

run = partial(maglev, "train")
KEPT = ("--by", "familiar", "--protocol", "quick", "--rigs", 3, "--held-out", 2)


@pytest.mark.slow
def test_what_is_familiar_to_a_policy_is_found_anew_and_all_else_of_it_stays(tmp_path):
    mine = HistoryPolicy(shape_for(World(load_rig("hmb_free")).task(), 10, 8))
    save_policy(tmp_path / "mine.npz", mine, {"command": "as it was made"})
    for out in ("a", "b"):
        run(*KEPT, "--init", tmp_path / "mine.npz", "--out", tmp_path / out)
    assert (tmp_path / "a" / "policy.npz").read_bytes() == (tmp_path / "b" / "policy.npz").read_bytes()
    found, made_by = load_policy(tmp_path / "a" / "policy.npz")
    seen = np.random.default_rng(0).uniform(-1, 1, (5, 3, len(mine.shape.names)))
    np.testing.assert_array_equal(found.act(seen), mine.act(seen))
    assert found.familiar is not None and made_by["command"] == "as it was made"
    assert made_by["familiar"]["plan"] == {"rigs": 3} and "--by familiar" in made_by["familiar"]["command"]


@pytest.mark.slow
def test_what_does_not_belong_to_the_way_of_training_is_refused(tmp_path):
    save_policy(tmp_path / "other.npz", HistoryPolicy(shape_for(World(load_rig("hmb_free")).task(), 4, 8)), {})
    for arguments, words in (
        (KEPT, "name the policy whose weights stay"),
        ((*KEPT, "--init", tmp_path / "other.npz"), "another number of experiments"),
        ((*KEPT, "--init", tmp_path / "other.npz", "--experiments", 100), "familiar takes --rigs"),
    ):
        assert words in run(*arguments, "--out", tmp_path / "x", code=2)
