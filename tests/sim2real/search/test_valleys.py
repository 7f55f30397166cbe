"""A fit at the far end of a valley: the interval reaches as far as the valley is flat, and no farther."""

from types import SimpleNamespace

import numpy as np
import pytest

from sim2real.coefficients import least_spread
from sim2real.search.fitting import begin, differentiate
from sim2real.search.hypotheses import Hypothesis
from sim2real.search.valleys import held_aside

FAR = 2.8  # relative change at which the fit ends
BOTH = Hypothesis(("negative_stiffness", "support_stiffness"), {})


def ends_far(tells, far=FAR):
    """A problem in which both changes are known in one sum, and one of them by what it `tells`, and its fit."""

    def simulate(points):
        changes = [[p.effects.get(name, {}).get("change", 0.0) for name in BOTH.effects] for p in points]
        return np.array([[1000 * (b - 0.1 * a), tells(a)] for a, b in changes], complex)

    problem = SimpleNamespace(data=np.array([0.0, tells(far)], complex), simulate=simulate, parts=())
    u = [change / c.scale for change, c in zip((far, 0.1 * far), BOTH.coordinates, strict=True)]
    (fit,) = begin([BOTH], [np.array(u)], problem.data, problem.simulate)
    differentiate([fit], problem.data, problem.simulate, True)
    return problem, fit


def spread(tells):
    """Least relative standard errors of both changes, (2,); the held points are those of either."""
    problem, fit = ends_far(tells)
    least = [least_spread(fit, point) for point in held_aside(problem, fit)]
    sd = np.maximum.reduce([np.sqrt(np.diag(fit.covariance())), *least])
    return sd * [c.scale for c in BOTH.coordinates]


def test_a_valley_that_is_level_at_the_nominal_value_is_not_narrow():
    assert spread(lambda a: 4 * a * (a - FAR)) == pytest.approx(
        [FAR / np.sqrt(0.3), 0.1 * FAR / np.sqrt(0.3)], rel=0.02
    )


def test_a_parabola_is_as_wide_as_its_curvature():
    assert spread(lambda a: 11 * a) == pytest.approx([1 / 11, 0.1 / 11], rel=0.02)


def test_a_narrow_place_far_away_is_as_wide_as_the_valley_that_it_lies_in():
    """A light resonance that fits the noise: a depth of 9 in the cost, and level beside it."""
    assert spread(lambda a: 3 * np.tanh(40 * (a - FAR)))[0] == pytest.approx(FAR / 3, rel=0.02)


def test_what_is_well_told_near_the_nominal_value_is_not_looked_at():
    assert not held_aside(*ends_far(lambda a: 100 * a, 0.1))
