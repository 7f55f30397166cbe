"""`maglev selfsense rivals`: errors of three estimators of one motion, and the pieces they come from."""

import json
from functools import partial

import numpy as np
import pytest
from command_line import maglev

from maglev_workbench.commands.selfsense.rig_sensor import load_sensor
from maglev_workbench.commands.selfsense.rivals import experiments as rivals_experiments
from maglev_workbench.commands.selfsense.rivals.experiments import _fitted, _levitate, _noise, cases, poles_of
from selfsense.rivals.averaged import levitate, linear_model, sampled
from selfsense.rivals.kalman import process_noise

run = partial(maglev, "selfsense", "rivals")


@pytest.fixture(scope="module")
def planned():
    return cases(*load_sensor("hmb_free"))


def test_cases_are_the_rig_and_what_nobody_knows_of_it(planned):
    nominal, hot, rich, richer, step, weak = planned
    m = nominal.magnet
    assert (m.mass, m.actuator_gain, m.emf, m.resistance) == (0.08012, 5.7, 5.7, 2.0)
    assert m.stiffness == pytest.approx(-12.5e3) and m.inductance == pytest.approx(0.571e-3, rel=1e-3)
    assert hot.magnet.resistance == hot.coil.resistance == pytest.approx(2.4)
    assert rich.voltage == pytest.approx(28.8) and rich.magnet == m
    assert float(richer.coil.inductance(0.35e-3)) == pytest.approx(richer.magnet.inductance) == 1.2 * m.inductance
    assert weak.magnet == weak.believed and weak.magnet.emf == weak.coil.magnet_emf == pytest.approx(0.636, abs=1e-3)
    assert all(c.believed == m for c in planned[:5])
    assert all(c.coil.magnet_emf == 5.7 for c in planned[:5])
    moved = levitate(m, np.full(1500, step.step), 25e3).displacement[-1]
    assert moved == pytest.approx(0.04 * 0.35e-3, rel=0.1)


@pytest.mark.parametrize(("rig", "names"), [("eframe", 5), ("hmb_radial", 6)])
def test_other_rigs_have_their_cases(rig, names):
    """The coil of an electromagnet has no magnet, hence no smaller back-EMF."""
    assert len(cases(*load_sensor(rig))) == names


def test_poles_are_those_of_the_settled_filter(planned):
    """By iterating the Riccati recursion instead of solving its equation."""
    m, rate = planned[0].magnet, 25e3
    force, current, voltage = _noise(m)
    a, b, c = linear_model(m)
    f, _ = sampled(a, b, rate)
    q, p = process_noise(m, rate, force, voltage), np.diag(m.units) ** 2
    for _ in range(20_000):
        gain = p @ c.T / (c @ p @ c.T + current**2)
        p = f @ (p - gain @ c @ p) @ f.T + q
    expected = np.log(np.linalg.eigvals(f - f @ gain @ c).astype(complex)) * rate
    assert np.sort_complex(poles_of(m, rate)) == pytest.approx(np.sort_complex(expected), rel=1e-3)


def test_noise_is_that_of_the_averaged_comparison(planned):
    assert _noise(planned[0].magnet) == pytest.approx((0.01, 2e-3, 1e-4), rel=0.05)


def test_a_levitation_in_parts_is_one(planned):
    magnets = [planned[0].magnet, planned[1].magnet]
    force = np.random.default_rng(3).normal(0.0, 1.0, (2, 101))
    parts = _levitate(magnets, force, 25e3, 24.0, lambda: None)
    whole = levitate(magnets, force, 25e3)
    for name in ("displacement", "velocity", "current", "voltage"):
        expected = getattr(whole, name)[:, :100]
        np.testing.assert_allclose(getattr(parts, name), expected, rtol=1e-6, atol=1e-6 * np.abs(expected).max())


def test_a_fit_takes_offset_and_gain_and_leaves_the_motion_at_most():
    rng = np.random.default_rng(1)
    truth, noise = rng.normal(size=2000), rng.normal(size=2000)
    assert _fitted(truth, 3.0 - 0.2 * truth) == pytest.approx(0, abs=1e-12)
    assert _fitted(truth, noise) == pytest.approx(truth[1000:].std(), rel=0.01)
    line = np.polyfit((truth + noise)[1000:], truth[1000:], 1)
    expected = np.std(truth[1000:] - np.polyval(line, (truth + noise)[1000:]))
    assert _fitted(truth, truth + noise) == pytest.approx(expected)


@pytest.mark.slow
def test_each_ignorance_costs_whom_it_should(tmp_path, monkeypatch):
    monkeypatch.setattr(rivals_experiments, "_SECONDS", (0.1, 0.3))
    output = run("--seed", 4, "--out", tmp_path / "v.html", "--json", tmp_path / "v.json")
    data = json.loads((tmp_path / "v.json").read_text())
    assert data["schema"] == "maglev-selfsense-rivals/1" and data["seed"] == 4 and data["seconds"] == 0.3
    rows = {d["name"]: d for d in data["cases"]}
    nominal, hot, step = rows["nominal"], rows["resistance +20 %"], rows["force step"]
    for d in (nominal, hot, step):  # the ripple tells the gap whatever rotor and resistance do
        assert d["errors"]["estimator"] == pytest.approx(1.12e-6, rel=0.1)
    for rival in ("observer", "kalman"):
        assert nominal["errors"][rival] < nominal["motion"]
        assert hot["errors"][rival] > 3 * nominal["errors"][rival]
        assert hot["errors"][rival] > 2 * hot["motion"]
        assert step["errors"][rival] > 5 * step["errors"]["estimator"]
        assert hot["fitted"][rival] > 3 * hot["fitted"]["estimator"]
    # A ripple 20 % too high, or 1 / 1.2 of it, at 0.35 mm.
    assert rows["supply voltage +20 %"]["errors"]["estimator"] == pytest.approx(0.2 * 350e-6, rel=0.03)
    assert rows["inductance +20 %"]["errors"]["estimator"] == pytest.approx(350e-6 / 6, rel=0.03)
    for name in ("supply voltage +20 %", "inductance +20 %"):
        assert rows[name]["fitted"]["estimator"] < 1.6e-6
    assert rows["back-EMF of one coil, known"]["claim"] > 2 * nominal["claim"]
    assert nominal["claim"] == pytest.approx(2.8e-6, rel=0.1)
    assert data["observability"]["rank"] == 3
    assert len(nominal["series"]["own_time"]) == len(nominal["series"]["estimator"])
    page = (tmp_path / "v.html").read_text()
    for text in ("the state observer reads a motion of", "20 % more coil resistance"):
        assert text in page and text in output
