"""A current between its readings, where nobody states how it lags behind the command."""

from dataclasses import replace

import numpy as np
import pytest

from estimation.actuator import actuator_estimate
from estimation.lines.periods import LineStatistics
from maglev_env.evaluation.known_chain import between_both, coil_current, flowing, rotor_motion, unknown_between
from maglev_env.rig.rig_file import load_rig

RATE, MASS, GAIN, STIFFNESS, DAMPING = 10_000.0, 2.0, 100.0, -3e5, 20.0
RIG = replace(load_rig("hmb_free"), control_rate=RATE, amplifier_time_constant=0.0, tolerance={})


def test_a_lag_that_is_not_stated_is_not_known():
    assert unknown_between(RIG, RATE) == RATE and unknown_between(RIG, 1000.0) == RATE
    assert unknown_between(replace(RIG, tolerance={"amplifier_time_constant": 0.0}), RATE) is None
    assert unknown_between(replace(RIG, amplifier_time_constant=1e-4), RATE) is None
    assert unknown_between(None, RATE) is None


@pytest.mark.parametrize(("lag", "late"), [(0.0, True), (0.0, False), (1e-5, False), (1e-4, False), (1e-3, False)])
def test_every_lag_lies_within_the_interval_of_the_damping(lag, late):
    """The current behind a held command, sampled in time just before each step, or behind it; no noise.

    The force by a response in the continuous: hold, lag, mass.
    """
    f = np.arange(5.0, 1000.0, 5.0)
    w, x = 2 * np.pi * f, f / RATE
    flows = np.sinc(x) * np.exp(-1j * np.pi * x) / (1 + 1j * w * lag)
    z, kept = np.exp(2j * np.pi * x), np.exp(-1 / (RATE * lag)) if lag else 0.0
    read = (1 - kept) / (z - kept) * (z if late else 1)
    y = GAIN * flows / (STIFFNESS - MASS * w**2 + 1j * w * DAMPING)
    mean = np.stack([read, y])
    covariance = np.zeros((2, 2, f.size), complex)
    covariance[0, 0], covariance[1, 1] = (1e-4 * abs(read)) ** 2, (1e-4 * abs(y)) ** 2
    statistics = LineStatistics(f, np.arange(1, f.size + 1), ("current", "displacement"), mean, covariance, 10)
    middle, moved = (actuator_estimate(s, MASS) for s in between_both(statistics, RATE))
    found = middle.with_errors(
        moved.gain - middle.gain, moved.stiffness - middle.stiffness, moved.damping - middle.damping
    )
    assert abs(found.damping - DAMPING) < 2 * found.damping_se
    assert abs(found.gain - GAIN) < 2.5 * found.gain_se and abs(found.stiffness - STIFFNESS) < 2.5 * found.stiffness_se
    if lag == 0.0:
        assert abs(found.damping - DAMPING) > 2  # what the interval was blind to


def of_channels(f, **channels):
    """Line statistics of channels (n,) with a little noise."""
    mean = np.stack(list(channels.values()))
    covariance = np.zeros((len(mean), len(mean), f.size), complex)
    for i, values in enumerate(mean):
        covariance[i, i] = (1e-5 * np.abs(values).max()) ** 2
    return LineStatistics(f, np.arange(1, f.size + 1), tuple(channels), mean, covariance, 10)


def test_probe_and_amplifier_are_low_passes_of_their_time_constants():
    """A reading is put ahead of its probe, a command behind its amplifier: 45 degrees at the corner."""
    corner = 1 / (2 * np.pi * 2e-4)
    f = np.array([corner / 100, corner, 10 * corner])
    rig = replace(RIG, sensor_time_constant=2e-4, amplifier_time_constant=2e-4)
    one = np.ones(3, complex)
    ahead = rotor_motion(of_channels(f, displacement=one), rig).amplitude("displacement")
    behind = coil_current(of_channels(f, current=one), rig).amplitude("current")
    assert np.abs(ahead) == pytest.approx([1.0, np.sqrt(2), np.sqrt(101)], rel=1e-3)
    assert np.degrees(np.angle(ahead)) == pytest.approx([0.573, 45.0, 84.29], abs=0.01)
    assert behind * ahead == pytest.approx(one)


def test_what_flows_between_the_readings_is_a_held_command_behind_the_lag():
    """And where no lag is stated, half a period either way: a uniform distribution of its width."""
    f, lag = np.arange(20.0, 2000.0, 60.0), 1e-4
    w, x = 2 * np.pi * f, f / RATE
    z, kept = np.exp(1j * 2 * np.pi * x), np.exp(-1 / (RATE * lag))
    statistics = of_channels(f, current=(1 - kept) / (z - kept), command=np.ones(f.size, complex))
    found, moved, late = flowing(statistics, replace(RIG, amplifier_time_constant=lag), RATE)
    expected = np.sinc(x) * np.exp(-1j * np.pi * x) / (1 + 1j * w * lag)
    assert found.amplitude("current") == pytest.approx(expected, rel=1e-3)
    assert moved is not None and 0 < late < 0.01 / RATE
    apart = np.angle(moved.amplitude("current") / found.amplitude("current"))[0] / w[0]
    assert late == pytest.approx(abs(apart), rel=0.02)
    assert flowing(statistics, RIG, RATE)[2] == pytest.approx(np.sqrt(1 / 12) / RATE)
