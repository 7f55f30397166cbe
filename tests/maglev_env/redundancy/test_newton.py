"""Newton's law is asked where the mass moves, not where the controller has made the current of the probe's noise."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.linalg import expm

from maglev_env.loop.gains import LinearController
from maglev_env.loop.magnets.kinds import force_law
from maglev_env.loop.magnets.law import linearise
from maglev_env.redundancy.coverage import uncovered
from maglev_env.redundancy.explained import or_effect
from maglev_env.redundancy.newton import CURRENT_EFFECTS, _row, moved
from maglev_env.redundancy.rows import Fit, Row
from maglev_env.redundancy.view import View
from maglev_env.rig.rig import Rig
from maglev_env.rig.rig_file import load_rig

RATE, SAMPLES = 100.0, 3000
BALL = Rig("ball", "electromagnet", mass=0.058, gap=10e-3, turns=1000, pole_area=3e-4, bearings=2, control_rate=RATE,
           adc_bits=0, dac_bits=0)  # fmt: skip


def levitated(noise, late, force):
    """View of a ball that a PD holds, pushed by a white force of some rms (N) at the current; linear, exact steps.

    Its probe has white noise (m rms), and the displacement in the file comes some samples late.
    """
    gain, stiffness = linearise(force_law(BALL))
    rng = np.random.default_rng(1)
    step = expm(np.array([[0, 1, 0], [-stiffness / BALL.mass, 0, gain / BALL.mass], [0, 0, 0]]) / RATE)
    kp, kd = 2.0 * abs(stiffness) / gain, 0.9 * np.sqrt(abs(stiffness) * BALL.mass) / gain
    added = force / gain * rng.normal(size=SAMPLES)
    state, before, y, i = np.zeros(2), 0.0, np.empty(SAMPLES), np.empty(SAMPLES)
    for k in range(SAMPLES):
        y[k] = state[0] + noise * rng.normal()
        i[k] = -kp * y[k] - kd * (y[k] - before) * RATE + added[k]
        before = y[k]
        state = step[:2, :2] @ state + step[:2, 2] * i[k]
    assert abs(state[0]) < BALL.gap
    channels = {"displacement": np.roll(y, late), "current": i}
    names = frozenset(channels)
    return View("run", RATE, channels, names, {n: n for n in names}, (), frozenset(), None, (), BALL, BALL.mass)


def test_noise_that_the_controller_fed_back_is_not_asked():
    """Nothing is stated of the probe's noise; the ratio of its reading to the current is that of the controller."""
    (row,) = moved(levitated(0.0, 0, 0.05))
    assert not row.off and row.delay * RATE == pytest.approx(0.0, abs=0.05)
    assert not any(row.off for row in moved(levitated(2e-4, 0, 0.01)))


def test_a_late_reading_is_still_found_above_its_noise():
    rows = moved(levitated(2e-6, 3, 0.05))
    assert rows and rows[0].delay_off() and rows[0].delay * RATE == pytest.approx(3.0, abs=0.1)


def test_a_time_that_one_line_cannot_tell_is_said():
    row = Row("injection to command", {"command": 1, "reference": -1}, 1.0, 1e-3, 0.02, "the reference", delay=None)
    (said,) = uncovered(levitated(0.0, 0, 0.05), [row])
    assert "time of the reference" in said.message and "excite more than one line" in said.message


def test_a_limit_that_the_controller_does_not_state_is_why_its_gains_are_not_checked():
    """Every channel was recorded at the control rate, and the advice was to do that."""
    view = levitated(0.0, 0, 0.05)
    channels = {**view.channels, "command": view.channels["current"], "injection": view.channels["current"]}
    gains = LinearController((1.0,), (1.0,))
    for railed, said in ((frozenset({"command"}), "state its limit"), (frozenset(), "record every channel")):
        stated = replace(view, channels=channels, recorded=frozenset(channels), gains=gains, railed=railed)
        (finding,) = uncovered(stated, [])
        assert "gains" in finding.channel and said in finding.message


def test_a_force_that_nobody_recorded_is_no_delay_of_the_displacement():
    """Taps on a hovering ball: command and displacement are related by the controller, which is stated."""
    gain, stiffness = linearise(force_law(BALL))
    rng = np.random.default_rng(2)
    step = expm(
        np.array(
            [[0, 1, 0, 0], [-stiffness / BALL.mass, 0, gain / BALL.mass, 1 / BALL.mass], [0, 0, 0, 0], [0, 0, 0, 0]]
        )
        / RATE
    )
    kp, kd = 2.0 * abs(stiffness) / gain, 0.9 * np.sqrt(abs(stiffness) * BALL.mass) / gain
    pushes = np.where(rng.random(SAMPLES) < 0.02, 0.2 * rng.normal(size=SAMPLES), 0.0)
    state, before, y, i = np.zeros(2), 0.0, np.empty(SAMPLES), np.empty(SAMPLES)
    for k in range(SAMPLES):
        y[k] = state[0]
        i[k] = -kp * y[k] - kd * (y[k] - before) * RATE
        before = y[k]
        state = step[:2, :2] @ state + step[:2, 2] * i[k] + step[:2, 3] * pushes[k]
    channels = {"displacement": y, "current": i, "command": i}
    view = View(
        "taps",
        RATE,
        channels,
        frozenset(channels),
        {n: n for n in channels},
        (),
        frozenset(),
        None,
        (),
        BALL,
        BALL.mass,
    )
    unknown = moved(view)
    assert unknown and any(row.off for row in unknown)  # without a controller nothing tells that it made the current
    pd = LinearController((kp + kd * RATE, -kd * RATE), (1.0, 0.0))
    assert not moved(replace(view, gains=pd))


def test_what_damps_makes_the_displacement_early_and_what_lags_late():
    rig = replace(load_rig("hmb_free"), gains=None)
    found = Fit(np.ones(1), np.array([-2e-4]), np.full(1, 1e-3), np.full(1, 1e-6), 0.0, 0.0, np.full(1, 50.0))
    seen = View("run", rig.control_rate, {}, frozenset(), {}, (), frozenset(), None, (), rig, rig.mass)
    powers = {"displacement": 1, "current": -1, "mass": 1, "actuator gain": -1}
    early = _row(seen, found, 0, powers, (), 0.0, 100.0)
    late = _row(seen, replace(found, delay=np.array([2e-4])), 0, powers, (), 0.0, 100.0)
    assert "friction" in early.delay_effects and "sensor_lag" not in early.delay_effects
    assert "sensor_lag" in late.delay_effects and "delay" not in late.delay_effects
    bent = _row(seen, replace(found, misfit=0.3), 0, powers, (), 0.0, 100.0)
    assert {"soft_stop", "support_resonance"} <= {*bent.delay_effects}


@pytest.mark.parametrize(("late", "told"), [(0.0, True), (2e-3, True), (11e-3, False)])
def test_a_sign_is_not_told_where_the_motion_is_turned_by_more_than_an_eighth(late, told):
    """At 17 Hz. A cable that creeps, six times as stiff as the magnet, makes a ball lag by 67 degrees beside that."""
    found = Fit(np.array([-1.09]), np.array([late]), np.full(1, 0.01), np.full(1, 1e-4), 0.1, 1.0, np.full(1, 40.0))
    powers = {"displacement": 1, "current": -1, "mass": 1, "actuator gain": -1}
    row = _row(levitated(0.0, 0, 0.05), found, 0, powers, CURRENT_EFFECTS, 0.0, 17.0)
    assert row.off and row.signed == told and or_effect(row) != told
