"""A pair whose resonance had begun where alone it made up for the other effect."""

import numpy as np
import pytest

from sim2real.search.fitting import begin, iterate
from sim2real.search.hypotheses import Hypothesis
from sim2real.search.ringing import ringing

FREQUENCY, NOISE = np.linspace(5.0, 300.0, 120), 1e-3
PAIR = Hypothesis(("delay", "sensor_resonance"), {})


class Loop:
    """One record: a delay that turns the phase, and a mode of a probe."""

    def __init__(self, *truth):
        self.place, self.loudest, self.parts = slice(0, FREQUENCY.size), self, (self,)
        self.data = self.simulate([PAIR.point(at(*truth))])[0]

    def only(self, part):
        return self

    def simulate(self, points, settled=True):
        found = []
        for p in points:
            late = p.effects.get("delay", {}).get("time", 0.0)
            mode = {"frequency": 1.0, "damping_ratio": 0.1, "coupling": 0.0} | p.effects.get("sensor_resonance", {})
            x = FREQUENCY / mode["frequency"]
            rings = mode["coupling"] / (1 - x**2 + 2j * mode["damping_ratio"] * x)
            found.append((np.exp(-2j * np.pi * FREQUENCY * late) + rings) / NOISE)
        return np.array(found)


def at(time, frequency, damping_ratio, coupling):
    values = dict(time=time, frequency=frequency, damping_ratio=damping_ratio, coupling=coupling)
    return np.array([c.at(values[c.parameter]) for c in PAIR.coordinates])


def test_a_resonance_that_does_not_ring_is_sought_again():
    loop = Loop(2e-4, 123.0, 0.03, 0.01)
    (stuck,) = begin([PAIR], [at(2e-4, 18.0, 0.69, -0.01)], loop.data, loop.simulate)
    iterate([stuck], loop.data, loop.simulate, 3)
    assert stuck.cost > 1e3
    (found,) = ringing(loop, [stuck])
    mode = found.hypothesis.point(found.u).effects["sensor_resonance"]
    assert mode["frequency"] == pytest.approx(123.0, rel=1e-3)
    assert mode["damping_ratio"] == pytest.approx(0.03, rel=1e-2) and found.cost < 1.0


def test_one_that_rings_stays_as_it_is():
    loop = Loop(2e-4, 123.0, 0.03, 0.01)
    (there,) = begin([PAIR], [at(2e-4, 100.0, 0.05, 0.01)], loop.data, loop.simulate)
    assert ringing(loop, [there]) == [there]


def test_the_best_that_do_not_ring_are_sought_however_many_that_ring_are_better():
    loop = Loop(2e-4, 123.0, 0.03, 0.01)
    better = begin(
        [PAIR] * 3, [at(2e-4, 123.0, 0.03, size) for size in (0.01, 0.0101, 0.0102)], loop.data, loop.simulate
    )
    (stuck,) = begin([PAIR], [at(2e-4, 18.0, 0.69, -0.01)], loop.data, loop.simulate)
    assert stuck.cost > max(f.cost for f in better)
    *kept, found = ringing(loop, [*better, stuck])
    assert kept == better and found.cost < 1.0
