"""What lies between a quantity and its channel is undone: against signals known in closed form."""

import numpy as np
import pytest
from scipy import signal

from maglev_env.recordings.campaign import load_campaign
from maglev_env.recordings.campaign_tables import channel_table
from maglev_env.recordings.measurement_chain import corrected, coupled
from maglev_env.recordings.recording import read_recording

RATE = 1000.0


def true(at):
    return 0.3 * at + np.sin(2 * np.pi * 7 * at) + 0.2 * np.cos(2 * np.pi * 31 * at)


def test_a_low_pass_and_a_delay_are_undone():
    t = np.arange(4000) / RATE
    corner, delay = 80.0, 2.5e-3
    fine = np.arange(-0.5, 4.0, 1e-5)  # a first-order low-pass in continuous time, begun well before the record
    system = signal.lti([1.0], [1 / (2 * np.pi * corner), 1.0])
    _, filtered, _ = signal.lsim(system, true(fine - delay), fine - fine[0], X0=None)
    logged = np.interp(t, fine, filtered)
    found = corrected(logged, RATE, (corner,), delay)
    inside = slice(200, -200)  # the ends are continued by a guess
    assert abs(found - true(t))[inside].max() < 1e-3
    assert abs(logged - true(t))[inside].max() > 0.3


@pytest.mark.parametrize("corners", [(0.7,), (0.7, 3.0)])
def test_what_an_ac_coupling_takes_away_comes_back(corners):
    t, fine = np.arange(20000) / RATE, np.arange(-5.0, 20.0, 1e-4)
    steps = np.sign(np.sin(2 * np.pi * 0.45 * fine)) + 0.3 * np.sin(2 * np.pi * 6 * fine)
    logged = steps
    for corner in corners:  # high-passes in continuous time, begun well before the record
        system = signal.lti([1.0, 0.0], [1.0, 2 * np.pi * corner])
        _, logged, _ = signal.lsim(system, logged, fine - fine[0])
    wanted, read = (np.interp(t, fine, v) for v in (steps, logged + 0.2))  # a zero that is 0.2 off
    left = coupled(read, RATE, corners) - wanted  # but for what nothing tells: a mean, a trend, a parabola
    assert np.std(read - wanted) > 0.5
    assert np.std(left - np.polyval(np.polyfit(t, left, len(corners)), t)) < 0.05
    assert np.std(left) < 0.2


def test_a_straight_line_comes_back_exactly():
    t = np.arange(500) / RATE
    assert corrected(2.0 * (t - 0.004), RATE, (), 0.004) == pytest.approx(2.0 * t, abs=1e-12)


@pytest.mark.parametrize("corners", [(80.0,), (160.0, 300.0)])
def test_the_low_pass_of_a_current_behind_a_held_command_is_undone_above_half_the_rate_too(corners):
    held, fine, n = 1.3e-3, 200, 300
    command = np.repeat(np.random.default_rng(2).normal(size=n), fine)
    current, metered = 0.0, np.zeros(len(corners))
    true_samples, logged = np.empty(n), np.empty(n)
    step = 1 / (RATE * fine)
    for k, u in enumerate(command):  # Euler steps of 5 us; a sample is read before its command acts
        if k % fine == 0:
            true_samples[k // fine], logged[k // fine] = current, metered[-1]
        change = np.diff([current, *metered], prepend=u)
        current -= step / held * change[0]
        metered -= step * 2 * np.pi * np.array(corners) * change[1:]
    inside = slice(60, -60)
    found = corrected(logged, RATE, corners, 0.0, held)
    assert np.std((found - true_samples)[inside]) < 1e-2 * np.std(true_samples)
    assert np.std((corrected(logged, RATE, corners, 0.0) - true_samples)[inside]) > 0.1 * np.std(true_samples)


def test_a_straight_line_comes_as_late_as_low_pass_and_delay_make_it():
    """A ramp behind a low-pass of corner f and a delay d lies 1 / (2 pi f) + d behind itself."""
    rate, corner, delay = 1000.0, 20.0, 3e-3
    t = np.arange(400) / rate
    behind = 5.0 * (t - 1 / (2 * np.pi * corner) - delay)
    np.testing.assert_allclose(corrected(behind, rate, (corner,), delay), 5.0 * t, atol=1e-6)


def test_a_channel_states_its_coupling():
    found = channel_table("current", {"from": "i", "high_pass": [3.5]})
    assert found.high_pass == (3.5,) and found.filter == () and found.chained
    for key, value in (("total", True), ("offset_tolerance", 0.01)):
        with pytest.raises(ValueError, match="its mean, which high_pass has taken away"):
            channel_table("current", {"from": "i", "high_pass": [3.5], key: value})
    with pytest.raises(ValueError, match=r"high_pass = .*above 0"):
        channel_table("current", {"from": "i", "high_pass": [0.0]})


def test_a_channel_states_the_calibration_of_a_bent_sensor(tmp_path):
    counts = np.linspace(400.0, 900.0, 501)
    np.savez(tmp_path / "run.npz", adc=counts)
    text = """schema = "maglev-campaign/1"
[[recording]]
file = "run.npz"
sample_rate = 100.0
excitation = { kind = "none" }
[recording.channels]
displacement = { from = "adc", polynomial = [5.5, 7e-3, 3e-6], scale = -1e-3, offset = 0.012 }
"""
    (tmp_path / "campaign.toml").write_text(text)
    campaign = load_campaign(tmp_path)
    read = read_recording(campaign, campaign.recordings[0])["displacement"].values
    np.testing.assert_allclose(read, 0.012 - 1e-3 * (5.5 + 7e-3 * counts + 3e-6 * counts**2), rtol=1e-12)
    for wrong in ([5.5], [5.5, 0.0]):
        with pytest.raises(ValueError, match="constant"):
            channel_table("displacement", {"from": "adc", "polynomial": wrong})
