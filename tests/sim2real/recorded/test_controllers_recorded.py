"""Recordings under controllers with several inputs and limits, of a bench of another hand."""

import re
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from ball_bench import record, write_campaign

from maglev_env.loop.gains import as_table
from maglev_env.recordings.campaign_writer import toml_value
from maglev_env.rig.rig_file import rig_from_toml
from sim2real.compared.point import Point
from sim2real.compared.problem import assemble
from sim2real.recorded.drive.controller_output import recovered_injection
from sim2real.recorded.records import read_records

DOCS = Path(__file__).parents[3] / "docs" / "controllers.md"
TEXTS = [t for t in re.findall(r"```toml\n(.*?)```", DOCS.read_text(encoding="utf-8"), re.S) if "schema" in t]
RIGS = {rig.name: (rig, text) for rig, text in ((rig_from_toml(text, "docs"), text) for text in TEXTS)}
FEEDBACK, PID, CASCADE = RIGS


def campaign(folder, name, gains, runs, **more):
    return write_campaign(folder, RIGS[name][1], toml_value(as_table(gains)), runs, **more)


SAMPLES = 2500
# Limits (A) that each touches but survives.
LIMITS = {FEEDBACK: (-0.08, 0.08), PID: (-0.07, 0.07), CASCADE: (-0.1, 0.1)}
CASES = [(FEEDBACK, False), (FEEDBACK, True), (PID, True), (CASCADE, False), (CASCADE, True)]


@cache
def driven(name, limited):
    """The rig with the limit or without one, and its channels under white injection and set-point steps."""
    rig = RIGS[name][0]
    rig = replace(rig, gains=replace(rig.gains, limit=LIMITS[name] if limited else None))
    rng = np.random.default_rng(3)
    injection = rng.normal(scale=0.06 if name == PID else 0.02, size=SAMPLES)
    reference = np.repeat(rng.uniform(-2e-4, 2e-4, 20), SAMPLES // 20)
    run = record(rig, SAMPLES / rig.control_rate, 4, injection, reference)
    return rig, run | {"reference": reference}, injection


@pytest.mark.parametrize(("name", "limited"), CASES)
def test_what_was_injected_is_recovered_exactly(name, limited):
    rig, run, injection = driven(name, limited)
    found = recovered_injection(rig.gains, dt=1 / rig.control_rate, **run)
    np.testing.assert_allclose(found, injection, rtol=0, atol=1e-9 if name == CASCADE else 1e-10)
    if limited:
        assert (np.isclose(abs(run["command"] - injection), LIMITS[name][1], atol=1e-12)).sum() > 3


@pytest.mark.slow
@pytest.mark.parametrize(("name", "limited"), [case for case in CASES if case != (FEEDBACK, True)])
def test_the_true_loop_leaves_white_noise_of_the_variance_that_is_told(tmp_path, name, limited):
    rig, run, _ = driven(name, limited)
    _, (found,) = read_records(campaign(tmp_path, name, rig.gains, {"run": run}, channels=tuple(run)))
    problem = assemble([found])
    nothing, gain = problem.data - problem.simulate([Point({}, {}), Point({"actuator_gain": {"change": 0.02}}, {})])
    for output in (0, 1):
        power = abs(nothing[problem.output == output]) ** 2 / 2
        assert power.mean() == pytest.approx(1.0, abs=5 / np.sqrt(power.size))
        low = power[: power.size // 5]
        assert low.mean() == pytest.approx(1.0, abs=5 / np.sqrt(low.size))
    assert np.sum(abs(gain) ** 2) - np.sum(abs(nothing) ** 2) > 50


def test_a_current_that_was_not_recorded_is_asked_for(tmp_path):
    rig = RIGS[FEEDBACK][0]
    folder = campaign(tmp_path, FEEDBACK, rig.gains, {"run": record(rig, 0.2, 0)}, channels=("displacement", "command"))
    with pytest.raises(ValueError, match="record the current that the controller reads"):
        read_records(folder)
