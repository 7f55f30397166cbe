"""What a diagnosis prints of a fit's parameters."""

import numpy as np
import pytest

from sim2real.result import fitted_parameters
from sim2real.search.candidates import Candidate
from sim2real.search.fit import Fit
from sim2real.search.hypotheses import Hypothesis

MASS = Hypothesis(("mass",), {"probe_gain": 0.02})


def fit(jacobian: np.ndarray | None) -> Candidate:
    """Mass + 3 %, probe gain + 1 %."""
    return Candidate(Fit(MASS, np.array([0.3, 0.5]), np.zeros(2, complex), 1.0, jacobian))


def test_a_candidate_that_was_not_fitted_again_has_values_without_standard_errors():
    found = fitted_parameters(fit(None))
    assert found["mass.change"]["value"] == pytest.approx(0.03)
    assert found["probe_gain (relative)"]["value"] == pytest.approx(0.01)
    assert [one["se"] for one in found.values()] == [None, None]


def test_a_fitted_candidate_has_those_of_its_normal_equations_and_prior():
    """Half a standard deviation of the data is moved per unit of mass; the probe's gain rests on its prior alone."""
    found = fitted_parameters(fit(np.array([[0.5 + 0j, 0], [0, 0]])))
    assert found["mass.change"]["se"] == pytest.approx(0.1 * 2)
    assert found["probe_gain (relative)"]["se"] == pytest.approx(0.02)


def test_a_form_that_is_wholly_taken_has_not_ended_at_a_bound():
    h = Hypothesis(("support_resonance",), {}, shaped=("support_resonance",))
    u = h.bounded(np.full(h.size, 50.0))
    found = fitted_parameters(Candidate(Fit(h, u, np.zeros(2, complex), 1.0, np.zeros((h.size, 2), complex))))
    assert found["support_resonance.inside"] == {"value": 1.0, "se": None, "at_bound": False}


def test_a_parameter_that_nothing_tells_has_no_standard_error():
    found = fitted_parameters(fit(np.zeros((2, 2), complex)))
    assert found["mass.change"]["se"] is None and found["probe_gain (relative)"]["se"] == pytest.approx(0.02)
