"""What of a drive its past leaves unexplained, on a loop written here; and a meter's unstated low-pass."""

from dataclasses import replace

import bench_loop
import numpy as np
import pytest
from scipy import signal

from maglev_env.recordings.campaign import load_campaign
from sim2real.compared.point import Point
from sim2real.compared.problem import assemble
from sim2real.pooled import pooled
from sim2real.recorded.drive.innovation import OWN, OWN_SPREAD, innovations
from sim2real.recorded.nuisances import Nuisances
from sim2real.recorded.open_reading import METERED, UNTOLD_ALONG
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
    found, past, _ = innovations(current, reading, TAPS, late)
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


def test_the_own_noise_of_a_log_enters_the_innovation_by_the_weights_of_the_readings():
    current, reading, _, noise = _loop(False)
    own = 1e-2 * np.random.default_rng(4).normal(size=SAMPLES)
    e, _, answer = innovations(current, (reading[0] - noise + own)[None], TAPS, False)
    shared = np.array([np.mean(e[0, TAPS + 1 :] * np.roll(own, age)[TAPS + 1 :]) for age in range(1, TAPS + 1)])
    error = e.std() * own.std() / np.sqrt(SAMPLES)
    np.testing.assert_allclose(shared, -answer[0] * own.var(), atol=4 * error)
    assert abs(answer[0]).max() * own.var() > 10 * error


@pytest.mark.slow
def test_an_unstated_low_pass_of_the_meter_does_not_look_like_damping(tmp_path):
    bench = bench_loop.Bench(current_noise=0.0)
    folder = bench_loop.write_campaign(tmp_path, bench, {"noise": "fit"}, 2.0, 5)
    lag = np.exp(-1 / 0.4)  # of 0.4 samples
    record = _unknown_controller(
        folder, lambda run: run | {"current": signal.lfilter([1 - lag], [1, -lag], run["current"])}
    )
    assert "unexplained of the current" in record.notes[-1]
    truth = {"negative_stiffness": bench_loop.STIFFNESS, "actuator_gain": bench_loop.GAIN, "damping": 0.0}
    found = {c.name: c for c in pooled([record]).coefficients}
    z = {name: (found[name].value - value) / found[name].se for name, value in truth.items()}
    assert max(map(abs, z.values())) < 3, z
    # A current that is late by half a sample would look like this damping.
    assert found["damping"].se < 0.5 * abs(bench_loop.STIFFNESS) / bench_loop.RATE


def _unknown_controller(folder, change):
    """The first recording of a campaign without its controller, after a change of its channels."""
    lines = (folder / "campaign.toml").read_text().splitlines()
    kept = [line for line in lines if not line.startswith(("gains", "command"))]
    (folder / "campaign.toml").write_text("\n".join(kept))
    run = dict(np.load(folder / "noise.npz"))
    np.savez(folder / "noise.npz", **change(run))
    campaign = load_campaign(folder)
    rig = replace(campaign.rig, noise=replace(campaign.rig.noise, current=1e-4))
    return read_records(replace(campaign, rig=rig))[1][0]


def test_a_command_that_is_logged_more_slowly_than_it_is_made_is_no_instrument_by_itself(tmp_path):
    folder = bench_loop.write_campaign(tmp_path, bench_loop.Bench(noise=5e-6), {"noise": "fit"}, 2.0, 9)
    text = (folder / "campaign.toml").read_text()
    kept = [line for line in text.splitlines() if not line.startswith(("gains", "current"))]
    (folder / "campaign.toml").write_text("\n".join(kept).replace("20000.0", "4000.0"))
    run = dict(np.load(folder / "noise.npz"))
    np.savez(folder / "noise.npz", **{name: values[::5] for name, values in run.items()})
    with pytest.raises(ValueError, match="logged more slowly than the controller makes it"):
        read_records(load_campaign(folder))


def _late(run):
    return run | {"current": np.roll(run["current"], 3)}


@pytest.mark.slow
def test_the_scale_of_a_late_current_is_as_unknown_as_the_gain(tmp_path):
    """A late current hides what the gain does unless it is late in the simulation, too."""
    folder = bench_loop.write_campaign(tmp_path, bench_loop.Bench(current_noise=0.0), {"noise": "fit"}, 2.0, 6)
    problem = assemble([_unknown_controller(folder, _late)])

    def likeness(p):
        """Of the change by the scale and of that by the gain, and their sizes for one per cent."""
        plain = replace(p, nuisances=Nuisances((), p.nuisances.columns[:0]))
        nominal, more = plain.simulate([Point({}, {}), Point({"actuator_gain": {"change": METERED}}, {})])
        scale = p.nuisances.columns[p.nuisances.names.index("scale of current")]
        sizes = np.linalg.norm(more - nominal), np.linalg.norm(scale)
        return np.vdot(more - nominal, scale).real / np.prod(sizes), sizes[0] / sizes[1]

    late = problem.about(Point({}, {})).about(Point({}, {}))
    assert late.errors["time between current and displacement"] == pytest.approx(3 / UNTOLD_ALONG, abs=0.2)
    assert likeness(late) == (pytest.approx(-1, abs=0.02), pytest.approx(1, abs=0.1))

    def left(p):
        """Of the noise, at the true rig."""
        return float(np.mean(abs(p.data - p.simulate([Point({}, {})])[0]) ** 2) / 2)

    assert left(late) < 0.95 * left(problem)


@pytest.mark.slow
def test_a_log_with_noise_of_its_own_does_not_look_like_another_stiffness(tmp_path):
    folder = bench_loop.write_campaign(tmp_path, bench_loop.Bench(current_noise=0.0), {"noise": "fit"}, 2.0, 8)

    def noisy(run):
        own = 5e-6 * np.random.default_rng(58).normal(size=run["displacement"].size)
        return run | {"displacement": run["displacement"] + own}

    record = _unknown_controller(folder, noisy)
    (name,) = (n for n in record.unsure if "own noise" in n)
    believed = replace(record, bias=record.bias - OWN / OWN_SPREAD * record.unsure[name], unsure={})
    truth = {"negative_stiffness": bench_loop.STIFFNESS, "actuator_gain": bench_loop.GAIN, "damping": 0.0}
    z, wrong = (
        {c.name: (c.value - truth[c.name]) / c.se for c in pooled([r]).coefficients if c.name in truth}
        for r in (record, believed)
    )
    assert max(map(abs, z.values())) < 2.5, z
    assert max(map(abs, wrong.values())) > 1.5 * max(map(abs, z.values())), (z, wrong)
