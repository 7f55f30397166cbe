"""A further mode that a fit has at a wrong place, as where friction left most while it was chosen."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from test_shaping import LINES, on_springs

from maglev_env.loop.effect import effect
from sim2real.compared.point import Point
from sim2real.search.fitting import begin, iterate
from sim2real.search.hypotheses import Hypothesis
from sim2real.search.sought_again import sought_again

NAME = "support_resonance"
FIRST = {"frequency": 15.0, "damping_ratio": 0.02, "mass_ratio": 0.08}
FURTHER = {"further_ratio": 0.01, "further_frequency": 2.4, "further_damping": 0.015}
SWAPPED = {"frequency": 6.0, "damping_ratio": 0.1, "mass_ratio": 0.001}


def fitted(values, seed=4):
    """A fit that begins at values, in noise of variance one about the two bodies."""
    noise = np.random.default_rng(seed).standard_normal((2, LINES.size))
    truth = effect(NAME, **FIRST)[NAME] | FURTHER
    data = on_springs([Point({NAME: truth}, {})])[0] + noise[0] + 1j * noise[1]
    h = replace(Hypothesis((NAME,), {}), shaped=(NAME,))
    u = [c.at(values[c.parameter]) for c in h.coordinates]
    u += [h.shapes[n].at(values.get(h.shapes[n].key, h.shapes[n].parameter.default)) for n in h.calibrated]
    (fit,) = begin([h], [h.bounded(np.array(u))], data, on_springs)
    iterate([fit], data, on_springs, 30)
    return SimpleNamespace(data=data, simulate=on_springs), fit


@pytest.mark.parametrize(
    "values",
    [
        FIRST | {"further_ratio": 0.002, "further_frequency": 0.4, "further_damping": 0.005},
        SWAPPED | {"further_ratio": 0.08, "further_frequency": 2.5, "further_damping": 0.02},
    ],
    ids=["the further one elsewhere", "the further one in place of the first"],
)
def test_a_further_mode_goes_to_where_it_explains_most(values):
    b, stuck = fitted(values)
    other = replace(stuck, cost=stuck.cost + 1e3)
    found, kept = sought_again(b, [stuck, other])
    assert stuck.cost > 3 * 2 * LINES.size and found.cost < 1.3 * 2 * LINES.size and kept is other
    at = found.hypothesis.point(found.u).effects[NAME]
    assert at["frequency"] == pytest.approx(15.0, rel=0.01)
    assert at["further_frequency"] == pytest.approx(2.4, rel=0.02)


def test_what_leaves_noise_alone_stays():
    b, fit = fitted(FIRST | FURTHER)
    assert sought_again(b, [fit]) == [fit] and sought_again(b, []) == []
