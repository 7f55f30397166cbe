"""A set point whose file rounds it: the controller has seen what the digits have lost, and not what they have added."""

from dataclasses import replace

import numpy as np
import pytest
from ball_bench import record, write_campaign
from test_limits import PID, RIGS

from maglev_env.loop.gains import as_table
from maglev_env.recordings.campaign import load_campaign
from maglev_env.recordings.campaign_writer import toml_value
from maglev_env.redundancy.rounded import digit
from maglev_env.redundancy.rules import examine

SAMPLES, DIGIT = 15_000, 1e-5  # m


def run_of(seed):
    """Noise of 2 to 40 Hz at the set point, and what the loop makes of it."""
    rig, rng = RIGS[PID][0], np.random.default_rng(seed)
    gains = replace(rig.gains, kd=5.0, td=5e-4, derivative_on="error", setpoint_filter=0.0, limit=None)
    rig = replace(rig, gains=gains)
    spectrum = np.fft.rfft(rng.standard_normal(SAMPLES))
    frequency = np.fft.rfftfreq(SAMPLES, 1 / rig.control_rate)
    reference = np.fft.irfft(spectrum * ((frequency > 2) & (frequency < 40)), SAMPLES)
    reference *= 6e-5 / reference.std()
    run = record(rig, SAMPLES / rig.control_rate, seed, np.zeros(SAMPLES), reference)
    return rig, run | {"reference": DIGIT * np.round(reference / DIGIT)}


def said_of(folder, factor, seed):
    rig, run = run_of(seed)
    run["reference"] = factor * run["reference"]
    write_campaign(folder, RIGS[PID][1], toml_value(as_table(rig.gains)), {"run": run}, channels=tuple(run))
    return [f for f in examine(load_campaign(folder)) if "reference" in f.channel or "gains" in f.channel]


@pytest.mark.parametrize("seed", range(4))
def test_a_sound_set_point_is_not_accused(tmp_path, seed):
    assert said_of(tmp_path, 1.0, seed) == []


def test_a_set_point_of_another_scale_still_is(tmp_path):
    assert any("reference" in f.channel for f in said_of(tmp_path, 1.3, 1))


def test_the_digits_of_a_column_are_told_from_the_steps_of_its_signal():
    rng = np.random.default_rng(0)
    noise = 1e-4 * rng.standard_normal(5000)
    assert digit(1e-6 * np.round(noise / 1e-6)) == pytest.approx(1e-6)
    assert digit(noise) == 0.0
    assert digit(np.repeat(rng.choice([-1e-4, 0.0, 1e-4], 50), 100)) == 0.0
