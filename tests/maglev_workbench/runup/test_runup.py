"""`maglev runup` as a user runs it: table, page, JSON, touchdowns, and what is refused before any work."""

import json
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
import pytest
from command_line import maglev

from maglev_env.rig.rig_file import RIG_FOLDER, ROTOR_FOLDER
from maglev_env.rotor.linear import closed_loop_poles
from maglev_env.rotor.parts import Rejection
from maglev_env.rotor.rotor import ROTORS, load_rotor
from maglev_env.rotor.run_up import run_up
from maglev_workbench.commands.runup import study as runup
from maglev_workbench.commands.runup.asked import parse_speeds, with_chosen_gains, with_rejection

run = partial(maglev, "runup")
PUMP = load_rotor("pump")


def test_table_page_and_json(tmp_path):
    js = tmp_path / "r.json"
    text = run("--speeds", "0:14000:2000", "--out", tmp_path / "o", "--json", js, "--seed", 3, "--threads", 1)
    assert "No touchdown" in text and "at 10000 rpm" in text and "zone A" in text
    data = json.loads(js.read_text())
    assert data["schema"] == "maglev-runup/1" and data["seed"] == 3 and data["gains"]["tilt"]["kp"] == 8000
    assert [row["speed_rpm"] for row in data["speeds"]] == list(range(0, 14001, 2000))
    up = run_up([PUMP], np.arange(0, 14001, 2000.0), 3, 1)
    for i, row in enumerate(data["speeds"]):
        assert row["peak"] == up.peak[0, i].tolist() and row["copper_loss"] == up.copper_loss[0, i]
        assert row["zone"] == "A" and row["touchdown"] is None
        if row["speed_rpm"] >= 4000:  # where the orbit is above noise and quantisation
            assert row["once_per_turn"] == pytest.approx(row["linear_model"], rel=0.03)
    ten = data["speeds"][5]
    assert ten["motor_power"] == pytest.approx(5.2, rel=1e-3)  # the published motor power (3.5)
    assert ten["heat"] == pytest.approx(ten["motor_power"] + ten["copper_loss"])
    # The 18 K of two hours at 14,000 rpm, eleven time constants.
    assert data["final_temperature_rise"][-1] == pytest.approx(18, rel=0.01)
    assert {(s["speed_rpm"], s["controller"]) for s in data["sensitivity"]} == {
        (v, name) for v in (0, 14000) for name in ("translation", "tilt")
    }
    assert all(2 < s["peak_sensitivity"] < 4 and s["zone"] in "AB" for s in data["sensitivity"])
    page = (tmp_path / "o" / "runup.html").read_text()
    assert page.count("plotly-graph-div") == 5 and "15406 rpm" in page
    again = tmp_path / "again"
    run("--speeds", "0:14000:2000", "--out", again, "--seed", 3)
    assert (again / "runup.html").read_text() == page


def test_a_touchdown_is_told_and_is_no_error(tmp_path):
    js = tmp_path / "r.json"
    picture = tmp_path / "r.png"
    other = ("--kp", 1500, "--gains", "tilt.ti=0.05")
    text = run("--speeds", "0:6000:6000", *other, "--out", tmp_path, "--json", js, "--picture", picture)
    assert picture.read_bytes()[1:4] == b"PNG"
    assert "TOUCHDOWN at 2 speeds, first at 0 rpm: bearing" in text
    data = json.loads(js.read_text())
    assert all(g["kp"] == 1500 for g in data["gains"].values())
    for row in data["speeds"]:
        one = row["touchdown"]
        assert one["place"] in ("bearing a", "bearing b") and 0 < one["time"] < 0.5 and one["force"] > 1
        assert row["zone"] == "D" and row["linear_model"] == [None, None]
    assert all(s["peak_sensitivity"] is None and s["zone"] is None for s in data["sensitivity"])
    page = (tmp_path / "runup.html").read_text()
    assert "touched down" in page
    for end in ("td 0.0001 s, ti 0.0318 s; tilt", "td 0.0001 s, ti 0.05 s"):
        assert end in page and end in text


def test_on_self_sensing_the_same_on_the_probes_stands_beside_it(tmp_path):
    js = tmp_path / "r.json"
    speeds = ("--speeds", "0:14000:7000")
    text = run("--sensor", "self_sensing", *speeds, "--out", tmp_path, "--json", js, "--seed", 3)
    assert "No touchdown. On self-sensing: the displacement is off by up to 1." in text
    assert "probes at the coils" in text and "On self-sensing, and on the probes" in text
    data = json.loads(js.read_text())
    assert data["sensor"] == "self_sensing" and data["estimator"]["pwm_frequency"] == 25e3
    up = run_up([replace(PUMP, sensor="self_sensing")], np.array([0.0, 7000.0, 14_000.0]), 3)
    assert [row["gap_error_rms"] for row in data["speeds"]] == up.gap_error[0, :, 0].tolist()
    assert all(row["slowest_pole"] == pytest.approx(-42.8, abs=0.1) for row in data["speeds"])
    read = {(one["controllers_read"], one["speed_rpm"], one["mode"]): one for one in data["identified"]}
    assert len(read) == 12
    for speed in (0, 14_000):
        for mode in ("translation", "tilt"):
            sensed, moved = (read[name, speed, mode] for name in ("self-sensing", "probes at the coils"))
            assert sensed["stiffness"] == pytest.approx(moved["stiffness"], rel=0.03)
            assert 0.9 < sensed["damping"] / moved["damping"] < 0.99  # what the lag takes
        # Beside what the magnets take off, half the difference of the planes that are read holds the tilt.
        coils, probes = (read[name, speed, "tilt"]["stiffness"] for name in ("probes at the coils", "probes"))
        magnets = 12.5e3 * 0.027**2
        assert (coils + magnets) / (probes + magnets) == pytest.approx(27 / 22, rel=0.03)
    page = (tmp_path / "runup.html").read_text()
    assert "which lags 2.43° at 150 Hz" in page and "Bearings as identified" in page
    run(*speeds, "--out", tmp_path, "--json", js, "--seed", 3)
    alone = json.loads(js.read_text())
    assert data["on_probes"] == alone and alone["sensor"] == "probe" and alone["on_probes"] is None
    assert {one["controllers_read"] for one in alone["identified"]} == {"probes"}


def test_an_estimator_that_lags_as_measured_drops_it_and_the_linear_loop_says_why(tmp_path):
    axis, rotor = tmp_path / "late.toml", tmp_path / "pump.toml"
    axis.write_text((RIG_FOLDER / "hmb_free.toml").read_text() + "\n[self_sensing]\nkp = 0.0\nki = 2.741\n")
    rotor.write_text((ROTOR_FOLDER / "pump.toml").read_text().replace('"hmb_free"', '"late.toml"'))
    late = ("--sensor", "self_sensing", "--rotor", rotor, "--speeds", "0:14000:14000", "--out", tmp_path)
    text = run(*late)
    assert "TOUCHDOWN at 2 speeds" in text
    assert "is not stable: its slowest pole has 31.5 1/s, on the probes -42.8" in text
    assert "lags 30° at 150 Hz" in (tmp_path / "runup.html").read_text()
    assert "No touchdown" in run(*late, "--gains", "translation.kp=6000", "--gains", "tilt.kp=5000")


def test_out_of_the_motors_reach_is_said_before_any_work(tmp_path, monkeypatch):
    monkeypatch.setattr(runup, "report", lambda *_: pytest.fail("no simulation may run"))
    text = run("--speeds", "0:16000:500", "--out", tmp_path / "x", code=2)
    assert "16000 rpm is out of reach" in text and "N m against a drag of" in text and "lower --speeds" in text
    assert not (tmp_path / "x").exists()


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["--rotor", "hmb_free"], "neither a preset (pump)"),
        (["--rotor", "none.toml"], "none.toml"),
        (["--sensor", "coils"], "--sensor coils: use one of probe, self_sensing"),
        (["--speeds", "0:100"], "lo:hi:step"),
        (["--speeds", "5:1:1"], "the step must be above 0 and lo at most hi"),
        (["--speeds", "0:14000:0.1"], "1.4e+05 speeds"),
        (["--gains", "pitch.kp=1"], "a controller of translation, tilt and a gain of kp, ki, kd, td, ti"),
        (["--gains", "tilt.kp"], "controller.gain=value"),
        (["--gains", "tilt.kp=much"], "much"),
        (["--gains", "tilt.td=0"], "td = 0.0 s must be positive"),
        (["--picture", "r.doc"], "end it in .png, .svg, .pdf"),
    ],
)
def test_bad_input(arguments, words, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert words in run(*arguments, code=2)
    assert not list(tmp_path.iterdir())


def test_speeds_and_gains_as_written():
    assert parse_speeds("3000").tolist() == [3000]
    assert parse_speeds("0:1:0.1").tolist() == pytest.approx(np.arange(11) / 10)
    assert parse_speeds("0:14000:3000").tolist() == [0, 3000, 6000, 9000, 12000, 14000]
    assert parse_speeds("500:700:300").tolist() == [500, 700] and parse_speeds("7:7:1").tolist() == [7]
    for step in (0.7, 1 / 3, 7.0):  # whole steps end where they should, to rounding, and are not doubled
        assert np.diff(parse_speeds(f"0:{600 * step!r}:{step!r}")) == pytest.approx(np.full(600, step))
    chosen = with_chosen_gains(PUMP, {"kp": None, "ki": None, "kd": 6.0}, ["tilt.kd=7", "translation.kp=9e3"]).gains
    assert [chosen[name].kd for name in ("translation", "tilt")] == [6, 7]
    assert [chosen[name].kp for name in ("translation", "tilt")] == [9000, 8000]


def test_a_rate_of_rejection_keeps_the_least_speed_of_the_file(tmp_path):
    text = (ROTOR_FOLDER / "pump.toml").read_text()
    rotor, js = tmp_path / "own.toml", tmp_path / "r.json"
    rotor.write_text(text + "\n[rejection]\nrate = 5.0\nfrom_speed = 3000.0\n")
    for options, expected in (([], (5, 3000)), (["--rejection", 20], (20, 3000))):
        run("--rotor", rotor, "--speeds", "2000:4000:2000", *options, "--out", tmp_path, "--json", js)
        data = json.loads(js.read_text())
        assert (data["rejection"]["rate"], data["rejection"]["from_speed"]) == expected
        assert data["speeds"][1]["coil_once"][1] < 0.2 * data["speeds"][0]["coil_once"][1]  # below it acts on nothing
    assert with_rejection(PUMP, 20.0).rejection == Rejection(20.0) and with_rejection(PUMP, None) is PUMP


def test_modes():
    assert runup.spring(PUMP) == pytest.approx((5.7 * 8000 - 12500) / 2)
    still, spun = runup.whirl(PUMP, np.array([0.0, 14000.0]))
    bounce = np.sqrt(2 * runup.spring(PUMP) / PUMP.moving_mass) / (2 * np.pi)
    assert np.sum(abs(abs(still) - bounce) < 1e-6) == 2 and np.sum(abs(abs(spun) - bounce) < 1e-6) == 2
    conical = sorted(abs(spun[abs(abs(spun) - bounce) > 1e-6]))
    # Backward times forward is the square at rest, their difference the gyroscopic I_p / I_t of the speed.
    tilt = np.sqrt(runup.spring(PUMP) * 2 * 0.027**2 / PUMP.moving_inertia) / (2 * np.pi)
    ratio = PUMP.body.polar_inertia / PUMP.moving_inertia
    assert conical[0] * conical[1] == pytest.approx(tilt**2) and conical[1] - conical[0] == pytest.approx(
        ratio * 14000 / 60
    )
    found = runup.damped(PUMP, 0.0)
    z = closed_loop_poles(PUMP)
    slow = np.log(z[abs(z) > 0.5]) * 20e3
    assert found[0] == pytest.approx([102.7, 0.308], rel=2e-3)
    assert found[0, 0] == pytest.approx(min(slow.imag[slow.imag > 1]) / (2 * np.pi))


def test_motor_and_thermal_tables(tmp_path):
    text = (Path(runup.__file__).parents[3] / "maglev_env" / "rotors" / "pump.toml").read_text()
    path = tmp_path / "own.toml"
    path.write_text(text.replace("turns = 21 ", "turns = -21 "))
    with pytest.raises(ValueError, match=r"own.toml: motor: turns = -21 must be a number above 0"):
        load_rotor(path)
    path.write_text(text.replace("capacity = 400.0", "volume = 400.0"))
    with pytest.raises(ValueError, match=r"\[thermal\]: unknown key 'volume'; known keys: capacity, resistance"):
        load_rotor(path)
    start, end = text.index("[motor]"), text.index("[gains.translation]")
    path.write_text(text[:start] + text[end:])
    bare = load_rotor(path)
    assert bare.motor is None and bare.thermal is None and ROTORS == ("pump",)
    assert replace(bare, motor=PUMP.motor, thermal=PUMP.thermal) == PUMP
    js = tmp_path / "r.json"
    run("--rotor", path, "--speeds", "20000", "--out", tmp_path / "o", "--json", js)
    row = json.loads(js.read_text())["speeds"][0]
    assert "motor_power" not in row and row["heat"] == row["copper_loss"]


def test_the_motor_of_the_pump():
    motor = PUMP.motor
    assert 14_000 < motor.top_speed() * 30 / np.pi < 16_000
    w = 10_000 * np.pi / 30
    assert motor.drag_torque(w) * w + motor.copper_loss(w) == pytest.approx(5.2, rel=1e-3)
