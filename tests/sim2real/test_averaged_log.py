"""An active bearing without a support, whose log holds means of four control samples of position and current.

By exact steps of the linear rig. The controller and what was added to its command are not known.
"""

import numpy as np
import pytest
import scipy.signal

from sim2real.pooled import pooled
from sim2real.recorded.records import read_records

RATE, EVERY, SAMPLES = 20_000.0, 4, 60_000
MASS, GAIN, PULL, DAMPING, LAG = 1.3, 288.0, -1.152e6, 2.0, 1.5e-4
KP, KI, KD, TD = 9000.0, 60e3, 9.0, 1e-4
RIG = """\
schema = "maglev-rig/1"
name = "bearing"
magnet = "electromagnet_pair"

[parameters]
mass = 1.3
turns = 200
pole_area = 6.6e-4
gap = 0.5e-3
bias_current = 2.0
amplifier_time_constant = 1.5e-4
control_rate = 20000.0
adc_bits = 0
dac_bits = 0

[noise]
displacement = 3e-7
current = 2e-3
"""
CAMPAIGN = """\
schema = "maglev-campaign/1"
rig = "rig.toml"

[[recording]]
file = "run.npz"
role = "fit"
sample_rate = 5000.0
excitation = { kind = "none" }

[recording.channels]
displacement = { from = "displacement" }
current = { from = "current" }
"""


def campaign(folder, seed):
    rng = np.random.default_rng(seed)
    added = scipy.signal.sosfilt(scipy.signal.butter(2, 600, fs=RATE, output="sos"), rng.standard_normal(SAMPLES))
    motion = np.array([[0, 1, 0], [-PULL / MASS, -DAMPING / MASS, GAIN / MASS], [0, 0, -1 / LAG]])
    inputs = np.array([[0], [0], [1 / LAG]])
    step, moved, *_ = scipy.signal.cont2discrete((motion, inputs, np.eye(3), np.zeros((3, 1))), 1 / RATE)
    state, total, slope, last, command, states = np.zeros(3), 0.0, 0.0, 0.0, 0.0, np.empty((SAMPLES, 3))
    for k, noise in enumerate(3e-7 * rng.standard_normal(SAMPLES)):
        reading = state[0] + noise
        states[k] = reading, state[1], state[2]
        state = step @ state + moved[:, 0] * command  # which was computed one sample ago
        total += KI * reading / RATE
        slope += ((reading - last) * RATE - slope) * (1 - np.exp(-1 / (RATE * TD)))
        last = reading
        command = -KP * reading - KD * slope - total + 0.8 * added[k]
    means = states.reshape(-1, EVERY, 3).mean(axis=1)
    (folder / "rig.toml").write_text(RIG)
    (folder / "campaign.toml").write_text(CAMPAIGN)
    current = means[:, 2] + 2e-3 * rng.standard_normal(len(means))
    np.savez(folder / "run.npz", displacement=means[:, 0], current=current)
    return folder


@pytest.mark.slow
def test_what_is_told_well_is_bounded_however_much_noise_is_in_the_drive(tmp_path):
    """The bearing alone makes the motion that its current does, so gain and pull follow; they had not been given."""
    found = {c.name: c for c in pooled(read_records(campaign(tmp_path, 5))[1]).coefficients}
    for name, truth in (("actuator_gain", GAIN), ("negative_stiffness", PULL)):
        c = found[name]
        assert c.identified and abs(c.value - truth) < 3 * c.se < 0.04 * abs(truth), name
