"""Hammer blows on a rotor that a controller holds: its current is what noise and motion make of the reading."""

import numpy as np
import pytest
from scipy.signal import cont2discrete

from maglev_env.recordings.campaign import load_campaign
from maglev_env.redundancy.rules import examine

MASS, GAIN, STIFFNESS, DAMPING, LAG, RATE = 2.2, 77.3, 248e3, 6.0, 1e-4, 8000.0
KP, KD, TD, FINER = 9620.0, 10.12381, 2.062261e-4, 8
CAMPAIGN = f"""
schema = "maglev-campaign/1"
rig = "rig.toml"
[[recording]]
file = "hammer.csv"
role = "fit"
sample_rate = {RATE}
gains = {{ kp = {KP}, ki = 0.0, kd = {KD}, td = {TD} }}
[[recording.excitation]]
kind = "recorded"
at = "force"
[recording.channels]
displacement = {{ from = "y" }}
command = {{ from = "c" }}
current = {{ from = "i" }}
force = {{ from = "f" }}
reference = {{ from = "r" }}
"""
RIG = f"""
schema = "maglev-rig/1"
name = "struck"
magnet = "electromagnet_pair"
axes = 1
[parameters]
mass = {MASS}
gap = 6e-4
clearance = 3e-4
bias_current = 1.9
actuator_gain = {GAIN}
negative_stiffness = {-STIFFNESS}
support_damping = {DAMPING}
amplifier_time_constant = {LAG}
sensor_time_constant = 0.0
probe_gain = 1e4
control_rate = {RATE}
[noise]
displacement = 1.5e-7
current = 1.5e-3
force = 0.05
[tolerance]
mass = 0.005
actuator_gain = 0.05
negative_stiffness = 0.1
probe_gain = 0.01
amplifier_time_constant = 0.1
"""


def _struck(seed, blows=9, seconds=2.0):
    """Columns y, c, i, f, r of a linear loop whose force changes within the samples."""
    rng = np.random.default_rng(seed)
    count = round(seconds * RATE)
    fine = np.zeros(count * FINER)
    width = round(1.5e-3 * RATE * FINER)
    for n in range(blows):
        at = round((0.1 + 0.2 * n + 0.013 * (n % 3)) * RATE * FINER)
        fine[at : at + width] += rng.uniform(45, 80) * np.sin(np.pi * np.arange(width) / width) ** 2
    a = np.array([[0, 1, 0], [STIFFNESS / MASS, -DAMPING / MASS, GAIN / MASS], [0, 0, -1 / LAG]])
    b = np.array([[0, 0], [1 / MASS, 0], [0, 1 / LAG]])
    ad, bd, *_ = cont2discrete((a, b, np.eye(3), np.zeros((3, 2))), 1 / RATE / FINER)
    state, filtered, kept, found = np.zeros(3), 0.0, np.exp(-1 / RATE / TD), []
    for n, noise in enumerate(rng.normal(0, 1.5e-7, count)):
        error = -state[0] - noise
        command = KP * error + KD / TD * (error - filtered)
        filtered = kept * filtered + (1 - kept) * error
        found.append((-error, command, state[2], fine[n * FINER], 0.0))
        for force in fine[n * FINER : (n + 1) * FINER]:
            state = ad @ state + bd @ (force, command)
    found = np.array(found)
    found[:, 2] += rng.normal(0, 1.5e-3, count)
    found[:, 3] += rng.normal(0, 0.05, count)
    return found


def _examined(folder, columns):
    (folder / "rig.toml").write_text(RIG)
    (folder / "campaign.toml").write_text(CAMPAIGN)
    np.savetxt(folder / "hammer.csv", columns, delimiter=",", header="y,c,i,f,r", comments="", fmt="%.9g")
    return [f for f in examine(load_campaign(folder)) if f.code in ("scale", "delay", "mismatch", "sign", "shape")]


@pytest.mark.parametrize("seed", [4, 5, 8])
def test_a_sound_hammer_recording_has_no_factor_and_no_delay(tmp_path, seed):
    assert _examined(tmp_path, _struck(seed)) == []


def test_a_hammer_in_pounds_is_told_by_its_force(tmp_path):
    columns = _struck(0)
    columns[:, 3] /= 4.448
    (found,) = _examined(tmp_path, columns)
    assert found.channel == "force" and found.value == pytest.approx(1 / 4.448, rel=0.06)
