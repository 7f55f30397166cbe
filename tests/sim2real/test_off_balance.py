"""A ball whose command is read with a zero that is off: the motion shows nothing, and the mean contradicts."""

import json
import tomllib

import numpy as np
import pytest
from ball_bench import BALL, record, write_campaign

from maglev_env.loop.magnets.kinds import force_law
from maglev_env.rig.rig_file import rig_from_toml
from sim2real.diagnosis import diagnose
from sim2real.recorded.records import read_records
from sim2real.report import sentence
from sim2real.search import attribute

SHARE = 0.08  # of the bias current


@pytest.mark.slow
def test_an_offset_that_no_stated_tolerance_makes_evidence_does_not_show_and_is_said(tmp_path, monkeypatch):
    few = ("actuator_offset", "actuator_gain", "negative_stiffness", "cubic_spring", "delay")
    monkeypatch.setattr(attribute, "single_effects", lambda rig: few)
    rig, rng = rig_from_toml(BALL, "ball.toml"), np.random.default_rng(2)
    bias = force_law(rig).bias_current
    runs = {}
    for name, seed in (("one", 3), ("two", 4)):
        run = record(rig, 2.0, seed, injection=0.02 * bias * rng.normal(size=int(2 * rig.control_rate)))
        runs[name] = {"displacement": run["displacement"], "command": run["command"] - SHARE * bias}
    controller = ", ".join(f"{key} = {json.dumps(value)}" for key, value in tomllib.loads(BALL)["gains"].items())
    folder = write_campaign(tmp_path, BALL, f"{{ {controller} }}", runs)
    _, records = read_records(folder)
    assert all(r.lacks == pytest.approx(SHARE * bias, rel=0.1) for r in records)
    found = diagnose(folder)
    assert found.verdict == "no_gap" and "actuator_offset" in found.unseen
    assert (
        "in the motion; but the mean command is" in sentence(found)
        and "8% of the bias" in found.to_json()["off_balance"]
    )
    assert all(any("before the current is recorded" in note for note in r.notes) for r in records)
