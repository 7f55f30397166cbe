"""Below a single magnet a stiffness of its own is named as the force law that it is."""

import pytest
from ball_bench import BALL

from maglev_env.rig.rig_file import load_rig, rig_from_toml
from sim2real.judgement.judge import Entry
from sim2real.judgement.mechanisms import by_mechanism, renamed

FOUND = [
    Entry(("hysteresis", "negative_stiffness"), 0.4, 100.0, 3, 0.9),
    Entry(("actuator_gain",), 0.3, 101.0, 1, None),
    Entry(("force_law", "hysteresis"), 0.25, 103.0, 2, None),
    Entry(("unknown",), 0.05, 100.0, None, None),
]


def test_a_stiffness_below_one_magnet_is_the_law_and_counts_with_it():
    found = by_mechanism(FOUND, rig_from_toml(BALL, "docs"))
    assert [e.effects for e in found] == [("hysteresis", "force_law"), ("actuator_gain",), ("unknown",)]
    assert found[0].probability == pytest.approx(0.65) and found[0].candidate == 3
    assert sum(e.probability for e in found) == pytest.approx(1.0)
    assert renamed(found[0], FOUND[0].effects) is not None and renamed(found[1], FOUND[1].effects) is None


def test_of_opposed_magnets_and_of_no_magnet_both_keep_their_names():
    assert by_mechanism(FOUND, load_rig("hmb_free")) == FOUND
    assert by_mechanism(FOUND, load_rig("pedestal")) == FOUND
