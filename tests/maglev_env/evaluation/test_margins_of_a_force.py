"""Margins that a measured force and the nominal controller tell, for any reading of the force and any stated rig."""

from dataclasses import replace

import numpy as np
import pytest

from estimation.stability_margins import margins
from maglev_env.evaluation.bands import nominal_response
from maglev_env.evaluation.stability import _feedback, _within_tolerance
from maglev_env.evaluation.worst import worst_of
from maglev_env.rig.goal import parse_goal
from maglev_env.rig.rig_file import load_rig

FREQUENCY = np.arange(5.0, 4000.0, 5.0)
BALL = """schema = "maglev-rig/1"
name = "ball"
magnet = "electromagnet"
[parameters]
mass = 0.05
gap = 8e-3
clearance = 6e-3
force_constant = 4.9e-5
bias_current = 0.8
control_rate = 2000.0
[gains]
kp = 300.0
ki = 500.0
kd = 6.0
td = 1e-3
ti = 0.5
[tolerance]
mass = 0.02
gap = 0.02
coil_inductance = 0.05
"""


@pytest.mark.parametrize("held", [True, False])
def test_a_continuous_force_pushes_for_half_a_step_less(held):
    """A converter holds its force for a step; the sensitivity of the loop is one, however the force was read."""
    rig = load_rig("hmb_free")
    rig = replace(rig, control_rate=8000.0)
    nominal = nominal_response(rig, rig.gains, FREQUENCY)
    late = np.array([np.mean(np.exp(-2j * np.pi * f * np.linspace(0, 1 / rig.control_rate, 4001))) for f in FREQUENCY])
    receptance = nominal.receptance if held else nominal.receptance / late
    found = 1 - _feedback(rig, rig.gains, FREQUENCY, held) * receptance
    assert found == pytest.approx(nominal.sensitivity, rel=1e-3)


def test_tolerances_of_a_rig_that_must_hang_widen_margins(tmp_path):
    """More mass than the stated bias carries, and a tolerance of an inductance that the rig does not state."""
    (tmp_path / "ball.toml").write_text(BALL)
    rig = load_rig(tmp_path / "ball.toml")
    frequency = np.arange(1.0, 400.0, 1.0)
    nominal = nominal_response(rig, rig.gains, frequency)
    found = margins(frequency, nominal.sensitivity, np.full(frequency.size, 1e-8), freedom=20)
    wider = _within_tolerance(found, frequency, nominal.receptance, rig, rig.gains, True)
    (low, high), (least, most) = found.intervals["peak_sensitivity"], wider.intervals["peak_sensitivity"]
    assert least < low and most > high


def test_the_worst_of_many_rigs_is_found():
    goal = parse_goal("phase_margin >= 30")
    each = [{"phase_margin": np.array([40.0 + (i - 50) ** 2, 90.0 - 0.8 * i])} for i in range(101)]
    (worst,) = worst_of(goal, each)
    assert worst["phase_margin"].tolist() == [40.0, 10.0]
