"""The lowest stable sampling rate against the simulation, from small errors and from a start at a wrong gap."""

from dataclasses import replace

import numpy as np
import pytest

from selfsense.coil import Coil
from selfsense.design import assess, design_pi, with_gains
from selfsense.forward_path import AnalogPath
from selfsense.linear import stable
from selfsense.rate_limit import gains_with_limit, lowest_stable_rate, sampling_rates
from selfsense.sensor import Estimator, SelfSensor
from selfsense.simulate import simulate
from selfsense.supply import Acquisition, Supply

PULL = 600.0  # A/m: amplitude by gap of the coil at half duty
COIL = Coil(turns=90, pole_area=39.27e-6, resistance=2.0)
SENSOR = SelfSensor(COIL, Supply(), Acquisition(), Estimator(COIL, 24.0, 0.0, 0.0, (0.02e-3, 0.7e-3)), 0.35e-3)
ANALOG = replace(SENSOR, estimator=replace(SENSOR.estimator, path=AnalogPath()))
STARTS = (0.03e-3, 0.1e-3, 0.35e-3, 0.65e-3)


def sampled(sensor, rate, kp, ki):
    return with_gains(replace(sensor, acquisition=replace(sensor.acquisition, rate=rate)), kp, ki)


def late(sensor, seconds=0.05):
    """The end of estimates (m) that start at four gaps and are then at 0.35 mm, (4, samples)."""
    gap = np.full(round(seconds * sensor.acquisition.rate), 0.35e-3)
    gap[:3] += 1e-8
    return simulate([replace(sensor, gap=start) for start in STARTS], gap).estimate[:, -len(gap) // 10 :]


@pytest.mark.parametrize(
    ("kp", "corner", "lowest"), [(3.69, 1000.0, 165e3), (2.3, 300.0, 70e3), (1.5, 3000.0, 55e3), (0.5, 12000.0, 105e3)]
)
def test_from_any_start_it_ends_on_one_orbit_at_the_lowest_rate_and_on_none_below_it(kp, corner, lowest):
    """The first of them is stable at 165 kHz and not at 160, as D reports."""
    gains = kp / PULL, kp / PULL * 2 * np.pi * corner
    assert lowest_stable_rate(SENSOR, [gains[0]], [gains[1]]) == lowest
    assert np.ptp(late(sampled(SENSOR, lowest, *gains)), axis=0).max() < 3e-6
    assert np.ptp(late(sampled(SENSOR, lowest - 5e3, *gains)), axis=1).min() > 400e-6


@pytest.mark.parametrize(("rate", "corner"), [(250e3, 300.0), (100e3, 3000.0), (50e3, 1000.0)])
def test_a_large_start_error_settles_wherever_a_small_one_does(rate, corner):
    kp, ki = (a[0] for a in gains_with_limit(SENSOR, rate, [corner]))
    assert np.ptp(late(sampled(SENSOR, rate, 0.95 * kp, 0.95 * ki)), axis=1).max() < 0.1e-6
    assert np.ptp(late(sampled(SENSOR, rate, 1.05 * kp, 1.05 * ki)), axis=1).min() > 400e-6


def test_the_map_holds_every_rate_from_the_lowest_on():
    kp, ki = np.array([2.0, 4.2]) / PULL, np.array([1e3, 4e4]) / PULL
    lowest, rates = lowest_stable_rate(SENSOR, kp, ki), sampling_rates(SENSOR.supply, 250e3)
    for i, j in np.ndindex(lowest.shape):
        holds = np.array([stable(sampled(SENSOR, rate, kp[i], ki[j])) for rate in rates])
        below = rates[~holds].max(initial=0.0)
        expected = rates[rates > below].min() if below < rates[-1] else np.nan
        np.testing.assert_equal(lowest[i, j], expected)
    assert np.isnan(lowest).any() and (lowest > 50e3).any()


def test_rates_are_fifths_of_the_pwm_frequency():
    np.testing.assert_allclose(sampling_rates(Supply(frequency=20e3), 62e3), [40e3, 44e3, 48e3, 52e3, 56e3, 60e3])


def test_a_rate_that_the_path_does_not_exist_at_ends_the_search():
    """A band-pass at 25 kHz needs more than 50 kHz."""
    gains = [0.1 / PULL], [1e2 / PULL]
    assert lowest_stable_rate(SENSOR, *gains) == 50e3
    assert lowest_stable_rate(ANALOG, *gains) == 55e3
    with pytest.raises(ValueError, match="not below half of the 50000 Hz"):
        lowest_stable_rate(ANALOG, *gains, rates=[50e3])


@pytest.mark.parametrize("sensor", [SENSOR, ANALOG], ids=["digital", "analog"])
def test_limits_divide_the_plane_of_gains(sensor):
    for kp, ki in zip(*gains_with_limit(sensor, 165e3, [100.0, 1000.0, 5000.0]), strict=True):
        assert stable(sampled(sensor, 165e3, 0.995 * kp, 0.995 * ki))
        assert not stable(sampled(sensor, 165e3, 1.005 * kp, 1.005 * ki))


def test_a_limit_at_165_kHz_and_a_wide_margin_are_two_designs():
    """Gains at which D's limit lies leave under 10 degrees at 250 kHz; 83 degrees hold down to 55 kHz."""
    for kp, ki in zip(*gains_with_limit(SENSOR, 165e3), strict=True):
        assert assess(with_gains(SENSOR, kp, ki)).phase_margin < 10
    wide = design_pi(SENSOR, 55.0, droop=2.9)
    assert wide.phase_margin > 80
    assert lowest_stable_rate(SENSOR, [wide.kp], [wide.ki]) == 55e3
