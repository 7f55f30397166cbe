"""A ridge at a tick of the controller keeps a delay from its place."""

from types import SimpleNamespace

import numpy as np
import pytest

from sim2real.search.across_ticks import across_ticks
from sim2real.search.fitting import begin, iterate
from sim2real.search.hypotheses import Hypothesis

RATE = 2e4
RIG = SimpleNamespace(record=SimpleNamespace(experiment=SimpleNamespace(rig=SimpleNamespace(control_rate=RATE))))


def problem(ticks):
    def simulate(points):
        own = np.array([p.effects["delay"]["time"] * RATE for p in points])
        return np.stack([20 * own, 60 * np.exp(-(((own - 2) / 0.05) ** 2))], axis=1) + 0j

    truth = SimpleNamespace(effects={"delay": {"time": ticks / RATE}})
    return SimpleNamespace(data=simulate([truth])[0], simulate=simulate, parts=[RIG])


@pytest.mark.parametrize(("ticks", "begun"), [(2.3, 1.7), (1.7, 2.3), (1.7, 1.6)])
def test_a_delay_is_found_on_either_side_of_a_tick(ticks, begun):
    p, h = problem(ticks), Hypothesis(("delay",), {})
    (fit,) = begin([h], [np.array([h.coordinates[0].at(begun / RATE)])], p.data, p.simulate)
    iterate([fit], p.data, p.simulate, 20)
    (found,) = across_ticks(p, [fit])
    assert found.hypothesis.point(found.u).effects["delay"]["time"] * RATE == pytest.approx(ticks, abs=0.02)


def test_other_effects_and_a_delay_within_half_a_tick_stay():
    p, h = problem(0.3), Hypothesis(("delay",), {})
    fits = begin([h], [np.array([h.coordinates[0].at(0.3 / RATE)])], p.data, p.simulate)
    lag = SimpleNamespace(hypothesis=Hypothesis(("amplifier_lag",), {}), cost=1.0)
    assert across_ticks(p, [*fits, lag]) == [*fits, lag]
