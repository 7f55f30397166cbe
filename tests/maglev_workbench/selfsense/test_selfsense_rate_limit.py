"""`maglev selfsense rate-limit`: the map against the stability of single sensors and the simulation."""

import json
from dataclasses import replace
from functools import partial
from importlib.resources import files

import numpy as np
import pytest
from command_line import maglev

from maglev_workbench.commands.selfsense.rate_limit import rate_map
from maglev_workbench.commands.selfsense.rate_limit.rate_map import Gains, as_predicted, settled
from maglev_workbench.commands.selfsense.rig_sensor import load_sensor
from selfsense.design import assess, with_gains
from selfsense.linear import stable

run = partial(maglev, "selfsense", "rate-limit")
GAIN = 609.8  # A/m: of the digital path at rest


def sampled(rate, loop, integral):
    """The rig's sensor at a rate (Hz), with gains times the path's gain."""
    sensor = with_gains(load_sensor("hmb_free")[1], loop / GAIN, integral / GAIN)
    return replace(sensor, acquisition=replace(sensor.acquisition, rate=rate))


@pytest.fixture
def small_map(monkeypatch):
    monkeypatch.setattr(rate_map, "_LOOP", np.geomspace(0.4, 6.0, 5))
    monkeypatch.setattr(rate_map, "_INTEGRAL", np.geomspace(1e3, 1e5, 5))
    monkeypatch.setattr(rate_map, "_CORNERS", np.geomspace(30.0, 10e3, 5))
    monkeypatch.setattr(rate_map, "CHECKED", (1, 3))


@pytest.mark.parametrize(
    ("rate", "loop", "integral", "holds"),
    [(262.5e3, 1.63, 21.5e3, True), (55e3, 1.63, 21.5e3, True), (50e3, 1.63, 21.5e3, False), (50e3, 0.3, 500.0, True)],
)
def test_settled_is_what_the_linear_model_says(rate, loop, integral, holds):
    sensor = sampled(rate, loop, integral)
    assert settled(sensor) == stable(sensor) == holds


def test_running_from_end_to_end_in_step_is_not_settled():
    """From every start the same orbit, 693 µm wide and locked to the PWM."""
    sensor = sampled(260e3, 5.579, 13.09e3)
    assert not stable(sensor)
    assert not settled(sensor)


@pytest.mark.parametrize(
    ("lowest", "settles", "agrees"),
    [
        (1e5, (True, False), True),
        (1e5, (False, False), False),
        (1e5, (True, True), False),
        (5e4, (True, None), True),
        (np.nan, (False, None), True),
        (np.nan, (True, None), False),
    ],
)
def test_what_agrees_with_the_map(lowest, settles, agrees):
    assert as_predicted(Gains("", None, 1.0, 1.0, lowest, None, settles)) is agrees


@pytest.mark.slow
def test_the_whole_map(tmp_path):
    output = run("--out", tmp_path / "r.html", "--json", tmp_path / "r.json")
    data = json.loads((tmp_path / "r.json").read_text())
    assert data["schema"] == "maglev-selfsense-rate-limit/1"
    assert data["path_gain"] == pytest.approx(GAIN, rel=1e-3)
    lowest = {d["asked_lag"]: d["lowest"] for d in data["designs"]}
    assert lowest == {None: 55e3, 20.0: 105e3, 50.0: 55e3, 55.0: 55e3}
    assert data["designs"][3]["design"]["phase_margin"] == pytest.approx(82.4, abs=0.5)
    for d in (*data["designs"], *data["claimed"]):
        assert d["settles"] == {"at_lowest": True, "one_step_below": False}
    agree = [
        as_predicted(Gains("", None, 0, 0, d["lowest"] or np.nan, None, tuple(d["settles"].values())))
        for d in data["simulated"]
    ]
    assert len(agree) == 36 and sum(agree) >= 35
    held = np.array(data["map"]["lowest"], float)
    assert np.isnan(held).any() and np.nanmin(held) == 50e3 and np.nanmax(held) > 240e3
    assert "36 of 36" in (tmp_path / "r.html").read_text()
    # The dissertation's 165 kHz: little margin, but its 18 degrees of lag.
    assert [d["lowest"] for d in data["claimed"]] == [165e3] * 3
    limit = next(x for x in data["limits"] if x["rate"] == 165e3)
    margin, in_d, lag = (np.array(limit[name], float) for name in ("margin", "margin_in_d", "lag"))
    assert np.nanmin(margin) > 0 and np.nanmax(margin) < 9 and np.nanmax(in_d) < 9
    assert np.nanmin(lag) < 18 < np.nanmax(lag)
    assert "some with its 18° of lag at 4 kHz, but none with its 83° of margin" in output
    assert "The rig's own gains are stable from 55 kHz on, those for 20° of lag from 105 kHz on" in output


def test_map_and_limits_are_those_of_single_sensors(tmp_path, small_map):
    output = run("--out", tmp_path / "r.html", "--json", tmp_path / "r.json")
    data = json.loads((tmp_path / "r.json").read_text())
    sensor, rates, m = load_sensor("hmb_free")[1], data["rates"], data["map"]
    assert rates == [50e3 + 5e3 * i for i in range(43)]
    seen = np.array(m["lowest"], float)
    assert np.isnan(seen).any() and (seen > 60e3).any()
    for i, j in ((1, 1), (2, 3), (3, 2), (4, 0)):
        own = with_gains(sensor, m["kp"][i], m["ki"][j])
        holds = [stable(replace(own, acquisition=replace(own.acquisition, rate=rate))) for rate in rates]
        above = next((k for k in range(len(rates) - 1, -1, -1) if not holds[k]), -1) + 1
        np.testing.assert_equal(seen[i, j], rates[above] if above < len(rates) else np.nan)
    limit = data["limits"][0]
    assert limit["rate"] == 165e3
    for k, (kp, ki) in enumerate(zip(limit["kp"], limit["ki"], strict=True)):
        for share, holds in ((0.99, True), (1.01, False)):
            own = with_gains(sensor, share * kp, share * ki)
            assert stable(replace(own, acquisition=replace(own.acquisition, rate=165e3))) == holds
        for rate, name in ((262.5e3, "margin"), (250e3, "margin_in_d")):
            own = with_gains(replace(sensor, acquisition=replace(sensor.acquisition, rate=rate)), kp, ki)
            assert limit[name][k] == pytest.approx(assess(own).phase_margin)
    assert "kHz (" in output and "at 250 kHz)" in output


def test_a_supply_that_165_kHz_is_too_slow_for(tmp_path, small_map):
    text = (files("maglev_env") / "rigs" / "hmb_free.toml").read_text()
    rig = tmp_path / "fast.toml"
    rig.write_text(f"{text}\n[self_sensing]\npwm_frequency = 100e3\nsample_rate = 500e3\nkp = 0.002\nki = 10.0\n")
    output = run("--rig", rig, "--out", tmp_path / "r.html", "--json", tmp_path / "r.json")
    assert "At 165 kHz this supply cannot be sampled" in output
    assert json.loads((tmp_path / "r.json").read_text())["limits"] == []


def test_a_path_that_no_rate_of_the_map_suits_is_refused(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    text = (files("maglev_env") / "rigs" / "hmb_free.toml").read_text()
    table = 'forward_path = "analog"\nsample_rate = 52.5e3\nkp = 1e-4\nki = 0.5\n'
    (tmp_path / "slow.toml").write_text(f"{text}\n[self_sensing]\n{table}")
    assert "there is no rate that the forward path can be sampled at" in run("--rig", "slow.toml", code=2)
