"""The benchmark's generator against another integrator, its thresholds against noise, and its sealed sets."""

import json
from dataclasses import replace
from hashlib import sha256

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.stats import chi2

from maglev_env.loop.effect import EFFECTS
from maglev_env.recordings.campaign import load_campaign
from sim2real.blind.benchmark import at
from sim2real.blind.benchmark.detect import FREEDOM, LEVEL, Detector, critical, threshold
from sim2real.blind.benchmark.drives import Drive, draw_drive
from sim2real.blind.benchmark.generate import Case, generate, make, plan
from sim2real.blind.benchmark.integrate import run
from sim2real.blind.benchmark.kinds import KINDS, OUTSIDE, VOCABULARY
from sim2real.blind.benchmark.oracle import _Metric, rivals
from sim2real.blind.benchmark.plant import pull
from sim2real.blind.benchmark.rigs import FAMILIES, draw_rig
from sim2real.blind.benchmark.simulate import Controller, LoopFailed, Recording, Truth, simulate


def loop(family, seed=3, shape="multisine", level=0.02):
    rng = np.random.default_rng(seed)
    rig = draw_rig(family, rng)
    controller = Controller(rig.pid, "pid", 1 / rig.parameters["control_rate"])
    return rig, Recording("one", "fit", controller, draw_drive(shape, rig, True, level, rng))


@pytest.mark.parametrize("effects", [{}, {at.DELAY: 1.3e-4, at.LAG: 2e-4, at.FLUX_LIMIT: 6e3, at.KNEE: 4.0}])
def test_the_loop_is_what_an_adaptive_integrator_makes_of_the_same_equations(effects):
    """Without a controller, on springs: amplifier, lags, delay, magnets and probe integrated by DOP853."""
    rig, _ = loop("stand")
    p = Truth(rig, {}, effects).values(0.0, 0.0)
    step, samples = 1 / p[at.RATE], 200
    injection = 0.3 * rig.parameters["bias_current"] * np.sin(np.arange(samples) * 0.11)[:, None]
    none, lost = np.zeros((samples, 1)), np.zeros(samples, bool)
    found, _, current, stood = run(p, np.zeros(3), np.eye(3)[0], none, injection, none, none, lost, False, 20)
    lag = max(0.5 * p[at.LAG], 1e-12)

    def rates(t, s, u):
        y, v, i, one, two, seen = s
        force = pull(i, y, p) - p[at.SUPPORT] * y - p[at.SUPPORT_DAMPING] * v
        sent = two if p[at.LAG] else u
        lags = ((u - one) / lag, (one - two) / lag) if p[at.LAG] else (0.0, 0.0)
        return [v, force / p[at.MASS], (sent - i) / p[at.AMPLIFIER], *lags, (y - seen) / p[at.PROBE]]

    state, expected, currents = np.zeros(6), [], []
    for n in range(samples):
        expected.append(state[5])
        currents.append(state[2])
        before = injection[n - 1, 0] if n else 0.0
        for begin, end, u in ((0.0, p[at.DELAY], before), (p[at.DELAY], step, injection[n, 0])):
            if end > begin:
                state = solve_ivp(rates, (begin, end), state, "DOP853", args=(u,), rtol=1e-10, atol=1e-13).y[:, -1]
    assert stood and np.abs(found[:, 0] - expected).max() < 2e-4 * np.abs(expected).max()
    assert np.abs(current[:, 0] - currents).max() < 2e-3 * np.abs(currents).max()


@pytest.mark.slow
def test_the_vocabulary_is_that_of_the_cards_and_every_kind_shows():
    assert (
        set(VOCABULARY) == {name for name in EFFECTS if not name.startswith("free_")} - {"actuator_offset"}
        and not set(OUTSIDE) & set(EFFECTS)
        and len(OUTSIDE) >= 8
    )
    detectors = {}
    for family in FAMILIES:
        rig, recording = loop(family)
        drive = replace(recording.drive, wave=recording.drive.wave[: recording.drive.wave.size // 2])
        recording = replace(recording, drive=drive, speed=400.0)
        detectors[family] = Detector(Truth(rig), [recording], True, 1)
    for name, kind in KINDS.items():
        assert kind.block in {card.block for card in EFFECTS.values()}, name
        detector = detectors["ball" if "ball" in kind.families else kind.families[0]]
        others = kind.others(detector.truth.rig, np.random.default_rng(2))
        size = kind.most
        while True:
            try:
                shown = detector.strength(kind.values(detector.truth.rig, size, others))
                break
            except LoopFailed:
                size /= 2
        assert shown > 0.01, name


def test_noise_has_the_spectrum_that_the_threshold_takes():
    rig, recording = loop("ball")
    detector = Detector(Truth(rig), [recording], True, 1)
    whitening = detector._whitening[0]
    noise = detector._spectrum(Truth(rig), recording, 77) - detector._spectrum(Truth(rig), recording, 78)
    values = np.einsum("fij,fj->fi", whitening, noise / np.sqrt(2))
    total, freedom = np.sum(np.abs(values) ** 2), 2 * values.size
    assert abs(total / freedom - 1) < 0.1


def test_at_the_threshold_the_test_has_a_power_of_one_half_and_a_small_effect_grows_with_its_square():
    rng = np.random.default_rng(0)
    shift = np.zeros(FREEDOM)
    shift[0] = np.sqrt(critical(FREEDOM))
    found = ((rng.standard_normal((4000, FREEDOM)) + shift) ** 2).sum(axis=1) > chi2.isf(LEVEL, FREEDOM)
    assert abs(found.mean() - 0.5) < 0.04
    rig, recording = loop("ball")
    detector = Detector(Truth(rig), [recording], True, 1)
    kind = KINDS["amplifier_lag"]
    least, most = threshold(detector, kind, 1.0, {})
    assert least < most and detector.strength(kind.values(rig, least, {})) == pytest.approx(1.0, rel=0.2)
    assert detector.strength(kind.values(rig, 0.5 * least, {})) == pytest.approx(0.25, rel=0.3)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "size"),
    [("hysteresis", 0.8), ("deadband", 0.05), ("amplifier_voltage_limit", 1.0), ("probe_backlash", 0.1)],
)
def test_an_effect_shows_as_much_as_in_recordings_with_their_noise_and_rounding(name, size):
    """The mean difference of recordings with the effect and without, by halves of drawn noise."""
    kind, (rig, recording) = KINDS[name], loop("ball", shape="noise")
    recording = replace(recording, drive=replace(recording.drive, wave=recording.drive.wave[:1200]))
    detector = Detector(Truth(rig), [recording], True, 1)
    values = kind.values(rig, size, kind.others(rig, np.random.default_rng(3)))
    none, with_it, whitening = Truth(rig), Truth(rig, {}, values), detector._whitening[0]
    halves = []
    for first in (100, 200):
        seeds = range(first, first + 20)
        moved = sum(detector._spectrum(with_it, recording, s) - detector._spectrum(none, recording, s) for s in seeds)
        part = np.einsum("fij,fj->fi", whitening, moved / len(seeds))
        halves.append(detector.recalibrated(np.concatenate([part.real.ravel(), part.imag.ravel()])))
    (one, theta), (other, theta2) = halves
    shown = max(one @ other / critical(FREEDOM), theta @ theta2 / critical(len(theta)))
    assert detector.strength(values) == pytest.approx(shown, rel=0.12, abs=0.05)


@pytest.mark.slow
def test_a_rival_that_the_holdout_tells_apart_is_none():
    """A delay and a lag of the amplifier are alike in a quiet recording to fit, and not in a loud holdout."""
    rng = np.random.default_rng(3)
    rig = draw_rig("ball", rng)
    controller = Controller(rig.pid, "pid", 1 / rig.parameters["control_rate"])
    drives = [draw_drive("noise", rig, True, level, rng) for level in (0.004, 0.04)]
    drives = [replace(drive, wave=drive.wave[:1000]) for drive in drives]
    fit, holdout = (
        Recording(role, role, controller, drive) for role, drive in zip(("fit", "holdout"), drives, strict=True)
    )
    found = {"delay": {at.DELAY: 0.05 / rig.bandwidth}}
    alone, both = (
        [one["effects"] for one in rivals(Detector(Truth(rig), recordings, True, 1), found, 1)]
        for recordings in ([fit], [fit, holdout])
    )
    assert ["amplifier_lag"] in alone and not both


def test_the_distance_beside_an_effect_is_that_of_least_squares():
    """What calibration takes of the effect is free, too."""
    rig, recording = loop("ball")
    recording = replace(recording, drive=replace(recording.drive, wave=recording.drive.wave[:800]))
    detector = Detector(Truth(rig), [recording], True, 1)
    free, d = (detector.with_effects(values) for values in ({at.SCALE: 0.02}, {at.SCALE: 0.05, at.LAG: 3e-5}))
    rows = detector.calibration
    columns = np.hstack([np.vstack([rows, free]), np.vstack([np.eye(len(rows)), np.zeros((1, len(rows)))])])
    known = np.concatenate([d[0], np.zeros(len(rows))])
    _, (expected,), *_ = np.linalg.lstsq(columns.T, known, rcond=None)
    left = _Metric(detector, [free]).left(d)
    assert left[0] @ left[0] == pytest.approx(expected, rel=1e-6)


def test_a_gain_that_another_tolerance_can_take_up_shows_little():
    """Without a force, a probe's gain is one of the actuator, and as far as that may be off, it is taken for that."""
    rig, recording = loop("rotor")
    drive = draw_drive("multisine", rig, False, 0.02, np.random.default_rng(5))
    detector = Detector(Truth(rig), [replace(recording, drive=drive)], True, 1)
    own, other = 10 * rig.tolerance["probe_gain"], rig.tolerance["actuator_gain"]
    shown = detector.strength({at.SCALE: own}) * critical(len(rig.tolerance))
    assert shown == pytest.approx((own / other) ** 2, rel=0.3)  # where the probe's alone would make 100


@pytest.mark.parametrize("family", ["rotor", "stand", "ball"])
def test_what_moved_a_bench_long_ago_has_died_away_when_a_recording_begins(family):
    """An offset of the current then changes the command, but not where the rotor starts."""
    rig, recording = loop(family)
    still = replace(recording, drive=replace(recording.drive, wave=np.zeros(100)))
    offset = 0.01 * rig.parameters["bias_current"]
    found = simulate(Truth(rig, {}, {at.OFFSET: offset}), still, None)
    moved = offset * rig.gain / abs(rig.stiffness)
    assert np.abs(found["displacement"]).max() < 1e-3 * moved
    assert found["command"] == pytest.approx(-offset, rel=1e-2)


def test_a_rotor_that_touches_is_no_recording():
    rig, recording = loop("ball")
    hard = replace(recording, drive=Drive("noise", "current", 20 * np.ones(500)))
    with pytest.raises(LoopFailed):
        simulate(Truth(rig), hard, None)


def test_both_forms_of_the_controller_integrate_and_agree_at_low_frequencies():
    rig, _ = loop("rotor")
    z = np.exp(1j * np.array([0.01, 0.02]))
    one, other = (Controller(rig.pid, form, 1 / 5000.0).coefficients() for form in ("pid", "transfer_function"))
    found = [np.polyval(b[::-1], 1 / z) / np.polyval(c[::-1], 1 / z) for b, c in (one, other)]
    assert np.allclose(*found, rtol=0.03) and abs(one[1].sum()) < 1e-12 and abs(other[1].sum()) < 1e-12


def test_a_plan_has_every_kind_and_puts_effects_where_they_have_a_meaning():
    cases = plan(240, 5)
    assert [c.number for c in cases] == list(range(1, 241))
    assert {c.kind for c in cases} == {"none", "single", "pair", "unknown"}
    assert {name for c in cases for name in c.effects} == set(KINDS)
    assert all(c.family in KINDS[name].families for c in cases for name in c.effects)


@pytest.mark.slow
def test_a_set_is_the_same_again_and_reads_as_a_campaign(tmp_path, monkeypatch):
    cases = [Case(1, "ball", "no_force", "single", ("delay",)), Case(2, "xy", "full", "none", ())]
    monkeypatch.setattr("sim2real.blind.benchmark.generate.plan", lambda count, seed: cases)
    monkeypatch.setattr("sim2real.blind.benchmark.drives.SECONDS", 0.1)  # short recordings
    seal = generate(tmp_path / "a", 2, 9, 1, tmp_path / "a.json")
    text = (tmp_path / "a.json").read_bytes()
    assert seal == sha256(text).hexdigest()
    del cases[1]
    generate(tmp_path / "b", 1, 9, 1, tmp_path / "b.json")
    assert json.loads(text)[:1] == json.loads((tmp_path / "b.json").read_text())
    again = list((tmp_path / "b").rglob("*.*"))
    assert len(again) == 5
    for path in again:
        assert path.read_bytes() == (tmp_path / "a" / path.relative_to(tmp_path / "b")).read_bytes()
    single, none = json.loads(text)
    assert single["blocks"] == ["controller"] and "delay" in single["effects"]["delay"] and none["sizes"] == []
    campaign = load_campaign(tmp_path / "a" / "c0002")
    assert campaign.rig.axes == 2 and len(campaign.recordings) == 3
    assert make(cases[0], 9).found["delay"][1] == single["sizes"][0]
    said = (tmp_path / "a" / "c0001" / "campaign.toml").read_text() + (
        tmp_path / "a" / "c0001" / "rig.toml"
    ).read_text()
    assert "effect" not in said
