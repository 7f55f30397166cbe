"""A resonance that falls between the lines of an experiment, against a dense grid and the border of stability."""

from dataclasses import replace

import numpy as np
import pytest

from estimation.stability_margins import margin_arrays
from maglev_env.experiment import axis_experiment, protocol_experiment
from maglev_env.linear.between_lines import _joined, _Loops, between_lines
from maglev_env.linear.loop import loop_response
from maglev_env.linear.poles import all_poles, pole_radii
from maglev_env.loop.gains import Gains, with_gains
from maglev_env.rig.excitation import lines_at
from maglev_env.rig.rig_file import load_rig
from maglev_env.task.protocol import env_protocol

FREE = load_rig("hmb_free")
# The second body of docs/controllers.md: a mode at 657 Hz between the lines at 637 and 671 Hz.
RESONANT = {
    "delay": {"time": 150e-6},
    "support_resonance": {"frequency": 600.0, "damping_ratio": 0.005, "mass_ratio": 0.2},
}
SHARP, ZONE_C = Gains(6500.0, 160.0, 8.7, 156e-6), Gains(4846.0, 106.4, 8.218, 803e-6)


def found(experiments, axis=0):
    first = axis_experiment(experiments[0], axis)
    lines = lines_at(first.excitations, "current") * first.fundamental
    return between_lines(experiments, all_poles(experiments), lines, axis)


def test_a_peak_between_lines_is_that_of_a_dense_grid():
    experiments = [protocol_experiment(FREE, g, RESONANT) for g in (SHARP, ZONE_C)]
    f = np.linspace(600, 720, 200_001)
    hidden = found(experiments)
    for i, (e, expected) in enumerate(zip(experiments, (86, 4.45), strict=True)):
        dense = np.abs(loop_response(e, f).sensitivity)
        assert hidden["peak_sensitivity"][i] == pytest.approx(dense.max(), rel=0.01)
        assert hidden["peak_sensitivity"][i] == pytest.approx(expected, rel=0.03)
        assert hidden["peak_frequency"][i] == pytest.approx(f[dense.argmax()], abs=0.1)


def test_the_gain_margin_between_lines_is_where_the_loop_becomes_unstable():
    hidden = found([protocol_experiment(FREE, SHARP, RESONANT)])
    factor = hidden["gain_margin"][0]
    assert 1.0 < factor < 1.1

    def radius(by):
        gains = replace(SHARP, kp=SHARP.kp * by, ki=SHARP.ki * by, kd=SHARP.kd * by)
        return pole_radii([protocol_experiment(FREE, gains, RESONANT)])[0]

    beyond, within = 1 + 1.05 * (factor - 1), 1 + 0.95 * (factor - 1)
    assert radius(within) < 1 < radius(beyond) or radius(1 / within) < 1 < radius(1 / beyond)
    assert hidden["phase_margin"][0] == pytest.approx(0.75, abs=0.1)
    assert hidden["disk_margin"][0] == pytest.approx(1 / 86, rel=0.05)


def test_a_phase_margin_may_be_hidden_where_the_peak_is_not():
    """Seen: 30 degrees for 21, while the peak of 3.2 stood 3 % above that of a curve through the lines."""
    e = protocol_experiment(FREE, Gains(6877.232, 221.152, 5.385055, 3.940758e-5), RESONANT)
    f = np.union1d(np.geomspace(1, 4900, 6000), np.linspace(640, 700, 6000))
    dense = margin_arrays(f, loop_response(e, f).sensitivity)["phase_margin"]
    assert dense == pytest.approx(21.0, abs=0.1)
    assert found([e])["phase_margin"][0] == pytest.approx(dense, abs=0.1)


def test_what_is_hidden_is_the_loops_own_and_not_a_curves():
    """A spline through points beside a pole had made peaks of 46 for 6.7, and gain margins of 1.04 for 70."""
    rig, rng = load_rig("hmb_radial"), np.random.default_rng(2)
    rig = replace(rig, protocol=env_protocol(rig, "quick"))
    drawn = [{n: float(rng.uniform(*rig.bounds[n])) for n in ("kp", "ki", "kd")} for _ in range(48)]
    experiments = [protocol_experiment(rig, with_gains(rig.gains, **own)) for own in drawn]
    hidden = found(experiments, 1)
    assert np.isfinite(hidden["peak_sensitivity"]).sum() > 20
    for e, poles, peak, at in zip(
        experiments, all_poles(experiments), hidden["peak_sensitivity"], hidden["peak_frequency"], strict=True
    ):
        resonances = np.angle(poles[poles.imag > 0]) * rig.control_rate / (2 * np.pi)
        beside = (resonances[:, None] * (1 + np.linspace(-0.02, 0.02, 801))).ravel()
        f = np.union1d(np.geomspace(15, 0.49 * rig.control_rate, 4000), beside[(beside > 15) & (beside < 9800)])
        s = np.abs(loop_response(e, f).sensitivity[:, 1, 1])
        assert np.isnan(peak) or (peak, at) == (
            pytest.approx(s.max(), rel=5e-4), pytest.approx(f[s.argmax()], rel=2e-3)
        )  # fmt: skip


@pytest.mark.parametrize("effects", [{}, RESONANT, {"dropped_samples": {"probability": 0.05}}])
@pytest.mark.parametrize("name", ["hmb_free", "hmb_radial"])
def test_poles_give_the_sensitivity_of_the_loops_response(name, effects):
    e = protocol_experiment(load_rig(name), effects=effects)
    f, rate = np.geomspace(1, 9000, 200), e.rig.control_rate
    expected = loop_response(e, f).sensitivity.reshape(200, e.rig.axes, e.rig.axes)
    for axis in range(e.rig.axes):
        broken, closed = all_poles([e], without=axis)[0], all_poles([e])[0]
        s = _Loops(broken[None], closed[None], rate).sensitivity(f)[0]
        assert np.abs(s / expected[:, axis, axis] - 1).max() < 1e-8


def test_loops_with_a_narrow_pole_are_looked_at_together(monkeypatch):
    """One by one they took three quarters of a sweep's time: every third has such a pole."""
    gains = [Gains(kp, 2000.0, kd) for kp in np.geomspace(3000, 24000, 6) for kd in np.geomspace(1, 4, 6)]
    experiments = [protocol_experiment(FREE, g) for g in gains]
    calls = []
    monkeypatch.setattr(
        "maglev_env.linear.between_lines.margin_arrays", lambda *a: calls.append(a) or margin_arrays(*a)
    )
    alone = [found([e])["peak_sensitivity"][0] for e in experiments]
    assert len(calls) > 5
    calls.clear()
    assert np.array_equal(found(experiments)["peak_sensitivity"], alone, equal_nan=True)
    assert len(calls) == 1


@pytest.mark.parametrize("name", ["hmb_free", "hmb_radial", "eframe"])
def test_lines_that_show_the_loop_hide_nothing(name):
    rig = load_rig(name)
    for axis in range(rig.axes):
        assert all(np.isnan(values).all() for values in found([protocol_experiment(rig)], axis).values())


def test_an_unstable_loop_has_no_margins_to_hide():
    e = protocol_experiment(FREE, Gains(8000.0, 160.0, 14.0, 156e-6), RESONANT)
    assert pole_radii([e])[0] > 1
    assert np.isnan(found([e])["peak_sensitivity"]).all()


def test_frequencies_that_all_but_coincide_are_one():
    """A pole between two lines may lie on a frequency of the even grid, up to rounding."""
    lines = np.array([10.0, 20.0, 30.0])
    between = np.array([15.0, np.nextafter(15.0, 16.0), np.nextafter(20.0, 21.0), 25.0])
    assert _joined(lines, between).tolist() == [10.0, 15.0, 20.0, 25.0, 30.0]
