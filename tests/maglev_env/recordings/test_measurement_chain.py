"""What lies between a quantity and its channel is undone: against signals known in closed form."""

import numpy as np
import pytest
from scipy import signal

from maglev_env.recordings.measurement_chain import corrected

RATE = 1000.0


def true(at):
    return 0.3 * at + np.sin(2 * np.pi * 7 * at) + 0.2 * np.cos(2 * np.pi * 31 * at)


def test_a_low_pass_and_a_delay_are_undone():
    t = np.arange(4000) / RATE
    corner, delay = 80.0, 2.5e-3
    fine = np.arange(-0.5, 4.0, 1e-5)  # a first-order low-pass in continuous time, begun well before the record
    system = signal.lti([1.0], [1 / (2 * np.pi * corner), 1.0])
    _, filtered, _ = signal.lsim(system, true(fine - delay), fine - fine[0], X0=None)
    logged = np.interp(t, fine, filtered)
    found = corrected(logged, RATE, (corner,), delay)
    inside = slice(200, -200)  # the ends are continued by a guess
    assert abs(found - true(t))[inside].max() < 1e-3
    assert abs(logged - true(t))[inside].max() > 0.3


def test_a_straight_line_comes_back_exactly():
    t = np.arange(500) / RATE
    assert corrected(2.0 * (t - 0.004), RATE, (), 0.004) == pytest.approx(2.0 * t, abs=1e-12)


@pytest.mark.parametrize("corners", [(80.0,), (160.0, 300.0)])
def test_the_low_pass_of_a_current_behind_a_held_command_is_undone_above_half_the_rate_too(corners):
    held, fine, n = 1.3e-3, 200, 300
    command = np.repeat(np.random.default_rng(2).normal(size=n), fine)
    current, metered = 0.0, np.zeros(len(corners))
    true_samples, logged = np.empty(n), np.empty(n)
    step = 1 / (RATE * fine)
    for k, u in enumerate(command):  # Euler steps of 5 us; a sample is read before its command acts
        if k % fine == 0:
            true_samples[k // fine], logged[k // fine] = current, metered[-1]
        change = np.diff([current, *metered], prepend=u)
        current -= step / held * change[0]
        metered -= step * 2 * np.pi * np.array(corners) * change[1:]
    inside = slice(60, -60)
    found = corrected(logged, RATE, corners, 0.0, held)
    assert np.std((found - true_samples)[inside]) < 1e-2 * np.std(true_samples)
    assert np.std((corrected(logged, RATE, corners, 0.0) - true_samples)[inside]) > 0.1 * np.std(true_samples)


def test_a_straight_line_comes_as_late_as_low_pass_and_delay_make_it():
    """A ramp behind a low-pass of corner f and a delay d lies 1 / (2 pi f) + d behind itself."""
    rate, corner, delay = 1000.0, 20.0, 3e-3
    t = np.arange(400) / rate
    behind = 5.0 * (t - 1 / (2 * np.pi * corner) - delay)
    np.testing.assert_allclose(corrected(behind, rate, (corner,), delay), 5.0 * t, atol=1e-6)
