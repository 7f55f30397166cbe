"""Starts and how far others follow them, on predictions that are linear, against one joint least squares."""

from dataclasses import replace

import numpy as np
import pytest

from sim2real.search.fitting import begin, differentiate
from sim2real.search.hypotheses import RESONANCES, Hypothesis
from sim2real.search.screening import RESONANT, Start, extended, kept, screened
from sim2real.search.starts import starts, starts_elsewhere

TOLERANCE = {"mass": 0.01, "probe_gain": 0.02}
NAMES = ("mass", "sensor_gain", "delay")
ROWS = 50


class Toy:
    """One record of which the prediction is linear in three sizes."""

    def __init__(self, seed, truth):
        rng = np.random.default_rng(seed)
        self.columns = rng.standard_normal((3, ROWS)) + 1j * rng.standard_normal((3, ROWS))
        noise = rng.standard_normal(ROWS) + 1j * rng.standard_normal(ROWS)
        self.data = np.asarray(truth) @ self.columns + noise
        self.place, self.loudest, self.parts = slice(0, ROWS), self, (self,)

    def only(self, part):
        return self

    def simulate(self, points, settled=True):
        found = []
        for p in points:
            sizes = {name: values.get("change", values.get("time", 0.0) / 1e-4) for name, values in p.effects.items()}
            sizes["mass"] = sizes.get("mass", 0.0) + p.changes.get("mass", 0.0)
            sizes["sensor_gain"] = sizes.get("sensor_gain", 0.0) + p.changes.get("probe_gain", 0.0)
            found.append(np.array([10 * sizes.get(name, 0.0) for name in NAMES]) @ self.columns)
        return np.array(found)


def seeded(toy, hypothesis):
    seed = begin([hypothesis], [np.zeros(hypothesis.size)], toy.data, toy.simulate)[0]
    differentiate([seed], toy.data, toy.simulate, True)
    return seed


@pytest.mark.parametrize("times", [0.1, 4.0])
def test_a_spring_begins_as_strong_as_the_residual_asks(times):
    """Its coefficient, which a fit varies on a logarithmic scale, is found at once between starts a decade apart."""
    toy = Toy(4, (0.0, 0.0, 0.0))
    cube = np.random.default_rng(5).standard_normal(ROWS) * (1 + 1j)
    toy.data = toy.data + 30 * cube
    known = toy.simulate

    def simulate(points, settled=True):
        strong = [p.effects.get("cubic_spring", {}).get("coefficient", 0.0) / (1e9 * times) for p in points]
        return known(points) + 30 * np.array(strong)[:, None] * cube

    toy.simulate = simulate
    seed, h = seeded(toy, Hypothesis((), {})), Hypothesis(("cubic_spring",), {})
    best = screened(toy, [(seed, h, start) for start in starts("cubic_spring")])[0]
    assert np.exp(best.u[0]) == pytest.approx(1e9 * times, rel=0.02)


def test_a_start_takes_along_what_follows_it():
    """A delay beside calibration: its size and both tolerances, priors included, at once."""
    toy = Toy(1, (0.2, -0.3, 4.0))
    seed, h = seeded(toy, Hypothesis((), TOLERANCE)), Hypothesis(("delay",), TOLERANCE)
    best = screened(toy, [(seed, h, extended(h, start, seed)) for start in starts("delay")])[0]
    scale = 10 * np.array([0.1, 0.01, 0.02])  # of a coordinate: 10 us are a tenth; of a tolerance: itself
    rows = scale[:, None] * toy.columns[[2, 0, 1]]
    a = np.vstack([rows.T.real, rows.T.imag, np.diag([0.0, 1.0, 1.0])])
    solved = np.linalg.lstsq(a, np.concatenate([toy.data.real, toy.data.imag, np.zeros(3)]), rcond=None)[0]
    np.testing.assert_allclose(best.u, solved, rtol=1e-6, atol=1e-9)
    left = toy.data - solved @ rows
    assert best.cost == pytest.approx((abs(left) ** 2).sum() + (solved[1:] ** 2).sum(), rel=1e-9)


class Two:
    """Two records: the louder one tells nothing of a delay, as one sine may."""

    def __init__(self, quiet):
        self.loudest, self.other = Toy(6, (0.2, -0.3, 0.0)), Toy(7, (0.2, -0.3, 4.0))
        self.loudest.columns[2] *= quiet
        self.parts, self.own = (self.loudest, self.other), (self.loudest, self.other)
        self.other.place = slice(ROWS, 2 * ROWS)
        self.data = np.concatenate([p.data for p in self.own])

    def only(self, part):
        return part

    def simulate(self, points, settled=True):
        return np.concatenate([p.simulate(points) for p in self.own], axis=1)


@pytest.mark.parametrize("much", [False, True])
def test_starts_are_ranked_where_something_is_left(much):
    two = Two(quiet=1e-3)
    if much:  # where the loudest record leaves as much, nonlinearity shows there
        two.loudest.data += 4.0 * 1e3 * 10 * two.loudest.columns[2]
        two.data = np.concatenate([p.data for p in two.own])
    seed, h = seeded(two, Hypothesis((), TOLERANCE)), Hypothesis(("delay",), TOLERANCE)
    best = screened(two, [(seed, h, extended(h, start, seed)) for start in starts("delay")])[0]
    looked_at = two.loudest if much else two.other
    (predicted,) = looked_at.simulate([h.point(best.u)])
    left = looked_at.data - predicted
    assert best.cost == pytest.approx((abs(left) ** 2).sum() + (best.u[1:] ** 2).sum(), rel=1e-9)
    assert much or best.u[0] == pytest.approx(4.0, abs=0.2)


def test_a_tolerance_that_an_effect_frees_does_not_follow_it():
    """The mass begins where its tolerance had moved it, and is not held back by it."""
    toy = Toy(2, (5.0, 0.0, 0.0))
    seed, h = seeded(toy, Hypothesis((), TOLERANCE)), Hypothesis(("mass",), TOLERANCE)
    seed.u[0] = 2.0
    assert extended(h, np.array([0.3]), seed)[0] == pytest.approx(0.3 + 2.0 * 0.01 / 0.1)
    seed.u[0] = 0.0
    best = screened(toy, [(seed, h, extended(h, start, seed)) for start in starts("mass")])[0]
    assert best.u[0] * 0.1 * 10 == pytest.approx(5.0, abs=0.3)


def test_an_effect_of_one_sign_is_not_scaled_below_nothing():
    toy = Toy(3, (0.0, 0.0, -4.0))
    seed, h = seeded(toy, Hypothesis((), TOLERANCE)), Hypothesis(("delay",), TOLERANCE)
    found = screened(toy, [(seed, h, extended(h, start, seed)) for start in starts("delay")])
    assert min(s.u[0] for s in found) == 0.0 == found[0].u[0]


def test_a_seed_that_touches_down_leaves_the_starts_as_they_are():
    toy = Toy(4, (0.0, 0.0, 2.0))
    seed, h = seeded(toy, Hypothesis((), TOLERANCE)), Hypothesis(("delay",), TOLERANCE)
    seed.cost = np.inf
    found = screened(toy, [(seed, h, extended(h, start, seed)) for start in starts("delay")])
    assert {float(s.u[0]) for s in found} == {float(s[0]) for s in starts("delay")}


def test_of_a_resonance_starts_far_apart_are_kept_and_of_others_the_best():
    mode, lag = Hypothesis(("sensor_resonance",), {}), Hypothesis(("delay",), {})
    assert set(RESONANCES) == {"sensor_resonance", "support_resonance"}
    near = [
        Start(mode, np.array([np.log(f), -3.0, 1.0]), cost) for cost, f in enumerate((60.0, 62.0, 90.0, 150.0, 9.0))
    ]
    found = kept([*near, Start(lag, np.array([1.0]), 7.0), Start(lag, np.array([3.0]), 8.0)])
    frequencies = [round(float(np.exp(s.u[0]))) for s in found if s.hypothesis is mode]
    assert frequencies == [60, 90, 150] and len(frequencies) == RESONANT
    assert [s.cost for s in found if s.hypothesis is lag] == [7.0]


def test_friction_is_fitted_with_bristles_that_bend_and_without():
    """Where they do not bend the cost does not depend on how far they would."""
    h = Hypothesis(("friction",), {})
    tried = [Start(h, u, cost) for cost, u in enumerate(starts("friction"))]
    bends = [s.hypothesis.point(s.u).effects["friction"]["presliding"] > 2e-9 for s in tried]
    assert kept(tried) == [tried[bends.index(False)], tried[bends.index(True)]]
    assert kept(tried[::-1]) == [tried[::-1][bends[::-1].index(True)], tried[::-1][bends[::-1].index(False)]]


def test_of_what_may_sit_elsewhere_the_best_start_at_each_place_is_kept_and_the_plain_one():
    """A knee of the current, whose sharpness is free, is ahead on one record of the iron's, whose is not."""
    plain = Hypothesis(("saturation",), {})
    free = replace(plain, shaped=("saturation",))

    def elsewhere(name, cost):
        u = np.zeros(free.size)
        u[free.calibrated.index(f"saturation.{name}") + len(free.coordinates)] = 0.5
        return Start(free, u, cost)

    iron = [Start(plain, np.array([u]), cost) for u, cost in ((0.0, 3.0), (0.5, 6.0))]
    found = kept([elsewhere("current", 1.0), elsewhere("current", 2.0), iron[0], elsewhere("command", 5.0), iron[1]])
    assert [s.cost for s in found] == [1.0, 3.0, 5.0]


def test_iron_under_ripple_begins_as_the_lag_that_it_is_then():
    """Without ripple it does something else. The strength follows the data, the ripple of each start stays."""
    rng = np.random.default_rng(5)
    plain, lag = rng.standard_normal((2, ROWS)) + 1j * rng.standard_normal((2, ROWS))
    toy = Toy(5, (0.0, 0.0, 0.0))
    toy.data = 12.0 * lag + rng.standard_normal(ROWS) + 1j * rng.standard_normal(ROWS)

    def simulate(points, settled=True):
        own = [{"strength": 0.0, "ripple": 0.0, **p.effects.get("hysteresis", {})} for p in points]
        return np.array([20.0 * f["strength"] * (lag if f["ripple"] else plain) for f in own])

    toy.simulate = simulate
    seed = seeded(toy, Hypothesis((), {}))
    jobs = [(seed, h, u) for h, u in starts_elsewhere(seed.hypothesis, "hysteresis", 1.0)]
    jobs += [(seed, h, u) for h in [Hypothesis(("hysteresis",), {})] for u in starts("hysteresis")]
    assert {h.point(u).effects["hysteresis"].get("ripple", 0.0) > 0 for _, h, u in jobs} == {True, False}
    chosen = kept(screened(toy, jobs))
    assert sorted(s.hypothesis.shaped for s in chosen) == [(), ("hysteresis",)]
    rippled = chosen[0].hypothesis.point(chosen[0].u).effects["hysteresis"]
    assert rippled["strength"] == pytest.approx(0.6, abs=0.05) and rippled["ripple"] > 10
