"""The recordings that proposals ask for, as the example carries them out."""

import sys
from pathlib import Path

import pytest

from maglev_env.rig.excitation import lines_at
from maglev_env.rig.rig_file import load_rig

sys.path.insert(0, str(Path(__file__).parents[2] / "examples"))
from next_experiment import EFFECTS, carried_out, cases, true_experiment

FREE = load_rig("hmb_free")
BASE = true_experiment(FREE, EFFECTS[0], 1)


def test_every_case_is_a_rig_of_its_own():
    first = [(channels, tuple(effects)) for (channels, effects, _), _ in zip(cases(), range(20), strict=False)]
    assert len(set(first)) == 20
    again, other = true_experiment(FREE, EFFECTS[0], 1), true_experiment(FREE, EFFECTS[0], 2)
    assert again == BASE and other.effects != BASE.effects
    assert BASE.effects["delay"] == EFFECTS[0]["delay"] and BASE.effects["mass"]["change"] != 0


def test_what_a_proposal_changes_is_changed_and_nothing_else():
    louder = carried_out(BASE, {"amplitude": 2.0}, 1)
    assert [x.amplitude for x in louder.excitations] == [2 * x.amplitude for x in BASE.excitations]
    assert carried_out(BASE, {"offset": 3e-5}, 1).offset == BASE.offset + 3e-5
    gains = carried_out(BASE, {"gains": [0.8, 1.3]}, 1).gains
    assert (gains.kp, gains.kd, gains.ki) == (0.8 * BASE.gains.kp, 1.3 * BASE.gains.kd, BASE.gains.ki)
    assert carried_out(BASE, {"channels": ["current"]}, 1).excitations == BASE.excitations
    assert carried_out(BASE, {}, 1).seed != BASE.seed


def test_lines_that_are_taken_over_leave_what_drove_them():
    forced = lines_at(BASE.excitations, "force").tolist()
    taken = forced[1::2]
    found = carried_out(BASE, {"excitation": {"at": "current", "lines": taken, "peak": 0.05}}, 1)
    assert lines_at(found.excitations, "force").tolist() == forced[::2]
    assert set(taken) <= set(lines_at(found.excitations, "current").tolist())
    assert found.excitations[-1].amplitude == pytest.approx(0.05)
