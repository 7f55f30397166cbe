"""The items of section 3.5 and of monitoring: against simulation, closed forms and what the text prints."""

from functools import lru_cache

import numpy as np
import pytest

from maglev_env.rotor.rotor import load_rotor
from maglev_env.rotor.run_up import run_up
from maglev_workbench.commands.reproduce.chapters.bearing.pump_damping import asked_for, forward_tilt
from maglev_workbench.commands.reproduce.registry import chosen

PUMP = load_rotor("pump")
DIFFERS = {
    "levitation": ["radial displacement at 14,000 rpm", "axial displacement at 14,000 rpm"],
    "run-up": ["displacement at 14,000 rpm over the largest", "axial displacement at 10,000 rpm"],
    "coil-current": [
        "bearing power at 10,000 rpm",
        "supply current, linear amplifiers, one for each coil",
        "the same, control currents alone, one for each axis",
    ],
    "axial-force": [
        "force at no displacement",
        "radial force at no displacement, eq 3.9",
        "stiffness of both bearings, Table 3.3",
    ],
    "temperature": [],
}


@lru_cache
def outcome(name, seed=0):
    return chosen([name])[0].run(seed)


def found(name, row):
    (value,) = [r.found for r in outcome(name).rows if r.name == row]
    return value


@pytest.mark.slow
@pytest.mark.parametrize("name", DIFFERS)
def test_rows_are_whole_and_those_that_differ_say_why(name):
    for seed in (0, 7):
        rows = outcome(name, seed).rows
        assert len({row.name for row in rows}) == len(rows) and all(np.isfinite(row.found) for row in rows)
        assert [row.name for row in rows if row.agrees is False] == DIFFERS[name]
        assert all(row.reason for row in rows if row.agrees is False)
        assert outcome(name, seed).plots


@pytest.mark.slow
@pytest.mark.parametrize("by_lag", [False, True])
def test_the_simulation_falls_as_the_linear_model_was_asked_to(by_lag):
    soft, k, _ = asked_for(PUMP, by_lag)
    speeds = np.arange(8000.0, 14001.0, 250.0)
    # The published response at a quarter of the assumed unbalance, where the force law is still straight.
    light = {"static": PUMP.unbalance.static / 4, "couple": PUMP.unbalance.couple / 4}
    quarter = type(soft.unbalance)(**light, angle=PUMP.unbalance.angle)
    rotor = type(soft)(**{**vars(soft), "unbalance": quarter})
    once = run_up([rotor], speeds, threads=1).once[0, :, 0]
    assert speeds[once.argmax()] == pytest.approx(10_000, abs=250)
    assert once[-1] / once.max() == pytest.approx(8 / 30, abs=0.03)
    assert once.max() == pytest.approx(30e-6, rel=0.1)
    assert 1.2 < k < 1.6 and forward_tilt(soft)[1] < 0.2 * forward_tilt(PUMP)[1]


@pytest.mark.slow
def test_axial_figures_by_hand():
    """Table 3.3 by least squares through its first row."""
    z, f = np.array([4.5, 13.5, 21.0, 27.0]), np.array([0.01948, 0.03348, 0.06163, 0.11061])
    k = float(z @ f / (z @ z)) * 1e3
    assert found("axial-force", "stiffness of one bearing, Table 3.3") == pytest.approx(k, rel=1e-9)
    rig = np.sqrt(2e3 * k / 0.13) / (2 * np.pi)
    assert found("axial-force", "axial mode of the test rig by Table 3.3") == pytest.approx(rig)
    force = found("run-up", "axial force that 70 µm would take")
    w = 10_000 * np.pi / 30
    assert force == pytest.approx(70e-6 * (0.08012 * w**2 - 2e3 * k), rel=1e-6)


def test_powers_and_heat_by_hand():
    assert found("coil-current", "motor power at 10,000 rpm") == pytest.approx(23.5 * 0.22, rel=0.01)
    assert found("coil-current", "copper loss of the bias current alone") == pytest.approx(8 * 0.2**2 * 2)
    for minutes in (10, 60, 120, 240):
        end = found("temperature", f"final rise if the time constant is {minutes} min")
        assert end * (1 - np.exp(-120 / minutes)) == pytest.approx(18)


@pytest.mark.slow
def test_monitoring():
    rows = {row.name: row.found for row in outcome("monitoring").rows}
    assert abs(rows["its bias against the linear model along the orbit"]) < 0.2
    assert rows["its bias against the linear model about the centre"] > 0.8
    assert rows["change found of a 10 % step"] == pytest.approx(9.8, abs=0.3)
    assert rows["delay of the alarm, step of 10 %"] <= 0.5 and rows["delay of the alarm, step of 1 %"] <= 3
    (_, drawn), *_ = outcome("monitoring").plots
    assert len(drawn.layout.shapes) == 2  # one alarm, in both panels
