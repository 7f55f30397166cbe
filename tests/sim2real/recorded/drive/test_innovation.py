"""What of a drive its past leaves unexplained, on a loop written here; and a meter's unstated low-pass."""

from dataclasses import replace

import bench_loop
import numpy as np
import pytest
from scipy import signal

from maglev_env.recordings.campaign import load_campaign
from sim2real.pooled import pooled
from sim2real.recorded.drive.innovation import innovations
from sim2real.recorded.records import read_records

SAMPLES, TAPS = 20_000, 24


def _loop(late):
    """Current, reading, injection and sensor noise of a mass under PD control, with a current that lags a sample; late:
    the current is read at the end of its sample."""
    rng = np.random.default_rng(3)
    added, noise = 0.1 * rng.normal(size=SAMPLES), 1e-2 * rng.normal(size=SAMPLES)
    y, v, i, last = 0.0, 0.0, 0.0, 0.0
    current, reading = np.empty(SAMPLES), np.empty(SAMPLES)
    for k in range(SAMPLES):
        reading[k] = y + noise[k]
        command = -3.0 * reading[k] - 10.0 * (reading[k] - last) + added[k]
        last, before = reading[k], i
        i += 0.6 * (command - i)
        current[k] = i if late else before
        v += 0.02 * (i + y)  # unstable without control
        y += v
    return current[None], reading[None], added, noise


@pytest.mark.parametrize("late", [False, True])
def test_the_innovation_is_what_was_added_and_free_of_sensor_noise(late):
    current, reading, added, noise = _loop(late)
    found, past = innovations(current, reading, TAPS, late)
    e = found[0, TAPS + 1 :]
    w = (added if late else np.roll(added, 1))[TAPS + 1 :]
    assert np.corrcoef(e, w)[0, 1] > 0.99
    assert e.std() == pytest.approx(0.6 * added.std(), rel=0.05)
    assert past[0, 0] == pytest.approx(0.4, abs=0.05)  # the lag of the current
    of_noise = [np.corrcoef(e, np.roll(noise, lag)[TAPS + 1 :])[0, 1] for lag in range(3)]
    assert np.abs(of_noise).max() < 4 / np.sqrt(e.size)
    # Without the reading that a late current follows, what is left is full of that reading's noise.
    wrong = innovations(current, reading, TAPS, not late)[0][0, TAPS + 1 :]
    if late:
        assert abs(np.corrcoef(wrong, noise[TAPS + 1 :])[0, 1]) > 0.2


@pytest.mark.slow
def test_an_unstated_low_pass_of_the_meter_does_not_look_like_damping(tmp_path):
    bench = bench_loop.Bench(current_noise=0.0)
    folder = bench_loop.write_campaign(tmp_path, bench, {"noise": "fit"}, 2.0, 5)
    lines = (folder / "campaign.toml").read_text().splitlines()
    kept = [line for line in lines if not line.startswith(("gains", "command"))]
    (folder / "campaign.toml").write_text("\n".join(kept))
    run = dict(np.load(folder / "noise.npz"))
    lag = np.exp(-1 / 0.4)  # of 0.4 samples
    run["current"] = signal.lfilter([1 - lag], [1, -lag], run["current"])
    np.savez(folder / "noise.npz", **run)
    campaign = load_campaign(folder)
    rig = replace(campaign.rig, noise=replace(campaign.rig.noise, current=1e-4))
    _, (record,) = read_records(replace(campaign, rig=rig))

    assert "unexplained of the current" in record.notes[-1]
    truth = {"negative_stiffness": bench_loop.STIFFNESS, "actuator_gain": bench_loop.GAIN, "damping": 0.0}
    found = {c.name: c for c in pooled([record]).coefficients}
    z = {name: (found[name].value - value) / found[name].se for name, value in truth.items()}
    assert max(map(abs, z.values())) < 3, z
    # A current that is late by half a sample would look like this damping.
    assert found["damping"].se < 0.5 * abs(bench_loop.STIFFNESS) / bench_loop.RATE
