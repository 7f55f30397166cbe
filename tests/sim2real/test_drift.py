"""A gain that drifts over a recording: its rate is found, in noise there is none, and other trends are not named."""

from dataclasses import replace

import numpy as np
import pytest
from campaigns import planned, repeated

from maglev_env.loop.effect import effect
from maglev_env.rig.rig import load_rig
from sim2real.drift import _slope, drift_of
from sim2real.problem import assemble
from sim2real.recorded.opened import straightened
from sim2real.simulated import Point

NOMINAL, SEEDS = Point({}, {}), range(12)


def problem(folder, effects=None, seeds=SEEDS):
    (plan,) = planned(load_rig("hmb_free"), names=("base",))
    e = replace(plan.experiment, effects=effects or {})
    return assemble(repeated(folder, [replace(e, seed=seed) for seed in seeds]))


def test_a_straight_line_is_taken_off():
    at, rng = np.arange(6.0), np.random.default_rng(1)
    noise = rng.standard_normal((6, 3)) + 1j * rng.standard_normal((6, 3))
    slope, rest = straightened(noise + np.multiply.outer(at, [1.0, 2j, -3.0]))
    own, alone = straightened(noise)
    np.testing.assert_allclose(slope - own, [1.0, 2j, -3.0], rtol=1e-12)
    np.testing.assert_allclose(rest, alone, atol=1e-12)
    expected = np.polyfit(at, noise[:, 0].real, 1)
    assert own[0].real == pytest.approx(expected[0])


@pytest.mark.slow
def test_in_noise_there_is_no_drift_and_its_error_is_as_stated(tmp_path):
    found = problem(tmp_path)
    assert drift_of(found, NOMINAL) is None
    z = np.array([rate / sd for rate, sd, *_ in (_slope(part, NOMINAL) for part in found.parts)])
    assert 0.5 < np.std(z) < 1.6 and abs(z.mean()) < 3 / np.sqrt(len(z))


@pytest.mark.slow
def test_the_rate_of_a_drift_is_found(tmp_path):
    """Of a gain that the kernel multiplies by 1 + rate t."""
    drift = drift_of(problem(tmp_path, effect("gain_drift", 0.1), range(3)), NOMINAL)
    assert abs(drift.rate - 0.1) < 0.02 + 3 * drift.se and drift.left < 0.1 * drift.chi2
