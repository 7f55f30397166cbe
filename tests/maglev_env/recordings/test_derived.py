"""Channels that stand in for missing ones, against closed forms."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from maglev_env.recordings.alarms.alarm import alarms_of
from maglev_env.recordings.campaign import load_campaign
from maglev_env.recordings.derived import coil_current, displacements, induced_left_out, integrated_twice
from maglev_env.recordings.recording import read_recording
from maglev_env.rig.rig import Rig

RATE = 2000.0
T = np.arange(4000) / RATE


def test_an_acceleration_becomes_the_displacement_of_its_lines():
    motion = 2e-5 * np.sin(2 * np.pi * 20 * T + 0.3) + 1e-6 * np.cos(2 * np.pi * 155 * T)
    measured = -2e-5 * (40 * np.pi) ** 2 * np.sin(2 * np.pi * 20 * T + 0.3) - 1e-6 * (310 * np.pi) ** 2 * np.cos(
        2 * np.pi * 155 * T
    )
    found, slowest = integrated_twice(measured + 0.4, RATE)
    assert found == pytest.approx(motion, abs=1e-11) and slowest == 2.0


def test_noise_that_would_be_most_of_the_motion_is_not_integrated():
    rng, t = np.random.default_rng(3), np.arange(40_000) / RATE
    tones = {40: 3e-5 * np.sin(2 * np.pi * 40 * t), 11: 2e-5 * np.sin(2 * np.pi * 11 * t)}
    motion = tones[40] + tones[11]
    measured = sum(-((2 * np.pi * f) ** 2) * tone for f, tone in tones.items())
    found, slowest = integrated_twice(measured + 0.1 * rng.normal(size=t.size), RATE)
    assert 5.0 < slowest < 11.0 and np.std(found - motion) < 0.1 * np.std(motion)
    quiet, least = integrated_twice(measured + 1e-5 * rng.normal(size=t.size), RATE)
    assert least == 0.2 and np.std(quiet - motion) < 0.02 * np.std(motion)


def test_a_voltage_becomes_the_current_of_the_coil():
    voltage = np.where(T < 0.5, 1.0, 3.0)
    found = coil_current(voltage, RATE, 2.0, 0.1)
    exact = solve_ivp(lambda t, i: ((1.0 if t < 0.5 else 3.0) - 2.0 * i) / 0.1, (0, T[-1]), [0.5], t_eval=T,
                      max_step=1 / RATE, rtol=1e-9, atol=1e-12).y[0]  # fmt: skip
    assert found == pytest.approx(exact, abs=2e-3)  # the step falls between two steps of the integrator
    assert found[-1] == pytest.approx(1.5, abs=1e-4)


def test_a_coil_does_not_start_with_the_kick_of_a_step():
    voltage = np.full(T.size, 1.0)
    voltage[:20] = 0.0  # 10 ms of a time constant of 50 ms: a controller that starts at a limit
    found = coil_current(voltage, RATE, 2.0, 0.1)
    assert found[0] == 0.5 and found[20] == pytest.approx(0.5 * np.exp(-0.2), rel=1e-9)


def test_a_recorded_displacement_is_kept():
    found, notes = displacements({"acceleration_x": T, "displacement_y": T, "acceleration_y": T}, RATE)
    assert set(found) == {"displacement_x"} and len(notes) == 1


def test_the_drift_of_an_integrated_acceleration_is_no_lost_levitation(tmp_path):
    # As long as a sweep takes, and with an accelerometer's noise: integrated, it wanders over millimetres.
    rng = np.random.default_rng(2)
    t = np.arange(40_000) / RATE
    moved = 20.0 * np.sin(2 * np.pi * 40 * t) + 0.5 * rng.normal(size=t.size)
    moved += 5e-3 * np.cumsum(rng.normal(size=t.size))  # louder than the white noise below 3 Hz
    np.savez(tmp_path / "run.npz", acc=moved, i=0.3 + 0.1 * np.sin(2 * np.pi * 40 * t) + 1e-3 * rng.normal(size=t.size))
    (tmp_path / "campaign.toml").write_text(
        f"""schema = "maglev-campaign/1"
rig = "hmb_free"
[[recording]]
file = "run.npz"
sample_rate = {RATE}
excitation = {{ kind = "none" }}
[recording.channels]
acceleration = {{ from = "acc" }}
current = {{ from = "i" }}
""",
        encoding="utf-8",
    )
    loaded = load_campaign(tmp_path)
    dataset = read_recording(loaded, loaded.recordings[0], alarmed=True)
    assert np.ptp(dataset["displacement"].values) > 2 * loaded.rig.clearance
    assert not [a for a in alarms_of(dataset) if a.code == "lost levitation"]


COIL = Rig(
    "disc", "electromagnet", mass=0.05, gap=8e-3, clearance=8e-3, force_constant=3.6e-5, gap_offset=6e-3,
    coil_resistance=3.2, coil_inductance=0.0451, amplifier_gain=1 / 3.2, amplifier_time_constant=14.1e-3,
)  # fmt: skip


@pytest.mark.parametrize(
    ("rig", "channels", "said"),
    [
        (COIL, ("displacement", "command"), True),
        (COIL, ("displacement", "command", "current"), False),  # the current shows what was induced
        (COIL, ("displacement", "voltage"), False),
        (replace(COIL, amplifier_time_constant=1e-3), ("displacement", "command"), False),  # its current is controlled
        (replace(COIL, coil_inductance=None), ("displacement", "command"), False),
        (None, ("displacement", "command"), False),
    ],
)
def test_a_command_that_is_a_voltage_lacks_what_the_motion_induces(rig, channels, said):
    found = induced_left_out(rig, channels)
    assert bool(found) == said
    # A stated controller is simulated through the amplifier, and the current that was measured is not used.
    assert bool(induced_left_out(rig, channels, simulated=True)) == (said or "current" in channels)
    if said:  # k_i^2 / R with k_i = 2 m g / i_0
        gain = 2 * 0.05 * rig.gravity / (0.014 * np.sqrt(0.05 * rig.gravity / 3.6e-5))
        assert f"{gain**2 / 3.2:.2g} N s/m" in found[0] and "name the channel voltage" in found[0]
