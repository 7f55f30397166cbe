"""Which recording is proposed for which question, on linear problems."""

from types import SimpleNamespace

import numpy as np
import pytest

from sim2real.advice import next_experiment as own
from sim2real.advice.recording_menu import Item
from sim2real.judgement.judge import Entry
from sim2real.search.candidates import Attribution, Candidate
from sim2real.search.fitting import begin, differentiate
from sim2real.search.hypotheses import Hypothesis

NAMES = ("mass", "actuator_gain", "sensor_gain")
NEVER = SimpleNamespace(candidates=())  # asked for no fit


def of(names, probability, candidate=None):
    return Entry(tuple(names.split("+")), probability, 0.0, candidate, None)


def simulator(rows):
    def simulate(points):
        sizes = ([10.0 * p.effects.get(name, {}).get("change", 0.0) for name in NAMES] for p in points)
        return np.array([np.array(own) @ rows for own in sizes], complex)

    return simulate


@pytest.fixture
def asked(monkeypatch):
    """Asks for a recording between the three effects, of which the second and the third are least unlike in it."""
    drawn = np.random.default_rng(4).standard_normal((4, 40, 2)) @ (1, 1j)
    simulate = simulator(np.array([drawn[0], drawn[1], drawn[1] + 0.2 * drawn[2]]))
    problem = SimpleNamespace(parts=(), data=drawn[3], simulate=simulate, loudest=SimpleNamespace(record=None))
    fits = begin([Hypothesis((n,), {}) for n in NAMES], [np.full(1, 5.0)] * 3, problem.data, simulate)
    differentiate(fits[:2], problem.data, simulate, True)
    calibration = begin([Hypothesis((), {})], [np.zeros(0)], problem.data, simulate)
    attribution = Attribution(0.0, tuple(map(Candidate, [*calibration, *fits])), 80.0, problem)
    monkeypatch.setattr(own, "menu", lambda _: [Item("another", 1.0, None, ("plant",), {"amplitude": 2.0})])
    monkeypatch.setattr(own, "_look", lambda *_: (SimpleNamespace(smoothed=simulate), np.ones(40)))
    return lambda *found: own.propose(attribution, found)


def test_another_speed_is_for_what_differs_in_nothing_but_what_turns():
    found = [of("delay+unbalance", 0.5, 1), of("delay+runout", 0.4, 1), of("sensor_lag+unbalance", 0.01, 2)]
    proposed = own.propose(NEVER, found)
    assert proposed.change == {"speed": True}
    assert proposed.to_json()["expected_separation"] is None  # nothing was simulated


def test_what_turns_is_no_question_where_the_class_agrees_about_it(asked):
    """The others are less probable by far."""
    found = [of("mass+unbalance", 0.52, 1), of("actuator_gain+unbalance", 0.46, 2), of("mass+runout", 0.011, 1)]
    proposed = asked(*found)
    assert proposed.what == "another" and proposed.why.endswith("tells mass from actuator_gain")


def test_another_speed_is_proposed_where_no_fits_differ():
    """What turns beside calibration alone has no fit of its own."""
    found = [of("unbalance", 0.5, 0), of("runout+pickup", 0.5, 0)]
    assert own.propose(NEVER, found).change == {"speed": True}


def test_candidates_that_were_only_simulated_are_told_apart_too_and_the_nearest_are_named(asked):
    proposed = asked(*(of(name, 0.33, i) for i, name in enumerate(NAMES, 1)))
    assert proposed.why.endswith("actuator_gain from sensor_gain")
    others = [asked(of("mass", 0.5, 1), of(name, 0.5, i)) for i, name in enumerate(NAMES[1:], 2)]
    assert 0 < proposed.expected_separation < min(p.expected_separation for p in others)


def test_what_is_refuted_is_no_rival(asked):
    assert asked(of("unknown", 0.6), of("mass", 0.4, 1), of("actuator_gain", 0.0, 2)) is None
