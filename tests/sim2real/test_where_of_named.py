"""What is named is located beside its own calibration, not beside that which calibration alone would need."""

from types import SimpleNamespace

import numpy as np
import pytest

from sim2real import diagnosis as diagnosis_module
from sim2real.diagnosis import _where_of
from sim2real.search.candidates import Candidate
from sim2real.search.fit import Fit
from sim2real.search.hypotheses import Hypothesis

TOLERANCE = {"mass": 0.01, "amplifier_time_constant": 0.1}


def fitted(names, u, falls=False):
    """A problem whose prediction is 1 + 100 times the change of the mass, or nan without what is named."""
    h = Hypothesis(names, TOLERANCE)

    def simulate(points):
        assert all(not p.effects for p in points)
        return np.array([np.full(3, np.nan if falls else 1 + 100 * p.changes["mass"]) for p in points], complex)

    fit = Fit(h, np.array(u), np.zeros(3, complex), 0.0)
    return SimpleNamespace(data=np.full(3, 5.0 + 0j), simulate=simulate), Candidate(fit)


@pytest.mark.parametrize(
    ("names", "u", "falls", "left"),
    [
        (("delay",), (-9.0, 2.0, 0.0), False, 2.0),
        (("delay",), (-9.0, 2.0, 0.0), True, None),
        ((), (2.0, 0.0), False, None),
    ],
)
def test_it_is_what_its_calibration_leaves_without_it(monkeypatch, names, u, falls, left):
    monkeypatch.setattr(diagnosis_module, "locate", lambda problem, residual, tones: (residual.tolist(), tones))
    problem, picked = fitted(names, u, falls)
    assert _where_of(problem, picked, 7.0) == (None if left is None else ([left + 0j] * 3, 7.0))
