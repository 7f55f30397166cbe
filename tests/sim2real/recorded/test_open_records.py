"""Recordings that never repeat, of a bench of another hand: their injection, likelihood, estimate and diagnosis."""

import re
from dataclasses import replace

import bench_loop
import numpy as np
import pytest
from bench_loop import Bench, write_campaign
from scipy.stats import chi2

from estimation.normal import NORMAL_95
from maglev_env.loop.gains import Gains
from sim2real import diagnose
from sim2real.compared.point import Point
from sim2real.compared.problem import assemble
from sim2real.judgement.nonstationary import widening
from sim2real.pooled import pooled
from sim2real.recorded.drive.controller_output import recovered_injection
from sim2real.recorded.not_stable import not_stable
from sim2real.recorded.open_evidence import measured_of, measured_series, parts_of
from sim2real.recorded.open_loop import nominal_loop
from sim2real.recorded.open_record import OpenRecord
from sim2real.recorded.records import read_records
from sim2real.search import attribute
from sim2real.search.fitting import begin, differentiate, iterate
from sim2real.search.hypotheses import Hypothesis


@pytest.fixture
def campaign(tmp_path):
    def made(bench, kinds, seconds=1.0, seed=0):
        return write_campaign(tmp_path, bench, kinds, seconds, seed)

    return made


def test_the_injection_is_recovered_to_the_converter_step():
    run = bench_loop.record(Bench(), "noise", 0.5, 3)
    injection, _ = bench_loop.excitation("noise", 0.5, np.random.default_rng(3))
    gains = Gains(bench_loop.KP, bench_loop.KI, bench_loop.KD, bench_loop.TD, bench_loop.TI)
    found = recovered_injection(gains, run["command"], run["displacement"], 1 / bench_loop.RATE)
    assert abs(found - injection).max() < 0.51 * bench_loop.DAC  # sensor noise of 1 µm would make 50 times as much


@pytest.mark.parametrize("kind", ["noise", "chirp", "steps", "sine"])
def test_the_true_loop_leaves_white_noise_of_the_variance_that_is_told(campaign, kind):
    _, (record,) = read_records(campaign(Bench(), {kind: "fit"}))
    assert isinstance(record, OpenRecord)
    problem = assemble([record])
    residual = problem.data - problem.simulate([Point({}, {})])[0]
    for output in (0, 1):
        power = abs(residual[problem.output == output]) ** 2 / 2
        assert power.mean() == pytest.approx(1.0, abs=5 / np.sqrt(power.size))
        low = power[: power.size // 10]
        assert low.mean() == pytest.approx(1.0, abs=5 / np.sqrt(low.size))


def test_noise_stays_noise_where_the_stated_gains_are_off_in_their_last_digits(campaign):
    _, (record,) = read_records(campaign(Bench(), {"sine": "fit"}, seconds=2.0))
    told = assemble([record]).parts[0].noise[0, 0]
    # Beside the sine, what is left of the command is then a share of the reading, noise and all: it explains all of it.
    reading = record.series["displacement"]
    sine = 0.1 * np.sin(2 * np.pi * 20.0 / bench_loop.RATE * np.arange(reading.shape[1]))
    off = replace(record, waves={**record.waves, "current": sine + 1e-6 * bench_loop.KP * reading})
    found = assemble([off]).parts[0].noise[0, 0]
    beside = abs(record.frequency - 20.0) > 25.0
    assert found[beside] == pytest.approx(told[beside], rel=0.3)


def test_a_delay_far_below_the_noise_of_a_sample_is_seen(campaign):
    _, (record,) = read_records(campaign(Bench(delay=20e-6), {"noise": "fit"}))
    problem = assemble([record])
    nominal, true = problem.data - problem.simulate([Point({}, {}), Point({"delay": {"time": 20e-6}}, {})])
    assert np.sum(abs(nominal) ** 2) - np.sum(abs(true) ** 2) > 100


@pytest.mark.slow
def test_a_pooled_estimate_names_the_recording_that_disagrees(campaign, tmp_path):
    folder = campaign(Bench(stiffness=-0.05, delay=30e-6), {"noise": "fit", "chirp": "fit", "steps": "fit"})
    _, records = read_records(folder)
    found = pooled(records)
    truth = {"negative_stiffness": 0.95 * bench_loop.STIFFNESS, "delay": 30e-6, "actuator_gain": bench_loop.GAIN}
    for c in found.coefficients:
        if c.name in truth:
            assert abs(c.value - truth[c.name]) < 4 * c.se and c.bounded
    assert found.misfit == pytest.approx(1.0, abs=0.03) and not found.disagreements
    surest = min(found.gain.bands, key=lambda b: b.size_se)
    assert surest.size_se < 0.03 * bench_loop.GAIN and len(found.gain.bands) > 8
    for b in found.gain.bands:  # force over the current of the coil is flat: the delay is before it
        assert abs(abs(b.gain) - bench_loop.GAIN) < 4 * b.size_se and abs(np.angle(b.gain)) < 4 * b.phase_se
    np.savez(tmp_path / "chirp.npz", **bench_loop.record(Bench(stiffness=0.1, delay=30e-6), "chirp", 2.0, 9))
    again = pooled(read_records(folder)[1])
    assert any(line.startswith("chirp.npz: ") for line in again.disagreements["negative_stiffness"])


def test_a_recording_that_cannot_be_simulated_is_named(campaign):
    _, (noise, steps) = read_records(campaign(Bench(), {"noise": "fit", "steps": "fit"}, seconds=0.5))
    thrown = replace(steps, waves={at: 60 * wave for at, wave in noise.waves.items()})
    with pytest.raises(ValueError, match=r"simulation of steps\.npz; check gains"):
        pooled([noise, thrown])


def test_gains_under_which_the_nominal_loop_is_not_stable_are_said_and_not_used(campaign):
    folder = campaign(Bench(), {"noise": "fit", "steps": "fit"}, seconds=0.5)
    text = (folder / "campaign.toml").read_text()
    at = text.rindex("kp = ")
    (folder / "campaign.toml").write_text(text[:at] + text[at:].replace(f"kp = {bench_loop.KP}", "kp = 100.0"))
    _, (noise, steps) = read_records(folder)
    assert noise.source == "command" and not any("stable" in note for note in noise.notes)
    assert steps.source == "current" and not not_stable(steps.experiment)
    wrong = steps.notes[0]
    # Less gain than the magnet's negative stiffness: the rotor leaves without a swing, faster than it falls freely.
    pole = float(re.search(r"not stable \(pole (\S+) of the unit circle: it grows without a swing", wrong)[1])
    assert 1 < pole < np.exp(np.sqrt(-bench_loop.STIFFNESS / bench_loop.MASS) / bench_loop.RATE) + 1e-4
    assert "gains" in wrong and "delay" in wrong and wrong.endswith("it is not used")
    _edit(folder, 'current = { from = "current" }', "")
    told, (alone,) = read_records(folder)
    assert alone.name == "noise.npz" and "not stable" in told.left_out[0].reason


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["noise", "steps"])
def test_intervals_cover_what_they_claim(campaign, kind):
    bench = Bench(stiffness=-0.05, delay=30e-6)
    truth = {"negative_stiffness": 0.95 * bench_loop.STIFFNESS, "delay": 30e-6}
    squares = []
    for seed in range(8):
        _, records = read_records(campaign(bench, {kind: "fit"}, seconds=1.0, seed=10 * seed))
        found = {c.name: c for c in pooled(records).coefficients}
        for name, value in truth.items():
            low, high = found[name].interval
            squares.append((NORMAL_95 * (2 * value - low - high) / (high - low)) ** 2)
    # The squares tell more than how many intervals hold: of intervals half as wide, 7 of 8 such sums are larger.
    assert chi2.isf(0.999, 16) < sum(squares) < chi2.isf(0.001, 16)


@pytest.mark.slow
def test_a_resonance_of_the_noise_is_no_damping(campaign):
    """Of rounding alone a fit told the damping to 14 N s/m, of which it was off by 30."""
    inside = []
    for seed in range(5):
        _, records = read_records(campaign(Bench(noise=0.5e-6), {"hover": "fit"}, seconds=1.0, seed=10 * seed))
        gain, _, damping, _ = pooled(records).coefficients
        assert not gain.bounded or gain.interval[0] < bench_loop.GAIN < gain.interval[1]
        inside.append(damping.interval[0] < 0 < damping.interval[1])
    assert np.mean(inside) >= 0.8


@pytest.mark.slow
def test_a_delay_is_named_from_noise_steps_and_a_chirp(campaign, monkeypatch):
    late = ("delay", "amplifier_lag", "sensor_lag", "mass", "actuator_gain")
    monkeypatch.setattr(attribute, "single_effects", lambda rig: late)
    kinds = {"noise": "fit", "steps": "fit", "chirp": "fit", "noise-2": "holdout"}
    found = diagnose(campaign(Bench(delay=45e-6), kinds, seconds=1.0))
    assert found.verdict == "explained" and found.cause == ("delay",)
    # To within 2 us (standard error), which the form of the stated amplifier's lag leaves open.
    assert found.corrected.effects["delay"]["time"] == pytest.approx(45e-6, abs=5e-6)
    assert found.gap.closed_fraction > 0.95 and found.gap.judged_on == "holdout"


@pytest.mark.slow
def test_a_sound_bench_has_no_gap(campaign, monkeypatch):
    monkeypatch.setattr(attribute, "single_effects", lambda rig: ("delay", "actuator_gain", "damping", "soft_stop"))
    found = diagnose(campaign(Bench(), {"noise": "fit", "steps": "fit", "noise-2": "holdout"}, seconds=0.5))
    assert found.verdict == "no_gap"


def test_a_recording_that_nothing_known_drives_is_refused_with_what_to_record(campaign):
    folder = campaign(Bench(), {"noise": "fit"})
    for channel in ("command", "current"):
        _edit(folder, f'{channel} = {{ from = "{channel}" }}', "")
    with pytest.raises(ValueError, match="nothing that is known drives this recording"):
        read_records(folder)


def _edit(folder, old, new):
    text = (folder / "campaign.toml").read_text()
    assert old in text
    (folder / "campaign.toml").write_text(text.replace(old, new))


def _without_gains(folder):
    gains = next(line for line in (folder / "campaign.toml").read_text().splitlines() if line.startswith("gains"))
    _edit(folder, gains + "\n", "")


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["noise", "steps"])
def test_the_current_alone_tells_the_rig_whatever_the_controller(campaign, kind):
    bench = Bench(stiffness=-0.05)
    truth = {"negative_stiffness": 0.95 * bench_loop.STIFFNESS, "actuator_gain": bench_loop.GAIN, "damping": 0.0}
    folder = campaign(bench, {kind: "fit"}, seed=10)
    _without_gains(folder)
    _, (record,) = read_records(folder)
    assert "stands in for the controller" in " ".join(record.notes)
    found = {c.name: c for c in pooled([record]).coefficients}
    assert "delay" not in found  # it acts before the current
    assert max(abs(found[n].value - value) / found[n].se for n, value in truth.items()) < 3
    assert found["negative_stiffness"].se < 0.015 * abs(bench_loop.STIFFNESS)


def test_errors_of_channels_enter_the_interval_and_are_the_same_in_all_recordings(campaign):
    folder = campaign(Bench(), {"noise": "fit"}, seconds=2.0)
    _edit(folder, 'current = { from = "current" }', "")
    (plain,) = read_records(folder)[1]
    _edit(folder, 'command = { from = "command" }', 'command = { from = "command", scale_tolerance = 0.01 }')
    (unsure,) = read_records(folder)[1]
    points = [Point({}, {}), Point({"actuator_gain": {"change": 0.01}}, {})]
    costs = []
    for records in ([plain], [unsure], [unsure, unsure]):
        problem = assemble(records)
        residuals = problem.data - problem.simulate(points)
        costs.append(np.diff(np.sum(abs(residuals) ** 2, axis=1))[0])
    # A gain error of one standard deviation of the scale costs about 1, once, however many recordings there are.
    assert costs[0] > 50 and max(np.abs(costs[1:])) < 10


def test_a_scale_of_the_displacement_enters_the_command_that_follows_from_it(campaign):
    """Where the injection is recorded and the command is not: what reading 0.1 % more changes."""
    folder = campaign(Bench(), {"noise": "fit"}, seconds=0.5)
    run = dict(np.load(folder / "noise.npz"))
    gains = Gains(bench_loop.KP, bench_loop.KI, bench_loop.KD, bench_loop.TD, bench_loop.TI)
    run["injection"] = recovered_injection(gains, run["command"], run["displacement"], 1 / bench_loop.RATE)
    _edit(folder, 'command = { from = "command" }', 'injection = { from = "injection" }')
    found = []
    for more in (0.0, 1e-3):
        np.savez(folder / "noise.npz", **{**run, "displacement": (1 + more) * run["displacement"]})
        _, (record,) = read_records(folder)
        assert record.source is None
        loop = nominal_loop(record)
        found.append(measured_of(record, loop, loop.blocks.outputs))
        by_scale = parts_of(record, loop, measured_series(record))["displacement"]
    for change, output in zip(found[1] - found[0], loop.blocks.outputs, strict=True):
        told = 1e-3 * record.windows.project(by_scale[output]).reshape(change.shape)
        assert np.linalg.norm(change - told) < 0.05 * np.linalg.norm(change)  # the ends' lowest windows know more


def test_a_gain_that_changes_in_time_widens_intervals_and_white_noise_does_not(campaign):
    _, (record,) = read_records(campaign(Bench(), {"noise": "fit"}))
    plain = record.series["displacement"]
    changing = 1 + 0.03 * np.repeat(np.random.default_rng(5).normal(size=12), -(-plain.shape[1] // 12))
    kicked = plain * changing[: plain.shape[1]]
    found = []
    hypothesis = Hypothesis(("negative_stiffness", "damping"), {})
    for series in (plain, kicked):
        own = replace(record, series={**record.series, "displacement": series})
        problem = assemble([own])
        (fit,) = begin([hypothesis], [np.zeros(2)], problem.data, problem.simulate)
        iterate([fit], problem.data, problem.simulate, 5)
        differentiate([fit], problem.data, problem.simulate, True)
        found.append(widening(problem, fit))
    assert (found[0] == 1.0).all() and found[1].max() > 1.3


def test_the_voltage_stands_for_a_missing_current(campaign, tmp_path):
    folder = campaign(Bench(), {"noise": "fit"})
    run = dict(np.load(folder / "noise.npz"))
    resistance, inductance, rate = 2.0, 2e-4, bench_loop.RATE
    decay = np.exp(-resistance / inductance / rate)
    voltage = resistance * (np.roll(run["current"], -1) - decay * run["current"]) / (1 - decay)
    np.savez(folder / "noise.npz", displacement=run["displacement"], voltage=voltage)
    _edit(folder, 'command = { from = "command" }\n', "")
    _edit(folder, 'current = { from = "current" }', 'voltage = { from = "voltage" }')
    coil = f"parameters = {{ coil_resistance = {resistance}, coil_inductance = {inductance} }}"
    _edit(folder, 'rig = "hmb_free"', f'rig = "hmb_free"\n{coil}')
    _, (record,) = read_records(folder)
    assert "computed from the voltage" in " ".join(record.notes) and record.source == "current"
    names = {e.name for e in record.errors}
    assert {"scale of current", "induced voltage of current"} <= names
