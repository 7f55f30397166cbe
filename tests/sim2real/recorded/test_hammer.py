"""A hammer's taps on a platform whose controller nobody knows, from a loop written here."""

import numpy as np

from maglev_env.recordings.campaign import load_campaign
from sim2real.recorded.records import read_records

RATE, STEPS, SECONDS = 5000.0, 4, 4.0
MASS, GAP, BIAS, GAIN = 3.2, 0.8e-3, 1.5, 60.0
KP, KD, TD = 3000.0, 4.0, 3e-4


def tapped(seed: int) -> dict[str, np.ndarray]:
    """Force (N), displacement (m) and current (A); the controller answers one sample late."""
    rng, n = np.random.default_rng(seed), int(SECONDS * RATE)
    force, c, h = np.zeros(n), GAIN * GAP**2 / (4 * BIAS), 1 / (RATE * STEPS)
    for at in range(2000, n - 2000, 4500):
        force[at : at + 30] = rng.uniform(40, 80) * np.sin(np.pi * np.arange(30) / 30) ** 2
    y = v = i = slow = 0.0
    u, found = 0.0, np.empty((2, n))
    for k in range(n):
        reading = y + 3e-7 * rng.normal()
        found[:, k] = reading, i + 3e-3 * rng.normal()
        command, fast = u, (reading - slow) / TD
        slow += fast / RATE
        u = -KP * reading - KD * fast
        for _ in range(STEPS):
            i += h * (command - i) / 2e-4
            pull = c * (((BIAS + i) / (GAP - y)) ** 2 - ((BIAS - i) / (GAP + y)) ** 2)
            v += h * (pull + force[k]) / MASS
            y += h * v
    return {"force": force, "displacement": found[0], "current": found[1]}


def test_what_a_recorded_force_moves_is_compared_along_it(tmp_path):
    (tmp_path / "rig.toml").write_text(
        'schema = "maglev-rig/1"\nname = "platform"\nmagnet = "electromagnet_pair"\n[parameters]\n'
        f"mass = {MASS}\ngap = {GAP}\nbias_current = {BIAS}\nactuator_gain = {GAIN}\n"
        "adc_bits = 0\ndac_bits = 0\ncontrol_rate = 10000.0\n"
    )
    np.savez(tmp_path / "taps.npz", **tapped(1))
    (tmp_path / "campaign.toml").write_text(
        'schema = "maglev-campaign/1"\nrig = "rig.toml"\n[[recording]]\nfile = "taps.npz"\nsample_rate = 5000.0\n'
        'excitation = { kind = "recorded", at = "force" }\n[recording.channels]\n'
        + "".join(f'{name} = {{ from = "{name}" }}\n' for name in ("force", "displacement", "current"))
    )
    _, (record,) = read_records(load_campaign(tmp_path))
    assert record.instrument is not None and record.told.sum() > 5
    assert any("reference, injection or force is compared" in note for note in record.notes)
