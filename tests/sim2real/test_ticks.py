"""The injection of a loop with jittered ticks, against the one that was added."""

import bench_loop
import numpy as np
import pytest
from bench_loop import Bench, write_campaign

from maglev_env.loop.gains import Gains
from maglev_env.recordings.campaign import load_campaign
from maglev_env.recordings.recording import read_recording
from maglev_env.recordings.time_stamps import at_steps
from sim2real.recorded.controller_output import recovered_injection
from sim2real.recorded.open_reading import AT_TICKS, NOT_AT_TICKS, open_record
from sim2real.recorded.ticks import Ticks

RATE, N = 1000.0, 4000
GAINS = Gains(2000.0, 5000.0, 10.0)


def own_output(gains, reading, dt):
    """The PID's recursion, written again."""
    lag = leak = 0.0
    out = []
    for e in -reading:
        out.append(gains.kp * e + gains.kd * (e - lag) / gains.td + gains.ki * leak)
        lag, leak = e + (lag - e) * np.exp(-dt / gains.td), e + (leak - e) * np.exp(-dt / gains.ti)
    return np.array(out)


@pytest.mark.parametrize("start", [0, 1500])
def test_the_injection_between_jittered_ticks_is_the_one_that_was_added(start):
    rng = np.random.default_rng(3)
    ticks = np.arange(N) + rng.uniform(-0.25, 0.25, N)
    ticks[0] = 0.0
    added = lambda t: 0.3 * np.sin(2 * np.pi * 0.01 * t)  # noqa: E731
    reading = 1e-6 * rng.standard_normal(N)
    command = own_output(GAINS, reading, 1 / RATE) + added(ticks)
    channels = {"command": command[None], "displacement": reading[None]}
    found = Ticks(ticks, channels, GAINS, 1 / RATE).injection(start)[0]
    steps = np.arange(start, start + found.size)
    assert steps[-1] == int(ticks[-1])
    late = 1000 if start else 0  # the controller rests at `start`, so its state there is part of the injection
    assert np.abs(found - added(steps))[late:].max() < 1e-3
    u, y = at_steps(ticks, command), at_steps(ticks, reading)
    assert np.abs(recovered_injection(GAINS, u, y, 1 / RATE) - added(np.arange(u.size))).max() > 5e-3


@pytest.mark.parametrize(
    ("line", "note", "source"), [("", AT_TICKS, "command"), (", delay = 1e-6", NOT_AT_TICKS, "current")]
)
def test_a_jittered_recording_says_how_its_controller_is_used(tmp_path, line, note, source):
    folder = write_campaign(tmp_path, Bench(), {"noise": "fit"}, 0.3, 1)
    columns = dict(np.load(folder / "noise.npz"))
    time = np.arange(columns["command"].size) / bench_loop.RATE
    columns["time"] = time + np.random.default_rng(2).uniform(-0.1, 0.1, time.size) / bench_loop.RATE
    np.savez(folder / "noise.npz", **columns)
    text = (folder / "campaign.toml").read_text().replace('from = "displacement" ', f'from = "displacement"{line} ')
    (folder / "campaign.toml").write_text(text + '\ntime = { from = "time" }\n')
    campaign = load_campaign(folder)
    dataset = read_recording(campaign, campaign.recordings[0])
    assert dataset.attrs["resampled"] and ("tick_displacement" in dataset.coords) == (not line)
    record = open_record(campaign, campaign.recordings[0], dataset)
    assert note in record.notes and record.source == source
