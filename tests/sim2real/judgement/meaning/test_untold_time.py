"""What a time between two readings that nobody states takes up is said with the effects that it may be."""

from types import SimpleNamespace

import numpy as np
import pytest

from sim2real.judgement.meaning.untold_time import Late, late_readings
from sim2real.recorded.channel_errors import ChannelError
from sim2real.recorded.nuisances import Nuisances
from sim2real.recorded.open_record import OpenRecord

STEP = 4e-3  # s, of a sample, and one standard deviation of the time
NAME = "time between current and displacement"


def problem(column, name=NAME):
    record = object.__new__(OpenRecord)
    errors = (ChannelError(name, "current", delay=STEP), ChannelError("scale of current", "current", scale=0.01))
    for key, value in (("errors", errors), ("windows", SimpleNamespace(sample_rate=1 / STEP))):
        object.__setattr__(record, key, value)
    return SimpleNamespace(parts=[SimpleNamespace(record=record)], nuisances=Nuisances((name,), column[None]))


def fit(p, data, jacobian=None):
    cleared = p.nuisances.without(data)
    covariance = lambda: np.eye(0 if jacobian is None else len(jacobian))  # noqa: E731
    return SimpleNamespace(residual=cleared, jacobian=jacobian, covariance=covariance)


@pytest.mark.parametrize(("late", "said"), [(0.5, True), (-0.5, True), (0.05, False), (0.0, False)])
def test_half_a_sample_is_said_and_noise_is_not(late, said):
    p = problem(np.full(400, 3.0 + 0j))
    rng = np.random.default_rng(3)
    noise = rng.standard_normal(400) + 1j * rng.standard_normal(400)
    found = late_readings(p, fit(p, late * 3.0 + noise))
    assert (found is not None) == said
    if found is not None:
        assert found.time == pytest.approx(late * STEP, abs=4 * found.se)
        assert found.effects == ({"sensor_lag"} if late > 0 else set())
        assert ("later" in found.in_words()) == (late > 0) and "delay_tolerance of the current" in found.in_words()


def test_what_a_fitted_parameter_may_make_is_not_clear():
    """A damping that the recordings hardly tell is late, too."""
    p = problem(np.full(400, 3.0 + 0j))
    data = np.full(400, 1.5 + 0j)
    assert late_readings(p, fit(p, data)) is not None
    alike = p.nuisances.without(np.full((1, 400), 0.6 + 0j))
    assert late_readings(p, fit(p, data, alike)) is None


def test_a_time_within_what_is_stated_is_not_said():
    p = problem(np.full(400, 3.0 + 0j), "delay of current")
    assert late_readings(p, fit(p, np.full(400, 1.5 + 0j))) is None


def test_a_time_is_asked_of_the_channel_that_is_recorded():
    assert "delay_tolerance of the voltage" in Late("current", 1e-3, 1e-5, 0.5, "voltage").in_words()
