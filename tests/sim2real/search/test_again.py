"""What of an earlier attribution is fitted again, on a linear problem."""

from types import SimpleNamespace

import numpy as np
import pytest

from sim2real.search.again import again
from sim2real.search.candidates import Attribution, Candidate
from sim2real.search.fitting import begin
from sim2real.search.hypotheses import Hypothesis

NAMES = ("mass", "actuator_gain", "sensor_gain")
_DRAWN = np.random.default_rng(4).standard_normal((2, 3, 40))
MASS, ALIKE, OTHER = _DRAWN[0] + 1j * _DRAWN[1]
ROWS = dict(zip(NAMES, (MASS, MASS + 1e-3 * ALIKE, OTHER), strict=True))
REACH = 30.0


def problem(data, moved=0.0):
    """Residuals by changes in tenths; those of a gain come out otherwise where the problem was opened at a mass."""

    def predicted(point):
        sizes = {name: 10.0 * values["change"] for name, values in point.effects.items()}
        return sum(
            ((size + moved * (name == "actuator_gain")) * ROWS[name] for name, size in sizes.items()), 0.0 * MASS
        )

    return SimpleNamespace(data=data, simulate=lambda points: np.array([predicted(p) for p in points], complex))


def attribution(own, at):
    """Calibration, and effects at given coordinates."""
    known = [Hypothesis(names, {}) for names in ((), *at)]
    fits = begin(known, [np.zeros(0), *map(np.array, at.values())], own.data, own.simulate)
    return Attribution(0.0, tuple(map(Candidate, fits)), 80.0, own)


@pytest.mark.parametrize("gain", [5.0, 4.0])
def test_what_was_near_the_best_follows_where_the_problem_is_opened_at_that(gain):
    data = 5.0 * MASS
    before = attribution(problem(data), {("mass",): [5.0], ("actuator_gain",): [gain]})
    singles, pairs = again(problem(data, moved=2.0), before, np.full(3, REACH))
    cost = {f.hypothesis.effects[0]: f.cost for f in singles}
    assert cost["mass"] < 1.0 and not pairs
    assert (cost["actuator_gain"] < 1.0) == (gain == 5.0)


def test_pairs_are_fitted_again_where_they_add_something():
    data = 5.0 * MASS + 3.0 * OTHER
    known = {("mass",): [5.0], ("mass", "sensor_gain"): [5.0, 3.0], ("mass", "actuator_gain"): [5.0, 0.0]}
    before = attribution(problem(data), known)
    _, (adds, idle) = again(problem(data), before)
    assert adds.jacobian is not None and idle.jacobian is None
