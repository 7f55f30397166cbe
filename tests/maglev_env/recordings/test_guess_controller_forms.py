"""Controllers of other forms, told from what they read and what they asked for; the loops here are written out."""

import numpy as np
import pytest
from scipy.signal import iirnotch, lfilter

from maglev_env.recordings.guess.controller_forms import fit_form
from maglev_env.recordings.guess.controllers import controllers
from maglev_env.recordings.guess.gaps import whole

RATE, N = 1000.0, 5000
DT = 1 / RATE


def signals(seed=3, steps=True):
    """A displacement, a reference that steps (or rests) and a current, of no rig in particular."""
    rng = np.random.default_rng(seed)
    r = np.repeat(rng.uniform(-1e-3, 1e-3, 10), N // 10) if steps else np.zeros(N)
    y, i, slow, held = np.zeros(N), np.zeros(N), 0.0, 0.0
    for k in range(N):
        slow += 0.01 * (r[k] - slow) + 1e-6 * rng.standard_normal()
        held += 0.05 * (slow - held)
        y[k], i[k] = 1.5 * held - 0.3 * slow, 40 * (slow - held) + 1e-3 * rng.standard_normal()
    return y, r, i


def pid(y, r, kp, ki, kd, td, tf=0.0, weight=1.0, measured=True):
    """A PID in parallel form, tick by tick."""
    u, integral, d, rf = np.zeros(N), 0.0, 0.0, r[0]
    before = None
    for k in range(N):
        rf += DT / (tf + DT) * (r[k] - rf)
        seen = -y[k] if measured else rf - y[k]
        integral += ki * DT * (rf - y[k])
        d = (td * d + kd * (seen - (seen if before is None else before))) / (td + DT)
        before = seen
        u[k] = kp * (weight * rf - y[k]) + integral + d
    return u


def test_a_derivative_on_the_measurement_and_a_set_point_filter_are_told():
    y, r, _ = signals()
    found = fit_form(y, 0.6 + pid(y, r, 160.0, 40.0, 2.6, 2e-3, 0.03), RATE, r).table
    stated = {"kp": 160.0, "ki": 40.0, "kd": 2.6, "td": 2e-3, "setpoint_filter": 0.03}
    assert found["form"] == "pid" and found["derivative_on"] == "measurement"
    assert {name: found[name] for name in stated} == pytest.approx(stated, rel=1e-3) and len(found) == 7


def test_a_set_point_weight_is_told_and_parts_that_are_not_there_are_not_stated():
    y, r, _ = signals(4)
    found = fit_form(y, pid(y, r, 300.0, 0.0, 1.5, 1e-3, weight=0.6), RATE, r).table
    assert found["setpoint_weight"] == pytest.approx(0.6, rel=1e-3) and found["kd"] == pytest.approx(1.5, rel=1e-3)
    assert "ki" not in found and "setpoint_filter" not in found


def test_a_feedback_of_the_current_is_told():
    y, r, i = signals(5)
    u = pid(y, r, 200.0, 30.0, 2.0, 1e-3) - 0.4 * i
    found = fit_form(y, u, RATE, r, None, i).table
    stated = {"displacement": 200.0, "velocity": 2.0, "current": 0.4, "integral": 30.0, "velocity_filter": 1e-3}
    assert found["form"] == "state_feedback"
    assert {name: found[name] for name in stated} == pytest.approx(stated, rel=1e-3)


def test_the_steps_of_an_encoder_hide_no_controller():
    y, r, _ = signals(6)
    u = pid(y, r, 450.0, 300.0, 9.0, 4e-3, 0.05)
    found = fit_form(np.round(y / 5e-7) * 5e-7, u, RATE, r)
    assert found is not None and found.table["kp"] == pytest.approx(450.0, rel=0.02)


def test_what_else_moves_a_command_is_no_controller():
    y, r, i = signals(7)
    u = pid(y, r, 160.0, 40.0, 2.6, 2e-3, 0.03)
    unstored = 0.05 * u.std() * np.random.default_rng(1).standard_normal(N)
    assert fit_form(y, u + unstored, RATE, r, None, i) is None


def test_a_limit_is_cut_around():
    y, r, _ = signals(8)
    u = pid(y, r, 160.0, 40.0, 2.6, 2e-3)
    top = np.sort(u)[-40]
    found = fit_form(y, np.minimum(u, top), RATE, r)
    assert found is not None and found.table["kp"] == pytest.approx(160.0, rel=1e-2)


def test_samples_that_are_missing_hide_no_controller():
    y, r, _ = signals(9)
    u = pid(y, r, 130.0, 60.0, 2.2, 2e-3, 0.02)
    kept = np.random.default_rng(2).random(N) > 0.004
    kept[0] = True
    stored = {"displacement": y[kept], "command": u[kept], "reference": r[kept]}
    channels, known = whole(stored, np.arange(N)[kept] * DT)
    assert channels["command"].size == np.flatnonzero(kept)[-1] + 1 and not known.all()
    found = fit_form(channels["displacement"], channels["command"], RATE, channels["reference"], known=known)
    assert found is not None and found.table["kd"] == pytest.approx(2.2, rel=1e-2)
    assert fit_form(stored["displacement"], stored["command"], RATE, stored["reference"]) is None


def test_a_clock_without_gaps_or_with_too_many_is_left_as_it_is():
    stored = {"y": np.arange(100.0)}
    for clock in (np.arange(100.0), np.arange(100.0) ** 1.5, np.repeat(np.arange(50.0), 2), 2.0 ** np.arange(100)):
        channels, known = whole(stored, clock)
        assert channels is stored and known.all()


def test_axes_with_other_controllers_are_asked_for_each():
    channels, known = {}, np.ones(N, bool)
    for axis, seed, kp in (("x", 10, 200.0), ("y", 11, 260.0)):
        y, r, _ = signals(seed)
        command = pid(y, r, kp, 40.0, 2.0, 2e-3)
        channels |= {f"displacement_{axis}": y, f"reference_{axis}": r, f"command_{axis}": command}
    gains, form, said = controllers(channels, known, RATE)
    assert gains is None and form is None and "gains.x" in said.ask and "'kp': 260.0" in said.reason


@pytest.mark.parametrize(("lag", "scale"), [(0.0, 1.0), (0.2, -1.0)])
def test_a_current_that_follows_its_command_is_no_controller(lag, scale):
    rng = np.random.default_rng(12)
    y, _, _ = signals(12, steps=False)
    b, a = iirnotch(60.0, 3.0, RATE)
    command = lfilter(b, a, -300.0 * y) + lfilter([0.05], [1.0, -0.95], 0.1 * rng.standard_normal(N))
    a = np.exp(-1 / lag) if lag else 0.0
    current = scale * lfilter([1 - a], [1.0, -a], command) + 1e-5 * rng.standard_normal(N)
    assert fit_form(y, command, RATE, None, None, current) is None


@pytest.mark.parametrize(("kp", "weight"), [(160.0, 3.0), (1e-4, 1.0)])
def test_a_weight_of_the_set_point_that_no_controller_has_is_not_stated(kp, weight):
    y, r, _ = signals(13)
    assert fit_form(y, pid(y, r, kp, 40.0, 2.6, 2e-3, weight=weight), RATE, r) is None
