"""Controllers with several inputs, limits and forms: against textbook programs, open loop and in simulated loops."""

import re
import tomllib
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from controller_cases import driven
from planar_rigs import COUPLED, axes_of, oblique
from reference_simulator import simulate
from textbook_controllers import by_hand

from maglev_env.design.defaults import with_defaults
from maglev_env.evaluation.evaluate import evaluate
from maglev_env.experiment import Experiment, protocol_experiment, without_noise
from maglev_env.kernel.simulate import simulate_records, simulate_statistics
from maglev_env.linear.expected import expected_statistics
from maglev_env.linear.loop import loop_response
from maglev_env.linear.poles import closed_loop, closed_loop_poles
from maglev_env.loop.controller_forms import Cascade, CurrentLoop, Pid, StateFeedback
from maglev_env.loop.gains import Gains, as_table, digital, realised, with_gains
from maglev_env.loop.linear_controller import LinearController
from maglev_env.recordings.campaign_writer import toml_value
from maglev_env.rig.controller_tables import controllers_from_table
from maglev_env.rig.excitation import Excitation
from maglev_env.rig.rig_file import rig_from_toml

DT = 1e-3
DOCS = Path(__file__).parents[3] / "docs" / "controllers.md"
EXAMPLES = [t for t in re.findall(r"```toml\n(.*?)```", DOCS.read_text(encoding="utf-8"), re.S) if "schema" in t]
RIGS = {rig.name: rig for rig in (rig_from_toml(text, "docs/controllers.md") for text in EXAMPLES)}
PID = Pid(200.0, 1500.0, 3.5, 2e-3, "measurement", 0.05, 0.7, (-0.3, 0.5))
CASCADE = Cascade(Pid(110.0, 60.0, 3.0, 5e-3, setpoint_filter=0.03), CurrentLoop(6.0, 400.0), 4.0, (-0.5, 0.4))
CONTROLLERS = {
    "pid": PID,
    "pid that winds up": replace(PID, anti_windup="none"),
    "pid on the error": Pid(200.0, 1500.0, 3.5, 2e-3),
    "a difference alone": Pid(0.0, kd=2.0, limit=(-0.3, 0.3)),
    "state feedback": StateFeedback(300.0, 5.0, 0.4, 2000.0, 1e-3, 0.02, (-0.4, 0.4)),
    "cascade": CASCADE,
    "cascade that winds up": replace(CASCADE, anti_windup="none"),
    "polynomials": LinearController(
        (60.0, -53.0), (1.0, -1.6, 0.6), (20.0, 0.0, -15.0), (0.3, -0.1), (-0.1, 0.2)
    ),
    "polynomials that wind up": LinearController(
        (60.0, -53.0), (1.0, -1.6, 0.6), (20.0, -15.0), (0.3,), (-0.1, 0.2), "none"
    ),
    "polynomials, the cut fed back": LinearController(
        (60.0, -53.0), (1.0, -1.6, 0.6), (20.0, -15.0), (0.3,), (-0.1, 0.2), (0.5, -0.2)
    ),
}  # fmt: skip


@pytest.mark.parametrize("name", CONTROLLERS)
def test_a_controller_is_what_its_textbook_program_computes(name):
    controller, rng = CONTROLLERS[name], np.random.default_rng(0)
    reference = np.repeat(rng.normal(scale=2e-3, size=20), 50)
    reading, current = 1e-3 * np.cumsum(rng.normal(scale=0.1, size=1000)), rng.normal(scale=0.2, size=1000)
    tick = by_hand(controller, DT)
    expected = np.array([tick(*now) for now in zip(reference, reading, current, strict=True)])
    found = digital(controller, DT).output((reference, -reading, -current))
    # Rounding grows with the square root of time behind one integral, and with time to the power 1.5 behind two.
    np.testing.assert_allclose(found, expected, rtol=0, atol=(1e-7 if "cascade" in name else 1e-10))
    if (limit := controller.limit) is not None:
        assert (found == limit[0]).sum() > 10 and (found == limit[1]).sum() > 10
        assert ((found > limit[0]) & (found < limit[1])).sum() > 20


def test_parts_without_gain_leave_no_pole():
    assert Pid(200.0).filter(DT) == LinearController((200.0,), (1.0,), anti_windup="none")
    assert Pid(200.0, kd=1.0, td=1e-3).filter(DT).order == 1
    assert Cascade(Pid(1.0), CurrentLoop(2.0), 4.0).filter(DT).order == 0


@pytest.mark.parametrize("name", RIGS)
def test_a_documented_rig_levitates(name):
    e = Experiment(RIGS[name], RIGS[name].gains, ())
    assert abs(closed_loop_poles(e)).max() < 1
    read = loop_response(e, np.array([5.0, 20.0]))
    # Ratios of the loop closed at the coil and broken at the reading, from the definition of each response.
    np.testing.assert_allclose(read.loop_gain, read.controller * read.plant)
    z = np.exp(2j * np.pi * read.frequency / e.rig.control_rate)
    a, b, c, d = realised(e.gains, 1 / e.rig.control_rate)
    r, y, i = (np.linalg.solve(z[:, None, None] * np.eye(len(a)) - a, b) * c[:, None]).sum(axis=1).T + d[:, None]
    command = 1 / (1 + y * read.plant + i * read.amplifier)  # per injection
    np.testing.assert_allclose(read.sensitivity, 1 - y * read.plant * command)
    np.testing.assert_allclose(read.from_injection * read.sensitivity, command)
    np.testing.assert_allclose(read.from_reference * read.sensitivity, r * command)


# Limits (A) that each touches but survives, and a static reference (m).
LIMITED = {
    "ball under state feedback": (0.05, 2e-4),
    "ball under PID": (0.045, 2e-4),
    "ball under a cascade": (0.2, 1e-4),
}


@pytest.mark.slow
@pytest.mark.parametrize("limited", [False, True], ids=["free", "limited"])
@pytest.mark.parametrize("name", RIGS)
def test_a_documented_rig_moves_as_its_program_says(name, limited):
    rig, (top, offset) = RIGS[name], LIMITED[name]
    gains = replace(rig.gains, limit=(-top, 1.2 * top) if limited else None)
    e = replace(driven(rig, gains, rig.control_rate / 100, 0.05, 0.01), offset=offset)
    slow = simulate(e, 200)
    fast = simulate_records([e], substeps=10)[0][:3, :200]
    for expected, got in zip(slow, fast, strict=True):
        assert expected.size == 200
        assert np.sqrt(np.mean((got - expected) ** 2)) < 1e-6 * np.sqrt(np.mean(expected**2))
    own = fast[1] - np.resize(e.waveform("current"), 200)
    on_limit = np.isclose(own, -top, atol=1e-12) | np.isclose(own, 1.2 * top, atol=1e-12)
    assert on_limit.sum() > 3 if limited else not on_limit.any()


@pytest.mark.slow
@pytest.mark.parametrize("name", RIGS)
def test_small_motion_is_that_of_the_linear_loop(name):
    e = driven(RIGS[name], RIGS[name].gains, RIGS[name].control_rate / 100, 1e-6, 1e-6)
    e = replace(e, excitations=(*e.excitations, Excitation("sphs", "reference", e.fundamental, (4, 8, 12), 1e-8)))
    a, b, c = closed_loop(e)
    force = replace(e, excitations=e.excitations[:1])
    x, moved = np.zeros(len(a)), np.empty(200)
    for t, f in enumerate(np.resize(e.waveform("force"), 200)):
        moved[t] = (c @ x)[0]
        x = a @ x + b[:, 0] * f
    np.testing.assert_allclose(simulate_records([force], substeps=10)[0][0], moved, atol=1e-5 * abs(moved).max())
    lasting = int(np.ceil(np.log(1e-5) / np.log(abs(closed_loop_poles(e)).max()) / 100))
    lines = np.sort(np.concatenate([x.lines for x in e.excitations]))
    found = simulate_statistics([replace(e, transient_periods=lasting)], substeps=10).statistics.mean[0]
    expected = expected_statistics(e, lines).mean
    assert (abs(found - expected)[:2].max(axis=1) < 1e-4 * abs(expected[:2]).max(axis=1)).all()


@pytest.mark.slow
def test_two_axes_with_controllers_of_their_own():
    x = StateFeedback(9600.0, 6.5, 0.2, 2e4, 1e-4, limit=(-0.42, 0.42))
    y = Pid(9000.0, 2e4, 6.0, 1e-4, "measurement", 1e-3, limit=(-0.2, 0.2))
    e = oblique(COUPLED, 3.0, gains=(x, y))
    e = without_noise(e)
    assert abs(closed_loop_poles(e)).max() < 1
    slow, fast = simulate(e, 200), axes_of(simulate_records([e])[0])[:3, :, :200]
    own = abs(fast[1] - e.waveform("current")[:, :200])
    assert (np.isclose(own, [[0.42], [0.2]], atol=1e-12).sum(axis=1) > 2).all()
    for expected, got in zip(slow, fast, strict=True):
        assert expected.shape[1] == 200
        assert (np.std(got - expected, axis=1) < 1e-6 * np.std(expected, axis=1)).all()


_CASCADE = {"form": "cascade", "outer": {"kp": 1.0}, "inner": {"kp": 1.0}, "resistance": 1.0}
TABLES = {
    "misspelt": (
        {"form": "pdi", "kp": 1.0},
        "form = 'pdi'; use one of pid, state_feedback, cascade, filtered_pid, transfer_function",
    ),
    "unknown key": ({"form": "pid", "kp": 1.0, "ti": 0.1}, "unknown key 'ti'"),
    "missing": ({"form": "state_feedback", "velocity": 1.0}, "displacement missing"),
    "no number": ({"form": "pid", "kp": "1"}, "kp = '1' is not a finite number"),
    "negative time": ({"form": "pid", "kp": 1.0, "td": -1e-3}, "td = -0.001 s must be at least 0"),
    "derivative": ({"form": "pid", "kp": 1.0, "derivative_on": "output"}, "use one of error, measurement"),
    "limit": ({"form": "pid", "kp": 1.0, "limit": [1, 0]}, "two increasing numbers"),
    "limit in all": ({"form": "pid", "kp": 1.0, "limit": [0, 3]}, "count from the operating point"),
    "anti-windup": ({"form": "pid", "kp": 1.0, "anti_windup": "clamping"}, "use one of tracking, none"),
    "no table": (_CASCADE | {"outer": 3}, "outer = 3 must be a table"),
    "inner": (
        {"form": "cascade", "outer": {"kp": 1.0}, "inner": {"kp": 1.0, "kd": 1}, "resistance": 1.0},
        "inner: unk",
    ),
    "resistance": (
        {"form": "cascade", "outer": {"kp": 1.0}, "inner": {"kp": 1.0}, "resistance": 0},
        "must be positive",
    ),
    "outer limit": (_CASCADE | {"outer": {"kp": 1.0, "limit": [-1, 1]}}, "give the limit"),
    "current": ({"numerator": [1.0], "denominator": [1.0], "current": [1.0, 2.0]}, "current has a higher power"),
    "cut": ({"numerator": [1.0], "denominator": [1.0, 0.5], "anti_windup": [1.0, 2.0]}, "anti_windup has a higher"),
}


@pytest.mark.parametrize("name", TABLES)
def test_a_wrong_table_is_refused_in_words(name):
    table, words = TABLES[name]
    with pytest.raises(ValueError, match="controller") as error:
        controllers_from_table(table, "controller")
    assert words in str(error.value)


@pytest.mark.parametrize("name", CONTROLLERS)
def test_a_controller_is_written_as_it_is_read(name):
    own = CONTROLLERS[name]
    written = tomllib.loads(f"controller = {toml_value(as_table(own))}")
    assert controllers_from_table(written["controller"], "controller") == own
    pair = tomllib.loads(f"controller = {toml_value(as_table((own, own)))}")
    assert controllers_from_table(pair["controller"], "controller") == (own, own)


def test_gains_are_replaced_where_the_form_has_them():
    assert with_gains(PID, kp=1.0) == replace(PID, kp=1.0)
    with pytest.raises(ValueError, match='of the form "cascade", which has no such gain'):
        with_gains(CASCADE, kp=1.0)


def test_a_current_that_is_the_command_cannot_be_fed_back():
    rig = replace(RIGS["ball under a cascade"], amplifier_time_constant=0.0)
    with pytest.raises(ValueError, match="reads the coil's current"):
        Experiment(rig, rig.gains, ())
    with pytest.raises(ValueError, match="both axes PID gains"):
        simulate_records([oblique(COUPLED, gains=(Gains(8000.0, 2000.0, 5.2), PID))])


@pytest.mark.slow
def test_margins_of_a_simulated_experiment_are_those_at_the_reading():
    rig = with_defaults(RIGS["ball under state feedback"])
    e = protocol_experiment(rig)
    frequency = np.geomspace(1.0, 0.45 * rig.control_rate, 400)
    peak = abs(loop_response(e, frequency).sensitivity).max()
    assert evaluate([e]).margins["peak_sensitivity"][0] == pytest.approx(peak, rel=0.02)
