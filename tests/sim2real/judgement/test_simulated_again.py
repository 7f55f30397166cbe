"""A pair that was only simulated again pays for the freedom of its forms like one that was fitted."""

from types import SimpleNamespace

import numpy as np
import pytest

from sim2real.judgement import evidence as own
from sim2real.search.candidates import Attribution, Candidate
from sim2real.search.fitting import begin, iterate
from sim2real.search.hypotheses import Hypothesis

# What asks for recordings; nothing of it applies to a linear problem.
ASKED = ("motion_reached", "current_reached", "scatter_cost", "stiffness_cost", "meaningless_cost", "idle_cost")
FORMS = ("power", "unloading")
_DRAWN = np.random.default_rng(0).standard_normal((6, 300, 2)) @ (1, 1j)
ROWS = dict(zip(("strength", "width", "ripple", *FORMS, "change"), _DRAWN, strict=True))
ALONE = ("hysteresis",)


def predicted(point):
    """Linear in the sizes of effects, and in the logarithms of what forms them."""
    values = [(key, v) for effect in point.effects.values() for key, v in effect.items()]
    parts = (4.0 * np.log(v) * ROWS[key] if key in FORMS else 8.0 * v * ROWS[key] for key, v in values)
    return sum(parts, np.zeros(300, complex))


def simulate(points):
    return np.array([predicted(p) for p in points])


@pytest.fixture
def attribution():
    """Calibration, hysteresis of another form, which is the truth, and the same beside a gain, which is simulated."""
    truth = SimpleNamespace(effects={"hysteresis": {"strength": 0.1, "width": 0.2, "power": 1.6, "unloading": 1.3}})
    noise = np.random.default_rng(1).standard_normal((300, 2)) @ (1, 1j)
    problem = SimpleNamespace(
        data=predicted(truth) + noise,
        simulate=simulate,
        parts=[SimpleNamespace(record=SimpleNamespace(nominal=None))],
    )
    none, one, both = (
        Hypothesis(names, {}, shaped=ALONE if names else ()) for names in ((), ALONE, (*ALONE, "sensor_gain"))
    )
    start = np.zeros(one.size)
    start[: len(one.coordinates)] = [c.at({"strength": 0.1, "width": 0.2}[c.parameter]) for c in one.coordinates]
    fits = begin([none, one], [np.zeros(0), start], problem.data, simulate)
    iterate(fits, problem.data, simulate, 20)
    fits += begin([both], [np.insert(fits[1].u, len(one.coordinates), 0.0)], problem.data, simulate)
    return Attribution(np.inf, tuple(map(Candidate, fits)), 600.0, problem)


def test_what_a_pair_costs_does_not_depend_on_when_it_is_asked(attribution, monkeypatch):
    for name in ASKED:
        monkeypatch.setattr(own, name, lambda *_: 0.0)
    monkeypatch.setattr(own, "shows_limit", lambda *_: True)
    monkeypatch.setattr(own, "acts_on_one_line", lambda *_: False)
    single, pair = (c.fit for c in attribution.candidates[1:])
    assert pair.cost == pytest.approx(single.cost) and single.occam > 5 and pair.jacobian is None
    first, _, _ = own._costs(attribution, None)
    again, _, _ = own._costs(attribution, None)
    assert (first == again).all()
    # A gain of nothing saves nothing, and is a parameter more.
    assert first[2] == pytest.approx(first[1] + 2.0, abs=1.0)
