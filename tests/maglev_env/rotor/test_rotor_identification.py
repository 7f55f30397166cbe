"""Identification of a turning rotor: at any top speed, in any company, and behind a slow force rejection."""

from dataclasses import fields, replace

import numpy as np
import pytest

from estimation.stability_margins import peak_sensitivity
from maglev_env.rig.goal import parse_goal
from maglev_env.rotor.evaluation import evaluate_rotors
from maglev_env.rotor.identification import Protocol, RotorIdentification, identify_runs
from maglev_env.rotor.lanes import Run
from maglev_env.rotor.large_signal import large_signal_quantities
from maglev_env.rotor.linear import sensitivity
from maglev_env.rotor.monitoring import monitor
from maglev_env.rotor.parts import Planes, Rejection
from maglev_env.rotor.rotor import Rotor, load_rotor
from maglev_env.rotor.run_up import RunUp, run_up

PUMP = load_rotor("pump")
UNEVEN = replace(PUMP, planes=Planes((-0.016, 0.034), (-0.03, 0.02)))


def linear_peaks(rotor: Rotor, found: RotorIdentification, rpm: float) -> list[float]:
    """Peak |S| of both controllers in the linear model, over the lines at which each was identified."""
    return [
        peak_sensitivity(f, sensitivity(rotor, f, rpm * np.pi / 30)[:, c, c])[0] for c, f in enumerate(found.frequency)
    ]


@pytest.mark.parametrize(("top", "near"), [(13_900.0, 13_500.0), (-9900.0, -9500.0), (400.0, 0.0)])
def test_a_rotor_is_identified_near_its_top_speed_where_its_unbalance_is_on_no_line(top, near):
    found = evaluate_rotors([PUMP], np.array([0.0, top]))
    assert found.id_speeds.tolist() == sorted({0.0, near}) and found.run_up.speed_rpm.tolist() == [0.0, top]
    for v, one in zip(found.id_speeds, found.identification, strict=True):
        assert one.peak_sensitivity[0] == pytest.approx(linear_peaks(PUMP, one, v), rel=0.03)
    assert found.score[0] > 0.97


def test_a_speed_whose_harmonics_fall_onto_lines_is_refused():
    with pytest.raises(ValueError, match=r"13900 rpm: harmonics .* a multiple of 500 rpm, e\.g\. 13500"):
        evaluate_rotors([PUMP], id_speeds=[0.0, 13_900.0])
    with pytest.raises(ValueError, match="multiple of 480 rpm"):
        identify_runs([Run(PUMP, 500.0)], Protocol(fundamental=4.0))


@pytest.mark.parametrize("rate", [2500.0, 4000.0, 16_384.0, 33_333.0])
def test_any_control_rate_has_periods_of_whole_samples_and_lines_within_it(rate):
    slow = replace(PUMP.axis, control_rate=rate)
    gains = {name: replace(g, kp=5000.0, td=max(g.td, 1 / rate)) for name, g in PUMP.gains.items()}
    rotor = replace(PUMP, axis=slow, gains=gains)
    found = evaluate_rotors([rotor], np.array([0.0, 9900.0]))
    assert 8900 < found.id_speeds[1] <= 9900 and found.feasible[0]
    for v, one in zip(found.id_speeds, found.identification, strict=True):
        assert one.peak_sensitivity[0] == pytest.approx(linear_peaks(rotor, one, v), rel=0.05)
        assert max(f.max() for f in one.frequency) == pytest.approx(min(2000.0, 0.4 * rate), rel=0.01)


def test_an_injection_is_that_of_each_rotors_own_planes():
    runs = [Run(rotor, v, 5) for rotor in (PUMP, UNEVEN) for v in (0.0, 10_000.0)]
    beside = identify_runs(runs)
    for some in (slice(0, 2), slice(2, 4)):
        alone = identify_runs(runs[some])
        for name in ("stiffness", "stiffness_se", "damping", "peak_sensitivity"):
            assert np.array_equal(getattr(beside, name)[some], getattr(alone, name))
        assert all(np.array_equal(a[some], b) for a, b in zip(beside.sensitivity, alone.sensitivity, strict=True))


def test_a_slow_force_rejection_is_waited_for():
    slow = replace(PUMP, rejection=Rejection(1.0))
    found = identify_runs([Run(slow, 10_000.0, 1)])
    assert found.peak_sensitivity[0] == pytest.approx(linear_peaks(slow, found, 10_000.0), rel=0.03)
    watched = monitor(slow, slow, 10_000.0, blocks=20, change=12)
    assert not watched.alarms.size and watched.tracked.stiffness[-1] == pytest.approx(watched.expected[0, 0], rel=0.005)


def test_how_long_one_rotor_is_waited_for_is_nothing_to_another():
    quick, slow = (replace(PUMP, rejection=Rejection(rate)) for rate in (20.0, 5.0))
    speeds = np.array([0.0, 10_000.0])
    beside = run_up([slow, quick, PUMP], speeds, 3)
    goal = parse_goal("impulse_displacement <= 1e-4 after 1e-4")
    struck = large_signal_quantities(goal, [slow, quick, PUMP], speeds, [(3,)] * 3, None)
    for i, rotor in enumerate((slow, quick, PUMP)):
        alone = run_up([rotor], speeds, 3)
        for f in fields(RunUp)[1:]:
            assert np.array_equal(getattr(beside, f.name)[i], getattr(alone, f.name)[0], equal_nan=True)
        (own,) = large_signal_quantities(goal, [rotor], speeds, [(3,)], None)
        assert all(np.array_equal(struck[i][name].values, own[name].values) for name in own)
