"""The kinds of excitation that `maglev new` names."""

import numpy as np
import pytest

from maglev_env.recordings.guess.agreed import one_controller
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
