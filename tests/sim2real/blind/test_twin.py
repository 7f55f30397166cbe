import hashlib
import json
import tomllib
from dataclasses import replace
from functools import partial
from importlib import resources
from pathlib import Path

import numpy as np
import pytest
from scipy import signal, stats

from maglev_env.experiment import Experiment
from maglev_env.kernel.simulate import simulate_records
from maglev_env.loop.magnets.kinds import force_law
from maglev_env.loop.magnets.law import force
from maglev_env.recordings.campaign import load_campaign
from maglev_env.recordings.recording import read_recording
from maglev_env.rig.excitation import Excitation
from maglev_env.rig.rig import Noise, with_parameters
from maglev_env.rig.rig_file import load_rig
from sim2real.blind import generate as generator
from sim2real.blind import stepping
from sim2real.blind.excitation import FUNDAMENTAL, Drive, draw_drive, draw_grid
from sim2real.blind.forms import ladder, machine
from sim2real.blind.generate import generate, plan
from sim2real.blind.menu import EFFECTS, KINDS, UNKNOWN, known_on
from sim2real.blind.rigs import PID, RIGS
from sim2real.blind.sealing import sealed
from sim2real.blind.sizing import search, sized
from sim2real.blind.threshold import LEVEL, Detector, critical, linear_loop
from sim2real.blind.twin import LoopFailed, Truth, simulate, twin_periods

OPEN_LOOP = PID(0.0, 0.0, 0.0, 1e-4, 0.0318)
SAMPLES = 10_000


def drive_of(rig: str, seed: int = 1, factor: float = 1.0) -> Drive:
    rng = np.random.default_rng(seed)
    return draw_drive(rng, draw_grid(rng, True), RIGS[rig].force_peak, RIGS[rig].injection_peak, SAMPLES).scaled(factor)


def lines_of(values: np.ndarray, lines) -> np.ndarray:
    return np.fft.rfft(values[-SAMPLES:])[list(lines)] * (2 / SAMPLES)


def response(system, lines) -> np.ndarray:
    """Frequency response at harmonics of a continuous one-input, one-output state space behind a hold."""
    a, b, c, *_ = signal.cont2discrete(system, 5e-5)
    z = np.exp(2j * np.pi * np.array(lines) / SAMPLES)
    return np.array([(c @ np.linalg.solve(x * np.eye(len(a)) - a, b))[0, 0] for x in z])


def nominal_rig(name: str, folder: Path):
    if RIGS[name].toml is None:
        return load_rig(name)
    (folder / "rig.toml").write_text(RIGS[name].toml)
    return load_rig(folder / "rig.toml")


def test_nominal_numbers_are_those_of_the_rig_files(tmp_path):
    for name in RIGS:
        text = (resources.files("maglev_env") / "rigs" / "hmb_free.toml").read_text() if RIGS[name].toml is None else ""
        data = tomllib.loads(text or RIGS[name].toml)
        defaults = {"adc_bits": 16, "dac_bits": 14, "voltage_range": 10.0, "control_rate": 20000.0}
        absent = {"support_stiffness": 0.0, "support_damping": 0.0}
        parameters = {k: v for k, v in data["parameters"].items() if k != "flux_path"}
        assert {**defaults, **absent, **parameters} == dict(RIGS[name].parameters)
        assert data["gains"] == vars(RIGS[name].gains)
        assert data["noise"] == dict(RIGS[name].noise) and data["tolerance"] == dict(RIGS[name].tolerance)
        rig = nominal_rig(name, tmp_path)
        assert all(getattr(rig, key) == value for key, value in RIGS[name].parameters.items())
    radial = load_rig("hmb_radial")
    assert all(getattr(radial, key) == value for key, value in RIGS["stand"].parameters.items())


@pytest.mark.slow
@pytest.mark.parametrize(("name", "effects"), [("stand", {}), ("hmb_free", {"delay": {"time": 75e-6}})])
def test_agrees_with_the_nominal_simulator(name, effects, tmp_path):
    # The rest is the truncation error of both integrators, of fourth order in their steps.
    ideal = with_parameters(nominal_rig(name, tmp_path), {"adc_bits": 0, "dac_bits": 0})
    ideal = replace(ideal, noise=Noise())
    grid = drive_of(name).grid
    shaker = Excitation("multisine", "force", FUNDAMENTAL, grid.force, RIGS[name].force_peak, 3)
    injection = Excitation("multisine", "current", FUNDAMENTAL, grid.injection, RIGS[name].injection_peak, 4)
    e = Experiment(ideal, ideal.gains, (shaker, injection), periods=1, effects=effects, offset=1.75e-5)
    drive = Drive(grid, e.waveform("force"), e.waveform("current"), 1.75e-5)
    expected = simulate_records([e], substeps=2)[0]
    found = simulate(Truth(name, effects=effects), RIGS[name].gains, drive, 2, None)
    for row, channel in enumerate(("displacement", "command", "current")):
        assert np.std(found[channel] - expected[row]) < 1e-6 * np.std(expected[row])


@pytest.mark.parametrize("change", [0.0, -0.3])
def test_force_law_is_the_nominal_one_when_nothing_bends(change):
    rig = with_parameters(load_rig("hmb_free"), {"negative_stiffness": -12.5e3 * (1 + change)})
    m = machine(Truth("hmb_free").parameters, {"negative_stiffness": {"change": change}}, "sealed")
    for y, i in [(0.0, 0.0), (1e-4, 0.3), (-2e-4, -1.0)]:
        assert stepping._pull(m, y, i) == pytest.approx(force(force_law(rig), y, i), rel=1e-12)


@pytest.mark.parametrize("forms", ["sealed", "development"])
def test_saturated_iron_carries_at_most_the_field_of_its_knee(forms):
    for field in (0.8, 1.6):
        m = machine(Truth("hmb_free").parameters, {"saturation": {"field": field}}, forms)
        assert stepping._iron(m, 1e-3 * field) == pytest.approx(1e-3 * field, rel=1e-5)
        assert stepping._iron(m, 1e4) == pytest.approx(field, rel=1e-3)
        assert stepping._iron(m, field) == pytest.approx(
            {"sealed": 2 / np.pi * np.arctan(np.pi / 2), "development": 0.5 ** (1 / 3)}[forms] * field
        )


@pytest.mark.parametrize("corner", [300.0, 3e3, 1e5])
def test_ladder_is_a_solid_plate_in_series_with_the_gap(corner):
    diffusion = 5e-3
    for depth, accuracy in ((10, 1e-5), (7, 2e-3)):
        rates, shares = ladder(corner, diffusion, depth)
        s = 2j * np.pi * np.geomspace(1, 2000, 50)
        found = 1 - shares.sum() + (shares * rates / (s[:, None] + rates)).sum(axis=1)
        z = np.sqrt(s * diffusion)
        ratio = 1 / np.sqrt(2 * np.pi * corner * diffusion)
        assert np.abs(found - 1 / (1 + ratio * (z / np.tanh(z) - 1))).max() < accuracy
        assert np.all(rates > 0)


def test_amplifier_lag_is_two_poles_of_half_its_time():
    time_constant, drive = 4e-5, drive_of("stand")
    truth = Truth("stand", effects={"amplifier_lag": {"time_constant": time_constant}})
    found = simulate(truth, RIGS["stand"].gains, drive, 3, None)
    poles = [-1e4, -2 / time_constant, -2 / time_constant]
    lines = drive.grid.injection
    expected = response(signal.zpk2ss([], poles, -np.prod(poles)), lines)
    assert lines_of(found["current"], lines) / lines_of(found["command"], lines) == pytest.approx(expected, rel=2e-4)


def second_body(e):
    w, mu = 2 * np.pi * e["frequency"], e["mass_ratio"]
    spring, damper = w**2, 2 * e["damping_ratio"] * w
    rotor = np.array([[0, 1, 0, 0], [-mu * spring, -mu * damper, mu * spring, mu * damper]])
    return np.vstack([rotor, [0, 0, 0, 1], [spring, damper, -spring, -damper]]), np.array([1.0, 0, 0, 0])


def probe_mount(e):
    # rotor, base, plate; the bearing's acceleration of the rotor is row 1's own stiffness and damping, added below
    w, base = 2 * np.pi * e["frequency"], 2 * np.pi * 3.5 * e["frequency"]
    a = np.zeros((6, 6))
    a[0, 1] = a[2, 3] = a[4, 5] = 1
    a[3, 2:4] = -(base**2), -2 * 0.1 * base
    a[5, 2:] = w**2, 2 * e["damping_ratio"] * w, -(w**2), -2 * e["damping_ratio"] * w
    return a, np.array([1.0, 0, 0, 0, -1, 0])


@pytest.mark.parametrize(
    ("name", "e", "system"),
    [
        ("support_resonance", {"frequency": 60.0, "damping_ratio": 0.05, "mass_ratio": 0.1}, second_body),
        ("sensor_resonance", {"frequency": 90.0, "damping_ratio": 0.05, "coupling": 0.1}, probe_mount),
    ],
)
def test_resonances_against_their_state_space(name, e, system):
    # The stand without control, at an amplitude at which the magnets are their tangent: force to reading, force held.
    p = RIGS["stand"].parameters
    a, sees = system(e)
    bearing = -np.array([p["support_stiffness"] + p["negative_stiffness"], p["support_damping"]]) / p["mass"]
    a[1, :2] += bearing
    if name == "sensor_resonance":
        a[3, :2] -= e["coupling"] * 3.5**2 * bearing
    n = len(a)
    whole = np.zeros((n + 1, n + 1))
    whole[:n, :n], whole[n, :n], whole[n, n] = a, sees / 1.6e-5, -1 / 1.6e-5
    b = np.zeros((n + 1, 1))
    b[1] = 1 / p["mass"]
    drive = replace(drive_of("stand", factor=1e-3), injection=np.zeros(SAMPLES))
    found = simulate(Truth("stand", effects={name: e}), OPEN_LOOP, drive, 12, None)  # lightly damped: a long transient
    lines = drive.grid.force
    expected = response((whole, b, np.eye(n + 1)[[n]], np.zeros((1, 1))), lines)
    seen = lines_of(found["displacement"], lines) / lines_of(drive.force, lines)
    assert np.abs(seen - expected).max() < 1e-4 * np.abs(expected).max()


def test_hysteresis_loses_the_area_of_its_stop_operators():
    e = {"strength": 0.2, "width": 0.05}
    m = machine(Truth("hmb_free").parameters, {"hysteresis": e}, "sealed")
    top, held = 0.5, np.zeros(m.stops.size)
    current = top * np.sin(np.linspace(0, 4 * np.pi, 40_001))
    seen = np.array([stepping._magnetised(m, i, np.zeros(0), held) for i in current])
    enclosed = np.trapezoid(seen[20_000:], current[20_000:])  # below zero: what is seen lags
    expected = (m.stop_shares * 4 * m.stops * (top - m.stops)).sum()
    assert enclosed == pytest.approx(-expected, rel=1e-3)
    assert m.stop_shares.sum() == pytest.approx(0.2) and (m.stop_shares @ m.stops) == pytest.approx(0.2 * 0.05)


@pytest.mark.parametrize("forms", ["sealed", "development"])
def test_voltage_limit_bounds_the_coil(forms):
    def across(effects):  # the mean over a sample of L di/dt + R i
        truth = Truth("hmb_free", effects=effects, forms=forms)
        i = simulate(truth, RIGS["hmb_free"].gains, drive_of("hmb_free"), 2, None)["current"]
        return np.abs(0.57e-3 * np.diff(i) * 2e4 + 2.0 * (i[1:] + i[:-1]) / 2).max()

    assert across({}) > 0.4
    assert 0.249 < across({"amplifier_voltage_limit": {"voltage": 0.25}}) < 0.25 * (1 + 1e-4)


@pytest.mark.parametrize(("forms", "highest"), [("sealed", 1.25), ("development", 1.35)])
def test_friction_takes_its_force_times_the_way(forms, highest):
    # One slow tone on the stand without control: what the force gives less what the damper takes.
    time, force, p = np.arange(SAMPLES) / 2e4, 0.05, RIGS["stand"].parameters
    still = np.zeros(SAMPLES)
    drive = Drive(drive_of("stand").grid, 5.0 * np.cos(2 * np.pi * 20 * time), still)
    e = {"force": force, "velocity": 2e-3, "bristle": 1e-6}
    y = simulate(Truth("stand", effects={"friction": e}, forms=forms), OPEN_LOOP, drive, 4, None)["displacement"]
    y = y[-SAMPLES:]
    v = (np.roll(y, -1) - np.roll(y, 1)) * 1e4
    held = (np.roll(drive.force, 1) + drive.force) / 2  # a sample's force acts after it
    lost = (held * v).sum() - p["support_damping"] * (v * v).sum()
    assert 0.9 < lost / (force * np.abs(v).sum()) < highest


def test_tones_reach_the_reading_through_the_loop():
    rig, drive, speed = RIGS["hmb_free"], drive_of("hmb_free"), 2640.0  # 44 Hz: harmonic 22
    gains, still = rig.gains, simulate(Truth("hmb_free"), rig.gains, drive, 3, None)["displacement"]
    loop = linear_loop(Truth("hmb_free"), gains, np.array([44.0]))
    phases = {"harmonics": 0.0, "phase1": 0.3, "phase2": 0.0, "phase3": 0.0}
    turned = {"speed_rpm": speed, "effects": {"runout": {"amplitude": 1e-7, **phases}}}
    change = simulate(Truth("hmb_free", **turned), gains, drive, 3, None)["displacement"] - still
    expected = loop.sensitivity[0] * 1e-7 * np.exp(0.3j)
    assert lines_of(change, [22])[0] == pytest.approx(expected, rel=3e-3)
    turned["effects"] = {"unbalance": {"moment": 1e-8, **phases}}
    change = simulate(Truth("hmb_free", **turned), gains, drive, 3, None)["displacement"] - still
    force = 1e-8 * (2 * np.pi * 44) ** 2
    expected = abs(loop.compliance[0] * loop.sensitivity[0]) * force
    assert abs(lines_of(change, [22])[0]) == pytest.approx(expected, rel=3e-3)


@pytest.mark.parametrize("rig", RIGS)
def test_every_effect_changes_the_record_in_both_forms(rig):
    drive, gains = drive_of(rig), RIGS[rig].gains
    drive = replace(drive, force=drive.force[:2000], injection=drive.injection[:2000])  # 0.1 s
    rng = np.random.default_rng(3)
    plain = simulate(Truth(rig, speed_rpm=2500.0), gains, drive, 1, None)["displacement"]
    for name in [*known_on(rig), *UNKNOWN]:
        kind = KINDS[name]
        effects = {name: kind.values(kind.start, 1.0, kind.others(rng))}
        sealed, development = (
            simulate(Truth(rig, {}, effects, forms, 2500.0), gains, drive, 1, None)["displacement"]
            for forms in ("sealed", "development")
        )
        assert np.abs(sealed - plain).max() > 1e-13, name
        differs = ("amplifier_lag", "sensor_lag", "hysteresis", "saturation", "damping", "friction")
        differs += ("eddy_current", "sensor_resonance", "force_law", "deadband", "dropped_samples", "asymmetric_gain")
        differs += ("gain_drift", "cubic_spring", "soft_stop", "probe_backlash")
        assert np.array_equal(sealed, development) == (name not in (*differs, "amplifier_voltage_limit")), name


def test_critical_noncentrality_has_power_one_half():
    rng = np.random.default_rng(1)
    for freedom in (5, 600):
        shift = np.zeros(freedom)
        shift[0] = np.sqrt(critical(freedom))
        drawn = ((rng.standard_normal((20_000, freedom)) + shift) ** 2).sum(axis=1)
        assert np.mean(drawn > stats.chi2.isf(LEVEL, freedom)) == pytest.approx(0.5, abs=0.015)


@pytest.mark.slow
@pytest.mark.parametrize(("with_current", "name"), [(True, "delay"), (False, "hysteresis")])
def test_power_at_the_threshold_by_simulated_noise(with_current, name):
    # Noise of the running loop, converters included, and linear draws of the nuisances, against the effect, which noise
    # may smooth. Over few periods the controller's memory adds a per cent to what the current's noise is: ends of the
    # record.
    rig, periods, repeats = RIGS["hmb_free"], 4, 12
    drive, truth = drive_of("hmb_free"), Truth("hmb_free")
    detector = Detector(truth, [(rig.gains, drive)], periods, with_current)
    found = sized(name, 1.0, detector, np.random.default_rng(2))
    assert found.multiple == pytest.approx(1.0, abs=0.06)
    noisy, disturbed = (
        simulate(replace(truth, effects=effects), rig.gains, drive, 1 + periods * repeats, 5, substeps=5)
        for effects in ({}, {name: found.values})
    )
    shift = detector.whiten(rig.gains, drive, disturbed) - detector.whiten(rig.gains, drive, noisy)
    first = {key: values[:SAMPLES] for key, values in noisy.items()}
    j, n = detector.jacobian, detector.baseline.size
    rng, statistics = np.random.default_rng(6), []
    inner = np.linalg.inv(np.eye(j.shape[1]) + j.T @ j)
    for k in range(repeats):
        span = slice(SAMPLES * (1 + periods * k), SAMPLES * (1 + periods * (k + 1)))
        part = {key: np.concatenate([first[key], values[span]]) for key, values in noisy.items()}
        error = detector.whiten(rig.gains, drive, part) - detector.baseline + j @ rng.standard_normal(j.shape[1])
        for r in (error, error + shift):
            statistics.append(r @ r - (j.T @ r) @ inner @ (j.T @ r))
    null, moved = np.array(statistics[0::2]), np.array(statistics[1::2])
    assert null.mean() == pytest.approx(n, rel=3 * np.sqrt(2 / n / repeats))  # three standard errors of the mean
    # At this non-centrality the power is one half. Its mean tells more than the share of draws beyond the limit.
    apart = critical(n) * found.multiple**2
    assert np.mean(moved - null) == pytest.approx(apart, rel=3 * 2 / np.sqrt(apart * repeats))
    assert np.sum(null > stats.chi2.isf(LEVEL, n)) <= 2


def test_a_parameter_within_its_tolerances_is_calibration():
    detector = Detector(Truth("stand"), [(RIGS["stand"].gains, drive_of("stand"))], 8, True)
    # Alone it would be at the threshold after sqrt(critical) tolerances; the others may take a share of it.
    assert 0.1 < detector.parameter_size("mass", 0.005 * np.sqrt(critical(6))) <= 1.0
    # The same as the change itself, simulated: nothing of it is left but what is not linear.
    assert detector.size({"mass": {"change": 5e-4}}) == pytest.approx(detector.parameter_size("mass", 5e-4), rel=0.05)


def test_search_finds_a_power_and_stops_at_failures_and_limits():
    assert search(lambda x: 3 * x**2, 12.0, 0.01, 100.0)[0] == pytest.approx(2.0, rel=0.06)
    assert search(lambda x: x, 50.0, 1.0, 10.0) == (10.0, 10.0)

    def fails(x):
        if x > 7:
            raise LoopFailed
        return x

    assert 5 < search(fails, 50.0, 1.0, 100.0)[0] <= 7
    with pytest.raises(LoopFailed, match="no size"):
        search(lambda x: fails(8.0), 1.0, 1.0, 100.0)


def test_touchdown_is_an_error():
    with pytest.raises(LoopFailed, match="touched down"):
        simulate(Truth("hmb_free"), OPEN_LOOP, drive_of("hmb_free"), 1, None)


def test_periods_of_any_gains():
    drive = drive_of("hmb_free")
    stiff = replace(RIGS["hmb_free"].gains, kp=9000.0)
    found = twin_periods(Truth("hmb_free"), stiff, drive, 3, periods=2)
    assert {"displacement", "command", "force", "injection"} <= set(found)
    assert found["displacement"].shape == (2, SAMPLES)
    again = twin_periods(Truth("hmb_free"), stiff, drive, 3, periods=2)
    assert np.array_equal(found["command"], again["command"])
    # Row k is the controller's own arithmetic on what the row holds, rounded by the converter.
    e = -found["displacement"].ravel()
    shares = [1 - np.exp(-5e-5 / t) for t in (stiff.td, stiff.ti)]
    d, x = (signal.lfilter([0, share], [1, share - 1], e) for share in shares)
    asked = stiff.kp * e + stiff.kd * (e - d) / stiff.td + stiff.ki * x + found["injection"].ravel()
    assert np.abs(asked - found["command"].ravel()).max() <= 10 / 2**14 * 1.0001


def test_plan_follows_the_shares_and_covers_all_effects():
    cases = plan(240, 7)
    kinds = [c.kind for c in cases]
    assert [kinds.count(k) for k in ("none", "single", "pair", "unknown")] == [40, 120, 40, 40]
    assert {n for c in cases if c.kind == "single" for n in c.effects} == set(EFFECTS)
    assert {n for c in cases if c.kind == "unknown" for n in c.effects} == set(UNKNOWN)
    pairs = [c.effects for c in cases if c.kind == "pair"]
    assert np.mean([EFFECTS[a].block != EFFECTS[b].block for a, b in pairs]) > 0.7
    assert {c.channels for c in cases} == {"full", "no_force", "displacement"} and cases == plan(240, 7)


def contents(folder: Path) -> dict[str, bytes]:
    return {str(p.relative_to(folder)): p.read_bytes() for p in sorted(folder.rglob("*")) if p.is_file()}


def test_labels_do_not_depend_on_the_number_of_processes(tmp_path):
    seals = [sealed(partial(pow, 3), range(5), n, tmp_path / f"{n}.json") for n in (1, 2)]
    text = (tmp_path / "2.json").read_bytes()
    assert json.loads(text) == [1, 3, 9, 27, 81]
    assert seals == 2 * [hashlib.sha256(text).hexdigest()]


@pytest.mark.slow
def test_a_set_loads_and_a_case_is_the_same_in_any_company(tmp_path, monkeypatch):
    monkeypatch.setattr(generator, "PERIODS", 3)
    cases = plan(2, 320)
    generate(tmp_path / "set1", 2, 320)
    monkeypatch.setattr(generator, "plan", lambda count, seed: cases[1:])
    generate(tmp_path / "set2", 1, 320)
    both, alone = (contents(tmp_path / f"set{n}") for n in (1, 2))
    assert alone.items() < both.items()
    labels = json.loads((tmp_path / "set1-labels.json").read_bytes())
    assert labels[1:] == json.loads((tmp_path / "set2-labels.json").read_bytes())
    assert [label["id"] for label in labels] == ["c0001", "c0002"]
    for label in labels:
        campaign = load_campaign(tmp_path / "set1" / label["id"])
        assert [s.role for s in campaign.recordings] == ["fit"] * 5 + ["holdout"]
        for spec in campaign.recordings:
            recording = read_recording(campaign, spec)
            assert recording.sizes["time"] == 3 * SAMPLES
            assert ("force" in recording) == (label["channels"] != "no_force")
            assert ("current" in recording) == (label["channels"] != "displacement")
            assert ("reference" in recording) == (spec.file == "offset.npz")
        told = (tmp_path / "set1" / label["id"] / "campaign.toml").read_text()
        assert not any(name in told for name in KINDS if name != "mass") and str(tmp_path) not in told


def test_refuses_what_would_overwrite_or_mean_nothing(tmp_path):
    (tmp_path / "set").mkdir()
    (tmp_path / "set" / "file").touch()
    with pytest.raises(ValueError, match="not empty"):
        generate(tmp_path / "set", 1, 1)
    with pytest.raises(ValueError, match="at least 1"):
        generate(tmp_path / "new", 0, 1)
    with pytest.raises(ValueError, match="forms"):
        generate(tmp_path / "new", 1, 1, forms="open")
    (tmp_path / "new-labels.json").touch()
    with pytest.raises(ValueError, match="exists"):
        generate(tmp_path / "new", 1, 1)
