"""Magnets of another force constant than stated, by another hand: gain and stiffness are off together."""

from dataclasses import replace

import numpy as np
import pytest

from sim2real import diagnose
from sim2real.blind.benchmark.drives import draw_drive
from sim2real.blind.benchmark.rigs import draw_rig
from sim2real.blind.benchmark.simulate import Controller, Recording, Truth, simulate
from sim2real.blind.benchmark.write import Recorded, write_campaign
from sim2real.search import attribute

STRONGER = 1.2
# The rivals of both, most of which one kernel simulates: each of the others compiles its own and fits worse.
FEW = (
    "delay", "amplifier_lag", "actuator_gain", "negative_stiffness", "sensor_gain", "sensor_lag", "mass", "damping",
    "eddy_current", "force_law", "actuator_offset",
)  # fmt: skip


@pytest.mark.slow
def test_a_larger_force_constant_is_a_gain_and_a_stiffness_and_no_other_mass(tmp_path, monkeypatch):
    rng = np.random.default_rng(3)
    rig = draw_rig("rotor", rng)
    p = rig.parameters
    constant = p.get("force_constant") or rig.gain * p["gap"] ** 2 / (4 * p["bias_current"])
    true = replace(rig, parameters={**p, "force_constant": STRONGER * constant})
    controller = Controller(rig.pid, "pid", 1 / p["control_rate"])
    recorded = []
    for n, (role, shape, level) in enumerate(
        (("fit", "multisine", 0.12), ("fit", "chirp", 0.06), ("holdout", "multisine", 0.12))
    ):
        recording = Recording(f"r{n}", role, controller, draw_drive(shape, rig, False, level, rng))
        recorded.append(Recorded(recording, True, simulate(Truth(true), recording, 5 + n)))
    write_campaign(tmp_path / "c", rig, "no_force", recorded)
    monkeypatch.setattr(attribute, "single_effects", lambda rig: FEW)
    found = diagnose(tmp_path / "c")
    assert (found.verdict, set(found.cause)) == ("explained", {"actuator_gain", "negative_stiffness"})
    effects = found.corrected.effects
    for name in ("actuator_gain", "negative_stiffness"):
        assert effects[name]["change"] == pytest.approx(STRONGER - 1, abs=0.01)
    assert effects["actuator_gain"]["force_share"] > 0.8  # of the force, not of the current
