"""A current between its readings, where nobody states how it lags behind the command."""

from dataclasses import replace

import numpy as np
import pytest

from estimation.actuator import actuator_estimate
from estimation.lines.periods import LineStatistics
from maglev_env.evaluation.known_chain import between_both, unknown_between
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
