"""A rotor that bends, of an integrator of its own, in the fit of one rig to its recordings."""

import numpy as np
import pytest

from maglev_env.recordings.campaign import load_campaign
from maglev_workbench.commands.estimate.pooled_report import pooled_json
from sim2real.pooled import pooled
from sim2real.recorded.records import read_records

RATE, MOVER, BODY, GAIN, STIFFNESS = 5000.0, 2.5, 1.5, 80.0, -180e3
MODE, LOSS, LAG, KP, KD, TD = 150.0, 0.01, 2e-4, 6000.0, 12.0, 4e-4


def sweep(samples: int, bends: bool, seed: int) -> np.ndarray:
    """Command, current, displacement and injection (samples, 4) under a chirp; explicit steps of 20 us."""
    rng, steps = np.random.default_rng(seed), 10
    h, t = 1 / RATE / steps, np.arange(samples) / RATE
    chirp = 0.2 * np.sin(2 * np.pi * (10 * t + (300 - 10) / 2 / t[-1] * t**2))
    reduced = 1 / (1 / MOVER + 1 / BODY)
    k, c = reduced * (2 * np.pi * MODE) ** 2, 2 * LOSS * reduced * 2 * np.pi * MODE
    mass, follows = MOVER if bends else MOVER + BODY, float(np.exp(-h / LAG))
    y = v = r = w = i = d = last = 0.0  # r, w: the body's motion
    rows = np.zeros((samples, 4))
    for n in range(samples):
        read = y + 1e-7 * rng.standard_normal()
        d = (TD * d - KD * (read - last)) / (TD + 1 / RATE)
        last = read
        command = -KP * read + d + chirp[n]
        rows[n] = command, i + 1e-3 * rng.standard_normal(), read, chirp[n]
        for _ in range(steps):
            pull = k * (r - y) + c * (w - v) if bends else 0.0
            # Leapfrog: velocities lie half a step before the positions. The current follows exactly.
            v += h * (GAIN * i - STIFFNESS * y + pull) / mass
            w -= h * pull / BODY
            y, r = y + h * v, r + h * w
            i = command + (i - command) * follows
    return rows


def campaign(folder, bends):
    np.savez(folder / "run.npz", x=sweep(15_000, bends, 1))
    (folder / "rig.toml").write_text(
        f"""schema = "maglev-rig/1"
name = "bends"
magnet = "electromagnet_pair"
[parameters]
mass = {MOVER + BODY}
gap = 0.5e-3
bias_current = 2.0
actuator_gain = 76.0
negative_stiffness = -170e3
control_rate = {RATE}
adc_bits = 0
dac_bits = 0
amplifier_time_constant = {LAG}
[gains]
kp = {KP}
ki = 0.0
kd = {KD}
td = {TD}
[tolerance]
mass = 0.01
""",
        encoding="utf-8",
    )
    (folder / "campaign.toml").write_text(
        f"""schema = "maglev-campaign/1"
rig = "rig.toml"
[[recording]]
file = "run.npz"
sample_rate = {RATE}
controller = {{ form = "pid", kp = {KP}, kd = {KD}, td = {TD} }}
excitation = {{ kind = "recorded", at = "current" }}
[recording.channels]
command = {{ from = "x[0]" }}
current = {{ from = "x[1]" }}
displacement = {{ from = "x[2]" }}
injection = {{ from = "x[3]" }}
""",
        encoding="utf-8",
    )
    return read_records(load_campaign(folder))[1]


@pytest.mark.slow
@pytest.mark.parametrize("bends", [True, False])
def test_a_rotor_that_bends_is_fitted_with_its_mode(tmp_path, bends):
    found = pooled(campaign(tmp_path, bends))
    told = {c.name: c for c in found.coefficients}
    for name, truth in (("actuator_gain", GAIN), ("negative_stiffness", STIFFNESS)):
        assert told[name].bounded and abs(told[name].value - truth) < 3 * told[name].se < 0.25 * abs(truth), name
    assert found.misfit < 2.0
    said = [note for note in found.notes if "the rotor bends" in note]
    assert len(said) == bends
    assert (found.second_body is not None) == bends
    if bends:
        body = pooled_json(found)["second_body"]
        assert body["share"] == pytest.approx(BODY / (MOVER + BODY), rel=0.05)
        assert body["mode_hz"] == pytest.approx(MODE, rel=0.01)
        assert "38% of the stated mass" in said[0] and f"at {MODE:.4g} Hz"[:7] in said[0]
