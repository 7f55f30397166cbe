"""The kinds of excitation that `maglev new` names."""

import tomllib
from dataclasses import asdict

import numpy as np
import pytest
from scipy.signal import lfilter

from maglev_env.loop.controller_forms import Pid
from maglev_env.loop.gains import Gains, controller_output
from maglev_env.recordings.guess.agreed import one_controller
from maglev_env.recordings.guess.controller import NO_LEAK
from maglev_env.recordings.guess.controllers import said_of_the_integral, without_leak
from maglev_env.recordings.guess.recording import guess_recording
from maglev_env.recordings.guess.shape import shape_of

RATE, SECONDS = 5000.0, 20
T = np.arange(int(RATE * SECONDS)) / RATE


def chirp(first, last):
    return np.sin(2 * np.pi * (first * T + (last - first) * T**2 / 2 / SECONDS))


@pytest.mark.parametrize(("first", "last"), [(1, 25), (2, 300), (5, 400)])
def test_slow_and_fast_chirps_are_chirps(first, last):
    assert shape_of(chirp(first, last), RATE)[0] == "chirp"


def test_a_hammer_blows_and_steps_step():
    force = np.zeros(T.size)
    for k in range(3000, T.size - 100, 4500):
        force[k : k + 20] = 50 * np.sin(np.pi * (np.arange(20) + 0.5) / 20)
    assert shape_of(force, RATE)[0] == "blows"
    assert shape_of(np.repeat(np.random.default_rng(0).normal(size=20), T.size // 20), RATE)[0] == "steps"


def test_gains_that_fits_of_one_controller_give_are_one_set(tmp_path):
    rng, fs, kp, ki, kd, td = np.random.default_rng(1), 1000.0, 300.0, 300.0, 8.0, 2e-3
    guesses = []
    for name, digits in (("a", 9), ("b", 5)):
        y = np.cumsum(rng.normal(size=4000)) * 1e-6
        y -= np.linspace(y[0], y[-1], y.size)
        command, integral, slope, before = np.zeros(y.size), 0.0, 0.0, 0.0
        for j, e in enumerate(-y):  # another discretisation than the product's: backward differences
            slope += ((e - before) * fs - slope) / (1 + td * fs)
            command[j], before = kp * e + integral + kd * slope, e
            integral += ki * e / fs
        np.savetxt(tmp_path / f"{name}.csv", np.c_[T[: y.size] * 5, y * 1e3, command], f"%.{digits}f", ",",
                   header="time_s,gap_mm,u_cmd_A", comments="")  # fmt: skip
        guesses.append(guess_recording(tmp_path / f"{name}.csv"))
    one, other = one_controller(guesses)
    assert one.gains == other.gains and one.gains["kp"] == pytest.approx(kp, rel=5e-3)
    assert one.gains["ki"] / one.gains["ti"] == pytest.approx(ki, rel=0.05)
    assert "those of" in (one.controller.reason + other.controller.reason)


def test_an_integral_whose_leak_no_record_tells_is_told_as_a_pure_one(tmp_path):
    """Of a long leak only ki / ti is told: "ki = 248669, ti = 12.4" had been stated of 20000 A/(m s)."""
    rng, fs, kp, ki, kd, td = np.random.default_rng(1), 1000.0, 300.0, 900.0, 8.0, 2e-3
    y = 1e-6 * np.cumsum(rng.normal(size=4000))
    y -= np.linspace(y[0], y[-1], y.size)
    integral = np.cumsum(-y) / fs
    slope = lfilter([1 / (1 + td * fs)], [1.0, -td * fs / (1 + td * fs)], np.diff(-y, prepend=0.0)) * fs
    t = np.arange(y.size) / fs

    def guessed(name, command):
        columns = np.c_[t, y * 1e3, command]
        np.savetxt(tmp_path / name, columns, "%.7f", ",", header="time_s,gap_mm,u_cmd_A", comments="")
        return guess_recording(tmp_path / name)

    one = guessed("pure.csv", -kp * y + ki * integral + kd * slope).gains
    told, (said, line) = without_leak(one, fs), said_of_the_integral(one, fs)
    assert one["ti"] == NO_LEAK and one["ki"] / NO_LEAK == pytest.approx(ki, rel=5e-3)
    assert told["form"] == "pid" and tomllib.loads(line)["controller"] == told and "no leak" in said
    expected = {"kp": kp, "ki": ki, "kd": kd, "td": td}
    assert {n: told[n] for n in expected} == pytest.approx(expected, rel=5e-3)

    leaking = Gains(kp, ki, kd, td, 1.0)
    leaks = guessed("leaks.csv", controller_output(leaking, y, 1 / fs)).gains
    said, line = said_of_the_integral(leaks, fs)
    assert said.startswith("the integral gain, ki / ti, is ") and not line
    assert leaks["ti"] == pytest.approx(1.0, rel=0.1) and leaks["ki"] == pytest.approx(ki, rel=0.1)


def test_a_pure_integral_is_the_same_recursion_as_one_that_hardly_leaks():
    gains = Gains(300.0, 900.0 * NO_LEAK, 8.0, 2e-3, NO_LEAK)
    form = without_leak(asdict(gains), 1000.0)
    e = np.random.default_rng(2).normal(size=300)
    made = controller_output(Pid(**{n: v for n, v in form.items() if n != "form"}), e, 1e-3)
    assert made == pytest.approx(controller_output(gains, e, 1e-3), rel=1e-3, abs=0.1)
    assert without_leak({"kp": 3.0, "ki": NO_LEAK, "kd": 0.0, "td": 0.0, "ti": NO_LEAK}, 1e3) == {
        "form": "pid", "kp": 2.999, "ki": 1.0
    }  # fmt: skip
