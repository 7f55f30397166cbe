"""`maglev selfsense calibrate` as a user runs it: tables, made-up recordings, simulated sensors and loops."""

import json
from dataclasses import replace
from functools import partial

import numpy as np
import pytest
from command_line import maglev
from scipy import stats

from estimation.multisine.sphs import harmonic_range, sphs, synthesise
from maglev_env.design.defaults import with_defaults
from maglev_env.rig.rig_file import load_rig
from maglev_env.rig.self_sensor import rig_sensors
from maglev_workbench.commands.selfsense.calibrate import sources as calibrate_sources
from maglev_workbench.commands.selfsense.calibrate.numbers import lag_at, lags, surely_within
from maglev_workbench.commands.selfsense.calibrate.sources import Dynamic
from maglev_workbench.commands.selfsense.calibrate.static_steps import static_steps
from selfsense.calibration.dynamic import dynamic_calibration
from selfsense.linear import tracking

run = partial(maglev, "selfsense", "calibrate")
GAP, RATE, HZ, PER_PERIOD = 0.35e-3, 20e3, 10.0, 2000
HEAD = 'schema = "maglev-campaign/1"\n'
# D Table 6.1: mm, mV.
TABLE_6_1 = (
    [0, 0.05, 0.10, 0.15, 0.20, 0.25, 0.30, 0.35, 0.40, 0.45, 0.49, 0.55, 0.60],
    [0, 22, 46, 68, 90, 113, 136, 158, 180, 202, 220, 222, 223],
)


def calibrated(folder, *arguments):
    """JSON, page and console text."""
    text = run(*arguments, "--out", folder / "k.html", "--json", folder / "k.json")
    return json.loads((folder / "k.json").read_text()), (folder / "k.html").read_text(), text


def csv(path, **columns):
    np.savetxt(path, np.column_stack(list(columns.values())), "%g", ",", header=",".join(columns), comments="")
    return path


def recording(folder, name, excitation, **channels):
    """Write a recording and return its part of campaign.toml."""
    np.savez(folder / f"{name}.npz", **channels)
    lines = ["[[recording]]", f'file = "{name}.npz"', f"sample_rate = {RATE}", f"excitation = {excitation}"]
    lines += ["[recording.channels]", *(f'{channel} = {{ from = "{channel}" }}' for channel in channels)]
    return "\n".join(lines) + "\n"


def multisine(lines=range(1, 251), periods=6, noise=0.0, delay=45e-6, gain=-0.98, corner=np.inf, seed=0):
    """Displacement and what a sensor with a gain and a delay makes of it, its first period disturbed."""
    rng = np.random.default_rng(seed)
    wave = synthesise(sphs(list(lines), PER_PERIOD, 40e-6), PER_PERIOD)
    f = np.fft.rfftfreq(PER_PERIOD) * PER_PERIOD * HZ
    late = np.fft.irfft(np.fft.rfft(wave) * gain * np.exp(-2j * np.pi * f * delay) / (1 + 1j * f / corner), PER_PERIOD)
    x, y = np.tile(wave, periods), GAP + np.tile(late, periods)
    x[:PER_PERIOD] += 20e-6 * np.exp(-np.arange(PER_PERIOD) / 300)
    return x + 0.1 * noise * rng.standard_normal(x.size), y + noise * rng.standard_normal(y.size)


LINES = harmonic_range(1, 100)
SPHS = f'{{ kind = "sphs", fundamental = {HZ}, harmonics = [1, 250] }}'
NONE = '{ kind = "none" }'


def test_the_dissertations_table(tmp_path):
    data, page, text = calibrated(tmp_path, csv(tmp_path / "t.csv", displacement=TABLE_6_1[0], output=TABLE_6_1[1]))
    assert data["schema"] == "maglev-selfsense-calibrate/1" and data["dynamic"] == [] and data["rig"] is None
    (found,) = data["static"]
    line = stats.linregress(TABLE_6_1[0][:11], TABLE_6_1[1][:11])
    half = stats.t.ppf(0.975, 9) * line.stderr
    assert found["gain"] == pytest.approx(449.19, abs=0.005) and found["offset"] == pytest.approx(0.383, abs=5e-4)
    assert found["gain_interval"] == pytest.approx([line.slope - half, line.slope + half])
    assert found["linearity_error"] == pytest.approx(0.0039, abs=5e-5)
    assert found["linear_range"] == [0.0, 0.49] and found["saturated_above"] == 0.49
    assert found["units"] == [None, None] and found["deviation"][-1] == pytest.approx(
        (223 - line.slope * 0.6 - line.intercept) / (line.slope * 0.49)
    )
    assert "449.2 ±2.5 of output per displacement from 0.00 to 0.490" in text and "it saturates at 0.490" in text
    assert page.count('class="plotly-graph-div"') == 1 and "0.39 % of full scale" in page


def test_a_table_may_name_its_columns_otherwise_and_saturate_on_both_sides(tmp_path):
    x = np.linspace(-1, 3, 41)
    data, _, _ = calibrated(tmp_path, csv(tmp_path / "t.csv", gauge=x, volts=-2 * np.clip(x, -0.4, 2.0) + 0.02 * x))
    (found,) = data["static"]
    assert found["quantities"] == ["gauge", "volts"] and found["gain"] == pytest.approx(-1.98, rel=1e-3)
    assert found["linear_range"] == pytest.approx([-0.4, 2.0])
    assert found["saturated_below"] == pytest.approx(-0.4) and found["saturated_above"] == pytest.approx(2.0)
    # Named columns count, wherever they stand.
    csv(tmp_path / "n.csv", row=np.arange(41), output=3 * x, displacement=x)
    assert calibrated(tmp_path, tmp_path / "n.csv")[0]["static"][0]["gain"] == pytest.approx(3)


@pytest.mark.slow
def test_the_simulated_sensor(tmp_path):
    data, page, text = calibrated(tmp_path)
    static, dynamic = data["static"][0], data["dynamic"][0]
    assert static["gain"] == pytest.approx(1.0, abs=1e-3) and static["linearity_error"] < 1e-3
    assert static["linear_range"][0] == pytest.approx(0.1 * GAP) and static["linear_range"][1] == pytest.approx(2 * GAP)
    assert static["saturated_above"] == pytest.approx(2 * GAP) and static["output"][-1] == pytest.approx(2 * GAP)
    sensor = rig_sensors(with_defaults(load_rig("hmb_free")))[0]
    assert data["sensor"]["estimator"]["kp"] == sensor.estimator.kp and data["rig"] == "hmb_free"
    f = np.array(dynamic["frequency"])
    assert f[0] == 1.0 and f[-1] == 4000.0 and f.size == 4000 and dynamic["polarity"] == 1
    expected = tracking(sensor, f)
    measured = np.array(dynamic["magnitude"]) * np.exp(1j * np.radians(dynamic["phase"]))
    error = np.abs(measured - expected) / np.array(dynamic["standard_error"])
    assert np.sqrt(np.mean(error**2)) == pytest.approx(1.0, abs=0.1)  # the model holds to the noise
    for at, lag in ((150.0, 2.43), (4000.0, 35.02)):
        model = -np.degrees(np.angle(expected[np.argmin(np.abs(f - at))]))
        found = next(entry for entry in dynamic["lags"] if entry["frequency"] == at)
        assert model == pytest.approx(lag, abs=0.01)
        assert found["lag"] == pytest.approx(model, abs=2 * found["half_width"]) and found["half_width"] < 1.0
    low, high = dynamic["delay_interval"]
    assert low < dynamic["delay"] < high < low + 0.1e-6 and dynamic["delay"] == pytest.approx(26.3e-6, abs=0.1e-6)
    assert dynamic["bandwidth"] is None and dynamic["surely_within"] == 4000.0  # infinite: no line shows it
    assert "4000 Hz or more" in text and "° at 150 Hz and 35.1" in text and page.count('class="plotly-graph-div"') == 2
    for words in ("556 µs", "30° at 150 Hz", "linear model", "it saturates at 0.700 mm", "seed", "8 periods"):
        assert words.lower() in page.lower()


def test_too_noisy_a_reading_starts_the_sweep_farther_from_contact():
    sensor = rig_sensors(with_defaults(load_rig("hmb_free")))[0]
    assert calibrate_sources._sweep(sensor)[0][0] == pytest.approx(0.1 * sensor.gap)
    noisy = replace(sensor, acquisition=replace(sensor.acquisition, noise=15e-3))
    gaps, estimates = calibrate_sources._sweep(noisy)
    assert 0.1 * sensor.gap < gaps[0] <= 0.5 * sensor.gap and np.isfinite(estimates).all()
    with pytest.raises(ValueError, match="'no ripple'"):
        calibrate_sources._sweep(replace(sensor, acquisition=replace(sensor.acquisition, noise=1.0)))


def test_a_recorded_delay_and_gain_come_back(tmp_path):
    x, y = multisine(noise=0.2e-6)
    rest = recording(tmp_path, "still", NONE, displacement=x)
    (tmp_path / "campaign.toml").write_text(
        HEAD + 'rig = "hmb_free"\n' + recording(tmp_path, "run", SPHS, displacement=x, gap_estimate=y) + rest
    )
    data, page, text = calibrated(tmp_path, tmp_path)
    (found,) = data["dynamic"]
    assert data["static"] == [] and data["rig"] == "hmb_free" and found["name"] == "run.npz"
    assert found["polarity"] == -1 and found["gain"] == pytest.approx(0.98, rel=2e-3)
    low, high = found["delay_interval"]
    assert low < 45e-6 < high and high - low < 0.3e-6
    assert found["periods"] == 5  # the first holds the transient
    assert np.array(found["frequency"]) == pytest.approx(HZ * harmonic_range(1, 250))
    assert found["lags"][0]["lag"] == pytest.approx(360 * 150 * 45e-6, abs=2 * found["lags"][0]["half_width"])
    assert "still.npz: no displacement with gap_estimate: left out" in text and "still.npz" in page
    assert "falling with the displacement" in text and "half turn is taken out" in page


def test_lines_that_noise_hides_are_left_out_and_a_bandwidth_is_found(tmp_path):
    lines = [*range(1, 200), 240, 245, 250]
    x, y = multisine(lines[:199], noise=0.5e-6, delay=20e-6, corner=900.0)
    excitation = f'{{ kind = "sphs", fundamental = {HZ}, lines = {lines} }}'
    (tmp_path / "campaign.toml").write_text(
        HEAD + recording(tmp_path, "run", excitation, displacement=x, gap_estimate=y)
    )
    data, _, text = calibrated(tmp_path, tmp_path)
    (found,) = data["dynamic"]
    assert "of 202 lines are left out: their displacement is mostly noise" in text
    assert found["frequency"][-1] <= 2000.0 and 199 <= len(found["frequency"]) + 3 <= 202
    assert found["bandwidth"] == pytest.approx(900.0, rel=0.03) and found["surely_within"] < found["bandwidth"]


def test_both_axes_of_an_xy_recording(tmp_path):
    (x, gx), (y, gy) = multisine(delay=30e-6), multisine(delay=60e-6, gain=0.5)
    excitations = f'[{{ kind = "sphs", fundamental = {HZ}, harmonics = [1, 250], direction = 45 }}]'
    part = recording(
        tmp_path, "run", excitations, displacement_x=x, displacement_y=y, gap_estimate_x=gx, gap_estimate_y=gy
    )
    (tmp_path / "campaign.toml").write_text(HEAD + 'rig = "hmb_radial"\n' + part)
    found = calibrated(tmp_path, tmp_path)[0]["dynamic"]
    assert [f["name"] for f in found] == ["run.npz, x", "run.npz, y"]
    assert [f["delay"] for f in found] == pytest.approx([30e-6, 60e-6], rel=1e-3)
    assert [f["gain"] * f["polarity"] for f in found] == pytest.approx([-0.98, 0.5], rel=1e-3)
    # Nothing drives y: there is nothing to calibrate it with, and that is said.
    along = part.replace("direction = 45", "direction = 180")
    (tmp_path / "campaign.toml").write_text(HEAD + 'rig = "hmb_radial"\n' + along)
    data, _, text = calibrated(tmp_path, tmp_path)
    assert [f["name"] for f in data["dynamic"]] == ["run.npz, x"]
    assert "run.npz, y: no periodic excitation" in text


@pytest.mark.slow
def test_a_simulated_loop_that_runs_on_the_estimate(tmp_path):
    options = ["--excite", "force=1:24@0.4", "--excite", "current=25:60@0.1", "--fundamental", 10]
    # With these periods, other random numbers change the lag by a fifth of a degree.
    maglev("simulate", "--sensor", "self_sensing", *options, "--periods", 24, "--out", tmp_path / "c")
    (found,) = calibrated(tmp_path, tmp_path / "c")[0]["dynamic"]
    response = tracking(rig_sensors(with_defaults(load_rig("hmb_free")))[0], np.array([150.0]))
    lag = next(entry for entry in found["lags"] if entry["frequency"] == 150.0)
    assert lag["half_width"] < 1.0
    assert lag["lag"] == pytest.approx(-np.degrees(np.angle(response[0])), abs=1.5 * lag["half_width"])
    assert found["polarity"] == -1 and found["gain"] == pytest.approx(1.0, abs=0.01)


def steps(noise=0.0):
    """13 levels up and down, 0.1 s each, with 10 ms between them, and a gap that saturates at 480 µm."""
    levels = np.concatenate([np.linspace(-150, 150, 13), np.linspace(150, -150, 13)]) * 1e-6
    x = np.repeat(levels, round(0.1 * RATE))
    x = np.convolve(np.pad(x, 100, mode="edge"), np.ones(201) / 201, "valid")
    rng = np.random.default_rng(0)
    y = np.clip(GAP - 1.02 * x + 2e-6, 0, 480e-6)
    return x + noise * rng.standard_normal(x.size), y + noise * rng.standard_normal(x.size)


def test_steps_of_a_recording_give_the_static_calibration(tmp_path):
    x, y = steps(0.3e-6)
    parts = recording(tmp_path, "steps", NONE, displacement=x, gap_estimate=y)
    noise = 1e-6 * np.random.default_rng(1).standard_normal((2, 20_000))
    parts += recording(tmp_path, "rest", NONE, displacement=noise[0], gap_estimate=GAP + noise[1])
    (tmp_path / "campaign.toml").write_text(HEAD + parts)
    data, page, text = calibrated(tmp_path, tmp_path)
    (found,) = data["static"]
    assert found["gain"] == pytest.approx(-1.02, rel=1e-3) and found["offset"] == pytest.approx(352e-6, rel=1e-3)
    assert np.allclose(found["displacement"], np.linspace(-150e-6, 150e-6, 13), rtol=0, atol=0.5e-6)
    assert found["saturated_below"] == pytest.approx(-125e-6, abs=0.5e-6) and found["units"] == ["m", "m"]
    assert "rest.npz: no periodic excitation, and the displacement rests at 0 levels" in text
    assert "-1020" in text and "steps.npz" in page


def test_a_short_recording_and_a_dead_sensor_are_left_out_by_name(tmp_path):
    x, y = steps(0.3e-6)
    parts = recording(tmp_path, "steps", NONE, displacement=x, gap_estimate=y)
    parts += recording(tmp_path, "short", NONE, displacement=x[:100], gap_estimate=y[:100])
    parts += recording(tmp_path, "dead", NONE, displacement=x, gap_estimate=np.full(x.size, GAP))
    (tmp_path / "campaign.toml").write_text(HEAD + parts)
    data, _, text = calibrated(tmp_path, tmp_path)
    assert [found["name"] for found in data["static"]] == ["steps.npz"]
    assert "short.npz: no periodic excitation, and the displacement rests at 0 levels" in text
    assert "dead.npz: the output is 0.00035 throughout and does not follow the displacement" in text


def test_what_counts_as_a_step():
    t = np.arange(60_000) / RATE
    ramp, read = static_steps(50e-6 * t, 3 * 50e-6 * t, RATE)
    assert 20 < ramp.size < 60 and np.allclose(read, 3 * ramp)
    for moving in (np.sin(2 * np.pi * 40 * t), np.random.default_rng(0).standard_normal(t.size), np.zeros(t.size)):
        assert static_steps(moving, moving, RATE)[0].size == 0
    for short in (2, round(0.02 * RATE) - 1, round(0.05 * RATE)):
        assert static_steps(50e-6 * t[:short], t[:short], RATE)[0].size == 0
    level, read = static_steps(*steps(), RATE)
    assert level == pytest.approx(np.linspace(-150e-6, 150e-6, 13), abs=0.5e-6)
    assert read[2:] == pytest.approx(GAP - 1.02 * level[2:] + 2e-6, abs=1e-9) and read[0] == pytest.approx(480e-6)


def dynamic(noise=0.0, seed=0, delay=556e-6, corner=np.inf, lines=LINES, periods=3):
    x, y = multisine(lines, periods + 1, noise, delay, -1.0, corner, seed)
    found = dynamic_calibration(x, y, RATE, HZ, lines, periods)
    return Dynamic("made up", periods, found, np.ones(len(lines)))


def test_a_pure_delay_lags_as_the_dissertation_says():
    found = dynamic()
    assert lag_at(found, 150.0)[0] == pytest.approx(30.0, abs=0.05)
    assert list(lags(found)) == [150.0] and surely_within(found) == 1000.0
    assert list(lags(dynamic(lines=harmonic_range(1, 10)))) == [100.0]
    # Within its lines a filter's own lag comes back too, and noise cannot slip it by a turn.
    found = dynamic(0.3e-6, corner=400.0)
    expected = 360 * 700 * 556e-6 + np.degrees(np.arctan(700 / 400))
    lag, half = lag_at(found, 700.0)
    assert lag == pytest.approx(expected, abs=2 * half) and half < 3
    assert lag_at(dynamic(100e-6), 1000.0)[1] > 45 and lags(dynamic(500e-6, lines=harmonic_range(1, 10))) == {}


def test_the_lags_interval_covers():
    truth = lag_at(dynamic(), 150.0)[0]
    hits = [abs(lag - truth) < half for lag, half in (lag_at(dynamic(2e-6, seed), 150.0) for seed in range(300))]
    assert np.mean(hits) == pytest.approx(0.95, abs=0.035)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("a\n1\n2\n3\n", "one column"),
        ("a,b\n1,2\n2,x\n3,4\n", "'x' in line 3 (sample 1) is not a number"),
        ("a,b\n1,2\n2,nan\n3,4\n", "column 'b': row 1 below the header is nan"),
        ("a,b\n1,2\n1,3\n1,4\n", "3 rows with 1 different values of 'a'"),
        ("a,b\n" + "".join(f"{i},{i}\n" for i in range(501)), "501 rows"),
        ("a,b\n1,2\n2,90\n3,4\n4,-7\n", "no three steps lie on a line"),
        ("a,b\n1,0\n2,1\n3,2\n4,-9\n5,7\n6,-4\n", "no more than 3 of 6 steps lie on a line"),
    ],
)
def test_bad_tables_end_with_one_message_and_code_2(tmp_path, text, words):
    (tmp_path / "t.csv").write_text(text)
    answer = run(tmp_path / "t.csv", "--out", tmp_path / "k.html", code=2)
    assert words in answer and "t.csv" in answer and not (tmp_path / "k.html").exists()


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["c.npz"], "give a campaign folder, or a .csv file"),
        (["."], "no recording has the channels displacement and gap_estimate"),
        (["still"], "nothing to calibrate with: s.npz: no periodic excitation"),
        ([".", "--rig", "hmb_free"], "--rig hmb_free goes with the simulated calibration"),
    ],
)
def test_bad_input_ends_with_one_message_and_code_2(arguments, words, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    x = np.random.default_rng(0).standard_normal(8000)
    (tmp_path / "campaign.toml").write_text(HEAD + recording(tmp_path, "c", NONE, displacement=x))
    (tmp_path / "still").mkdir()
    part = recording(tmp_path / "still", "s", NONE, displacement=x, gap_estimate=x)
    (tmp_path / "still" / "campaign.toml").write_text(HEAD + part)
    text = run(*arguments, code=2)
    assert words in text and text.startswith("maglev:") and not list(tmp_path.glob("*.html"))
