"""Pairs of effects that do much together and little alone, on responses that are written down."""

from types import SimpleNamespace

import numpy as np
import pytest

from maglev_env.rig.rig_file import load_rig
from sim2real.search.fitting import begin, differentiate
from sim2real.search.hypotheses import Hypothesis
from sim2real.search.joint import joint_pairs

RIG = load_rig("hmb_free")
BASE = Hypothesis((), {"mass": 0.005}, scales=RIG.scales)
NAMES = ("actuator_gain", "negative_stiffness", "damping", "sensor_gain")
RNG = np.random.default_rng(1)
COLUMN = {name: RNG.standard_normal(60) + 1j * RNG.standard_normal(60) for name in (*NAMES, "mass")}
# Both nearly cancel: together they do a tenth of what either does, in a direction of its own.
COLUMN["negative_stiffness"] = -COLUMN["actuator_gain"] + 0.1 * COLUMN["negative_stiffness"]
SIZE = {"actuator_gain": "change", "negative_stiffness": "change", "damping": "coefficient", "sensor_gain": "change"}


def simulate(points, settled=True):
    """Responses that are linear in every size."""
    found = np.zeros((len(points), 60), complex)
    for row, p in zip(found, points, strict=True):
        for name, values in p.effects.items():
            row += 300.0 * values[SIZE[name]] * COLUMN[name]
        row += 300.0 * p.changes.get("mass", 0.0) * COLUMN["mass"]
    return found


@pytest.fixture
def gap():
    """A gain and a stiffness that are off by 20 and 19 %, in noise."""
    truth = SimpleNamespace(effects={NAMES[0]: {"change": 0.2}, NAMES[1]: {"change": 0.19}}, changes={})
    noise = RNG.standard_normal(60) + 1j * RNG.standard_normal(60)
    problem = SimpleNamespace(data=simulate([truth])[0] + noise, simulate=simulate)
    (base,) = begin([BASE], [np.zeros(1)], problem.data, simulate)
    differentiate([base], problem.data, simulate, True)
    alone = [BASE.instead(name) for name in NAMES]
    singles = begin(alone, [np.full(h.size, 0.5) * (np.arange(h.size) == 0) for h in alone], problem.data, simulate)
    return problem, base, singles


def test_what_does_much_together_is_proposed_first_where_it_fits(gap):
    problem, base, singles = gap
    first = joint_pairs(problem, base, singles)[0]
    assert set(first.hypothesis.effects) == {"actuator_gain", "negative_stiffness"}
    found = first.hypothesis.point(first.u).effects
    assert found["actuator_gain"]["change"] == pytest.approx(0.2, abs=0.01)
    assert found["negative_stiffness"]["change"] == pytest.approx(0.19, abs=0.01)
    (there,) = begin([first.hypothesis], [first.u], problem.data, simulate)
    assert there.cost == pytest.approx(first.cost, rel=1e-6) and there.cost < 160 < 0.5 * base.cost


def test_what_is_known_or_touches_down_is_not_proposed(gap):
    problem, base, singles = gap
    known = {frozenset({"actuator_gain", "negative_stiffness"})}
    assert all(set(p.hypothesis.effects) not in known for p in joint_pairs(problem, base, singles, known))
    problem.simulate = lambda points: np.full((len(points), 60), np.nan, complex)
    assert joint_pairs(problem, base, singles) == []


def test_an_effect_of_one_sign_is_not_proposed_with_the_other(gap):
    """What would fit with the opposite of a hysteresis, which cannot have it."""
    problem, base, singles = gap
    hysteresis = BASE.instead("hysteresis")
    u = np.array([c.at({"strength": 0.1, "width": 0.1}[c.parameter]) for c in hysteresis.coordinates] + [0.0])
    for sign, proposed in ((1.0, True), (-1.0, False)):
        own = SimpleNamespace(simulate=lambda points, sign=sign: _with_hysteresis(points, sign), data=problem.data)
        fits = [f for f in singles if f.hypothesis.effects == ("actuator_gain",)]
        fits += begin([hysteresis], [u], own.data, own.simulate)
        found = joint_pairs(own, base, fits)
        assert bool(found) == proposed


def _with_hysteresis(points, sign):
    """A hysteresis does what a smaller stiffness does, or the opposite."""
    found = simulate(
        [
            SimpleNamespace(effects={k: v for k, v in p.effects.items() if k != "hysteresis"}, changes=p.changes)
            for p in points
        ]
    )
    for row, p in zip(found, points, strict=True):
        row += sign * 300.0 * p.effects.get("hysteresis", {"strength": 0.0})["strength"] * COLUMN["negative_stiffness"]
    return found
