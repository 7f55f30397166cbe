"""A rotor on springs that follows a recorded random reference while something else shakes it.

By exact steps of the linear rig at the controller's rate.
"""

import numpy as np
import pytest
import scipy.signal
from test_shaken_rotor import KD, KP, LAG, MASS, PULL, RATE, RIG, SPRING, TD

import sim2real
from sim2real.recorded.records import read_records
from sim2real.search import attribute

SAMPLES, GAIN, DAMPING = 40_000, 30.0, 30.0  # the rig states 40 N/A
FORCE, FREQUENCY = 1.0, 73.3
CONTROLLER = f'form = "pid", kp = {KP}, ki = 0.0, kd = {KD}, td = {TD}'
RECORDING = """
[[recording]]
file = "{name}.npz"
role = "{role}"
sample_rate = {rate}
controller = {{ {controller} }}
excitation = {{ kind = "recorded", at = "reference" }}
[recording.channels]
displacement = {{ from = "displacement" }}
command = {{ from = "command" }}
current = {{ from = "current" }}
reference = {{ from = "reference" }}
"""


def run(seed, samples):
    rng = np.random.default_rng(seed)
    band = scipy.signal.butter(4, [5, 250], "band", fs=RATE, output="sos")
    reference = scipy.signal.sosfilt(band, rng.standard_normal(samples))
    reference *= 8e-6 / reference.std()
    push = FORCE * np.sin(2 * np.pi * FREQUENCY * np.arange(samples) / RATE + rng.uniform(0, 6))
    motion = [[0, 1, 0], [-(SPRING + PULL) / MASS, -DAMPING / MASS, GAIN / MASS], [0, 0, -1 / LAG]]
    inputs = [[0, 0], [1 / MASS, 0], [0, 1 / LAG]]
    step, moved, *_ = scipy.signal.cont2discrete(
        (np.array(motion), np.array(inputs), np.eye(3), np.zeros((3, 2))), 1 / RATE
    )
    state, slope, last, found = np.zeros(3), 0.0, 0.0, np.empty((3, samples))
    for k, (y_noise, i_noise) in enumerate(rng.standard_normal((samples, 2)) * (3e-7, 2e-3)):
        error = reference[k] - state[0] - y_noise
        slope += ((error - last) * RATE - slope) / (1 + TD * RATE)
        last, command = error, KP * error + KD * slope
        found[:, k] = state[0] + y_noise, command, state[2] + i_noise
        state = step @ state + moved @ (push[k], command)
    return dict(zip(("displacement", "command", "current"), found, strict=True), reference=reference)


def campaign(folder, controller=CONTROLLER, samples=SAMPLES):
    (folder / "rig.toml").write_text(RIG.replace("negative_stiffness = -80e3", "negative_stiffness = -60e3"))
    text = 'schema = "maglev-campaign/1"\nrig = "rig.toml"\n'
    for n, role in enumerate(("fit", "fit", "holdout")):
        np.savez(folder / f"run{n}.npz", **run(n, samples))
        text += RECORDING.format(name=f"run{n}", role=role, rate=RATE, controller=controller)
    (folder / "campaign.toml").write_text(text)
    return folder


@pytest.mark.slow
def test_a_vibration_in_the_band_of_the_drive_is_told_from_a_mode(tmp_path, monkeypatch):
    few = ("actuator_gain", "negative_stiffness", "support_resonance", "sensor_resonance", "delay", "mass", "damping")
    monkeypatch.setattr(attribute, "single_effects", lambda rig: few)
    found = sim2real.diagnose(campaign(tmp_path, samples=SAMPLES // 2))
    assert found.verdict == "explained" and set(found.cause) == {"actuator_gain", "foreign_vibration"}
    own = found.corrected.effects["foreign_vibration"]
    assert own["frequency"] == pytest.approx(FREQUENCY, abs=0.01)
    assert own["force"] == pytest.approx(FORCE, rel=0.02)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("controller", "share"),
    [(CONTROLLER.replace('form = "pid", ', ""), 23), (CONTROLLER.replace("kp = 3500.0", "kp = 3000.0"), 7)],
    ids=["another form", "another gain"],
)
def test_a_controller_that_did_not_make_the_command_is_not_used(tmp_path, controller, share):
    """What it makes otherwise had counted as an injection, so that every cause was refuted."""
    _, records = read_records(campaign(tmp_path, controller))
    for record in records:
        (said,) = [note for note in record.notes if "not the one that made the command" in note]
        assert f"{share} % of it" in said
    assert "not the one" not in " ".join(read_records(campaign(tmp_path))[1][0].notes)
