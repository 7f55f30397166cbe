"""The valley of a law's exponent and offset, along which only the curvature changes."""

from types import SimpleNamespace

import numpy as np

from maglev_env.loop.effect import effect_value
from maglev_env.rig.rig_file import load_rig
from sim2real.search.along_law import along_law
from sim2real.search.fitting import begin
from sim2real.search.hypotheses import Hypothesis

H = Hypothesis(("force_law",), {"negative_stiffness": 0.03})
MOTION = np.linspace(-0.1, 0.1, 60) * (1 + 0.2j)


class Magnets:
    """Opposed magnets whose pull is a power law of the gap: its slope, and what the motion adds to that."""

    def __init__(self, exponent, offset):
        self.parts = (SimpleNamespace(record=SimpleNamespace(nominal=load_rig("hmb_radial"))),)
        law = {"force_law": {"exponent": exponent, "offset": offset}}
        self.data = self.simulate([SimpleNamespace(effects=law, changes={})])[0]

    def simulate(self, points, settled=True):
        found = []
        for p in points:
            power = 2.0 + effect_value(p.effects, "force_law", "exponent")
            far = 1.0 + effect_value(p.effects, "force_law", "offset")
            steep = power / far * (1 + p.changes.get("negative_stiffness", 0.0))
            curved = (power + 1) * (power + 2) / far**2 / 6
            found.append((steep * MOTION * (1 + curved * MOTION.real**2)) / 1e-5)
        return np.array(found)


def test_a_law_that_began_beside_its_place_is_found_along_the_valley():
    problem = Magnets(0.9, 0.0)
    at = {"exponent": -0.285, "offset": -0.3}
    u = np.array([*(c.at(at[c.parameter]) for c in H.coordinates), 3.6])
    (stuck,) = begin([H], [u], problem.data, problem.simulate)
    (found,) = along_law(problem, [stuck])
    assert found.cost < 1e-2 * stuck.cost
    assert abs(found.u[-1]) < 0.5 * stuck.u[-1]  # and what the rig states is strained less


def test_a_fit_in_its_place_and_other_effects_stay():
    problem = Magnets(0.9, 0.0)
    there = np.array([*(c.at({"exponent": 0.9, "offset": 0.0}[c.parameter]) for c in H.coordinates), 0.0])
    fits = begin([H, Hypothesis(("mass",), {})], [there, np.zeros(1)], problem.data, problem.simulate)
    assert along_law(problem, fits) == fits
