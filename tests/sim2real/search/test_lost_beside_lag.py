"""Lost commands beside a lag, on a problem in which both only turn the phase."""

from types import SimpleNamespace

import numpy as np
import pytest

from sim2real.search.fitting import begin, iterate
from sim2real.search.hypotheses import Hypothesis
from sim2real.search.lost_beside_lag import lost_beside_lag

FREQUENCY, NOISE, PERIOD, LATE = np.linspace(5.0, 300.0, 60), 1e-3, 1e-4, 5e-5
DELAY, LOST = Hypothesis(("delay",), {}), Hypothesis(("dropped_samples",), {})


def simulate(points):
    """A command that is repeated with a probability p is late by p / (1 - p) control periods on average."""
    found = []
    for p in points:
        lost = p.effects.get("dropped_samples", {}).get("probability", 0.0)
        late = p.effects.get("delay", {}).get("time", 0.0) + PERIOD * lost / (1 - lost)
        found.append(np.exp(-2j * np.pi * FREQUENCY * late) / NOISE)
    return np.array(found)


@pytest.fixture
def alone():
    """Each of both, fitted to a delay."""
    data = np.exp(-2j * np.pi * FREQUENCY * LATE) / NOISE
    fits = begin([DELAY, LOST], [np.array([DELAY.coordinates[0].at(3e-5)]), np.array([1.0])], data, simulate)
    iterate(fits, data, simulate, 20)
    assert max(f.cost for f in fits) < 1.0
    return SimpleNamespace(data=data, simulate=simulate), fits


def test_both_are_fitted_where_either_does(alone):
    problem, fits = alone
    (both,) = lost_beside_lag(problem, fits, [])
    assert both.hypothesis.effects == ("dropped_samples", "delay") and both.cost < 1.0
    values = both.hypothesis.point(both.u).effects
    lost = values["dropped_samples"]["probability"]
    assert values["delay"]["time"] + PERIOD * lost / (1 - lost) == pytest.approx(LATE, rel=1e-3)
    assert lost_beside_lag(problem, fits, [both]) == []


def test_what_the_scatter_need_not_tell_is_not_asked(alone):
    """One that explains less, or is not among the effects."""
    problem, (late, lost) = alone
    assert lost_beside_lag(problem, [late], []) == []
    lost.cost += 1e3
    assert lost_beside_lag(problem, [late, lost], []) == []
