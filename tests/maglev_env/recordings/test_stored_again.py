"""A buffer that was stored again is found by its rows; coarse, quiet and periodic records repeat by themselves."""

import json

import numpy as np
import pytest
import xarray as xr
from scipy.signal import lfilter

from maglev_env.recordings.alarms.rules import find_alarms
from maglev_env.recordings.alarms.stored_again import blocks_stored_again

RATE, N = 10_000.0, 4000
T = np.arange(N) / RATE


def _record(noise=0.3e-6, step=1e-8, seed=11):
    """A position that steps, the command made of it, and a current, as (samples,) each."""
    rng = np.random.default_rng(seed)
    wanted = 20e-6 * np.sign(np.sin(2 * np.pi * 7 * T))
    moved = lfilter([0.02], [1, -0.98], wanted) + noise * rng.standard_normal(N)
    moved = np.round(moved / step) * step
    command = 9000 * (wanted - moved)
    current = np.round((lfilter([0.3], [1, -0.7], command) + 0.002 * rng.standard_normal(N)) / 1e-4) * 1e-4
    return {"displacement": moved, "command": command, "current": current}


def _dataset(channels, **attributes):
    made = {n: ("time", v) for n, v in channels.items()}
    return xr.Dataset(made, attrs={"sample_rate": RATE, **attributes})


def _stale(channels, at, length):
    changed = {n: v.copy() for n, v in channels.items()}
    for k in at:
        for values in changed.values():
            values[k : k + length] = values[k - length : k]
    return changed


@pytest.mark.parametrize(
    ("at", "length", "severity"),
    [((1024, 2048, 3072), 256, "refuse"), ((700,), 36, "warning"), ((1024, 1280), 256, "refuse")],
)
def test_a_buffer_that_was_stored_again_is_found(at, length, severity):
    channels = _record()
    assert not find_alarms(_dataset(channels))
    (alarm,) = find_alarms(_dataset(_stale(channels, at, length)), start=5)
    assert (alarm.code, alarm.channel, alarm.severity) == ("samples", "all channels", severity)
    assert alarm.time == at[0] / RATE and f"samples {at[0] + 5} .. " in alarm.sentence
    assert f"those {length} samples earlier" in alarm.sentence and "leave them out: start = " in alarm.sentence


def test_one_channel_that_repeats_is_no_buffer():
    channels = _record()
    stale = _stale(channels, (1024,), 256)
    assert not find_alarms(_dataset(channels | {"command": stale["command"]}))


@pytest.mark.parametrize("step", [2e-6, 10e-6])
def test_coarse_and_quiet_readings_repeat_by_themselves(step):
    """All three channels of a quiet loop are alike in each of its steps."""
    quiet = _record(noise=0.0, step=step)
    quiet["current"] = np.round(quiet["command"] / 0.05) * 0.05
    assert not blocks_stored_again(_dataset(quiet))


def test_a_simulation_without_noise_repeats_with_its_period():
    t = np.arange(4000)
    wave = np.round(1e6 * (np.sin(2 * np.pi * (t % 1000) / 1000) + np.sin(2 * np.pi * 7.3 * (t % 1000) / 1000))) / 1e12
    wave += 1e-7 * np.tile(np.random.default_rng(1).standard_normal(1000), 4)
    wave[:2500] += 1e-6 * np.exp(-t[:2500] / 300)  # 1500 samples are a copy
    stated = json.dumps({"excitations": [{"kind": "multisine", "fundamental": 10.0}]})
    channels = {"displacement": wave, "current": 2e5 * wave}
    assert not find_alarms(_dataset(channels, experiment=stated))
    assert find_alarms(_dataset(channels))  # where no period is known, it is a stretch that was stored again
