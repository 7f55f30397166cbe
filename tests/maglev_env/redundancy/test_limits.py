"""The controller's rule under controllers with a limit, or that read the current, on a bench of another hand."""

import re
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from ball_bench import record, write_campaign

from maglev_env.loop.gains import as_table, controller_output
from maglev_env.recordings.campaign import load_campaign
from maglev_env.recordings.campaign_writer import toml_value
from maglev_env.redundancy.rules import examine
from maglev_env.rig.rig_file import rig_from_toml

DOCS = Path(__file__).parents[3] / "docs" / "controllers.md"
TEXTS = [t for t in re.findall(r"```toml\n(.*?)```", DOCS.read_text(encoding="utf-8"), re.S) if "schema" in t]
RIGS = {rig.name: (rig, text) for rig, text in ((rig_from_toml(text, "docs"), text) for text in TEXTS)}
FEEDBACK, PID, CASCADE = RIGS
SAMPLES = 4000
LIMITS = {FEEDBACK: 0.07, PID: 0.07, CASCADE: 0.08}  # A, that each touches but survives
CASES = [(FEEDBACK, False), (FEEDBACK, True), (PID, True), (CASCADE, False), (CASCADE, True)]


@cache
def driven(name, limited):
    """The rig with the limit or without one, and its channels under white injection and set-point steps."""
    rig = RIGS[name][0]
    rig = replace(rig, gains=replace(rig.gains, limit=(-LIMITS[name], LIMITS[name]) if limited else None))
    rng = np.random.default_rng(5)
    injection = rng.normal(scale=0.06 if name == PID else 0.02, size=SAMPLES)
    reference = np.repeat(rng.uniform(-2e-4, 2e-4, 20), SAMPLES // 20)
    run = record(rig, SAMPLES / rig.control_rate, 6, injection, reference)
    if limited:
        assert np.isclose(abs(run["command"] - injection), LIMITS[name], atol=1e-12).sum() > 5
    return rig, run | {"reference": reference, "injection": injection}


def found(folder, name, gains, run, keep=()):
    controller = toml_value(as_table(gains))
    write_campaign(folder, RIGS[name][1], controller, {"run": run}, channels=keep or tuple(run))
    return examine(load_campaign(folder))


def about_the_controller(findings):
    return [f for f in findings if "gains" in f.channel or "command" in f.channel]


@pytest.mark.parametrize(("name", "limited"), CASES)
def test_a_sound_recording_is_silent_and_covered(tmp_path, name, limited):
    rig, run = driven(name, limited)
    # Where slow set-point steps hold most of what is injected, its time is not told, and this is said.
    said = found(tmp_path, name, rig.gains, run)
    assert [f for f in said if "mass" not in f.channel and not f.channel.startswith("time of")] == []


@pytest.mark.parametrize(
    ("name", "limited", "channel", "factor"),
    [
        (FEEDBACK, True, "displacement", 1.3),
        (FEEDBACK, False, "injection", 2.0),
        (PID, True, "command", -1.0),
        (CASCADE, True, "injection", 2.0),
        (CASCADE, False, "current", 1.5),
        (PID, False, "reference", 0.5),
    ],
)
def test_a_wrong_scale_is_named(tmp_path, name, limited, channel, factor):
    rig, run = driven(name, limited)
    said = found(tmp_path, name, rig.gains, run | {channel: factor * run[channel]})
    assert any(channel in f.channel and f.kind in ("wiring", "contradiction") for f in said)


def test_the_wanted_current_of_a_cascade_is_not_its_command(tmp_path):
    rig, run = driven(CASCADE, False)
    wanted = controller_output(rig.gains.outer, run["displacement"], 1 / rig.control_rate, run["reference"])
    run = {name: values for name, values in run.items() if name != "injection"} | {"command": wanted}
    (said,) = [f for f in found(tmp_path, CASCADE, rig.gains, run) if f.kind == "contradiction"]
    assert said.channel == "command or current" and "state the outer controller alone" in said.message


@pytest.mark.parametrize(("name", "limited"), [(FEEDBACK, True), (PID, True), (CASCADE, False)])
def test_other_gains_than_the_stated_ones_are_told(tmp_path, name, limited):
    rig, run = driven(name, limited)
    gains = rig.gains
    if name == CASCADE:
        other = replace(gains, outer=replace(gains.outer, kp=1.3 * gains.outer.kp))
    else:
        part = "kp" if name == PID else "velocity"
        other = replace(gains, **{part: 1.3 * getattr(gains, part)})
    assert about_the_controller(found(tmp_path, name, other, run))


def test_a_record_that_begins_in_the_middle_of_a_run_is_silent_too(tmp_path):
    rig, run = driven(CASCADE, False)
    later = {name: values[700:] for name, values in run.items()}
    assert [f for f in found(tmp_path, CASCADE, rig.gains, later) if "mass" not in f.channel] == []


def test_a_controller_whose_current_was_not_recorded_is_not_checkable(tmp_path):
    rig, run = driven(FEEDBACK, False)
    said = found(tmp_path, FEEDBACK, rig.gains, run, ("displacement", "command", "injection", "reference"))
    (note,) = [f for f in said if f.kind == "not checkable"]
    assert "gains" in note.channel and "record current at the control rate" in note.message
