"""What single effects owe to pairs, on a problem with two minima."""

from itertools import product
from types import SimpleNamespace

import numpy as np
import pytest

from sim2real.search import pairs
from sim2real.search.fit import Fit
from sim2real.search.fitting import begin, iterate
from sim2real.search.hypotheses import Hypothesis
from sim2real.search.pairs import alone_again
from sim2real.search.screening import Start

_DRAWN = np.random.default_rng(6).standard_normal((2, 2, 40))
MASS, OTHER = _DRAWN[0] + 1j * _DRAWN[1]


def simulate(points):
    """A mass whose change in tenths acts by a curve that turns twice, and a gain that acts in proportion."""

    def predicted(point):
        mass, gain = (10.0 * point.effects.get(n, {}).get("change", 0.0) for n in ("mass", "sensor_gain"))
        return (mass**3 - 3 * mass) * MASS + gain * OTHER

    return np.array([predicted(p) for p in points], complex)


@pytest.mark.parametrize("beside", [0.0, 2.0])
def test_an_effect_is_fitted_alone_from_where_it_stands_in_the_best_pair(beside):
    data = 18.0 * MASS + beside * OTHER  # of a change of 3 tenths
    problem = SimpleNamespace(data=data, simulate=simulate)
    single, pair = Hypothesis(("mass",), {}), Hypothesis(("mass", "sensor_gain"), {})
    stuck, both = begin([single, pair], [np.array([-1.0]), np.array([2.8, beside])], data, simulate)
    iterate([stuck], data, simulate, 20)
    iterate([both], data, simulate, 20)
    assert stuck.cost > 1e4 and both.cost < 1e-3
    found = {f.hypothesis.effects: f for f in alone_again(problem, [stuck], [both])}
    assert found["mass",].u[0] == pytest.approx(3.0, abs=0.1)
    assert (found["mass",].cost < 1.0) == (beside == 0.0)  # what the other effect explains is not its own


def test_a_pair_that_saves_nothing_starts_no_other_fit():
    data = 2.0 * OTHER
    single, pair = Hypothesis(("sensor_gain",), {}), Hypothesis(("mass", "sensor_gain"), {})
    one, both = begin([single, pair], [np.array([2.0]), np.array([0.0, 2.0])], data, simulate)
    assert alone_again(SimpleNamespace(data=data, simulate=simulate), [one], [both]) == []


OTHERS = ("damping", "friction", "cubic_spring", "soft_stop", "eccentricity", "deadband", "eddy_current", "sensor_lag")


def test_pairs_of_one_seed_do_not_take_all_places_of_a_round(monkeypatch):
    """On the one recording that ranks them, all of the first seed come before those of the second."""

    def alone(name):
        h = Hypothesis((name,), {})
        return Fit(h, np.zeros(h.size), np.zeros(1, complex), 1e3)

    ranked = [
        Start(Hypothesis((seed, other), {}), np.zeros(1), float(cost))
        for cost, (seed, other) in enumerate(product(("delay", "amplifier_lag"), OTHERS))
    ]
    monkeypatch.setattr(pairs, "differentiate", lambda *rest: None)
    monkeypatch.setattr(pairs, "current_reached", lambda problem: 1.0)
    monkeypatch.setattr(pairs, "screened", lambda problem, jobs, apart: ranked)
    begun = []
    monkeypatch.setattr(pairs, "begin_at", lambda problem, chosen, ranked: begun.extend(chosen) or [])
    monkeypatch.setattr(pairs, "saved_by_second", lambda *rest: 16.0)
    monkeypatch.setattr(pairs, "iterate", lambda *rest: None)
    problem = SimpleNamespace(data=None, simulate=None)
    pairs._round(problem, [alone(name) for name in OTHERS], [alone("delay"), alone("amplifier_lag")], ())
    of = [start.hypothesis.effects for start in begun]
    assert [seed for seed, _ in of[: pairs.PAIRS]] == ["delay"] * pairs.PER_SEED + ["amplifier_lag"] * 3
    begun.clear()
    pairs._round(problem, [alone(name) for name in OTHERS], [alone("delay")], ())  # none else is to be left a place
    assert [start.hypothesis.effects[0] for start in begun[: pairs.PAIRS]] == ["delay"] * pairs.PAIRS
