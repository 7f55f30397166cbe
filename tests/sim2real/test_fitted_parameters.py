"""What a diagnosis prints of a fit's parameters."""

from dataclasses import replace

import numpy as np
import pytest

from sim2real.compared.commands_seen import LOST, WITHIN
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


@pytest.mark.parametrize("louder", (1.0, 5.0))
def test_what_a_fit_leaves_widens_its_errors_to_those_of_its_values(louder):
    """Over fits of noise of another size than stated, about rigs that are drawn within their tolerance."""
    rng, lines, values, claimed = np.random.default_rng(0), 100, [], []
    jacobian = np.array([0.3, 0.1])[:, None] * (rng.standard_normal((2, lines)) + 1j * rng.standard_normal((2, lines)))
    for _ in range(600):
        gain = rng.standard_normal()
        noise = louder * (rng.standard_normal(lines) + 1j * rng.standard_normal(lines))
        data = gain * jacobian[1] + noise
        exact = Fit(MASS, np.zeros(2), data, 0.0, jacobian)
        u = exact.covariance() @ exact.gradient
        found = fitted_parameters(Candidate(replace(exact, u=u, residual=data - u @ jacobian)))
        values.append([found["mass.change"]["value"], found["probe_gain (relative)"]["value"] - 0.02 * gain])
        claimed.append([found["mass.change"]["se"], found["probe_gain (relative)"]["se"]])
    assert np.sqrt(np.mean(np.square(values), axis=0)) == pytest.approx(np.mean(claimed, axis=0), rel=0.08)


@pytest.mark.parametrize("size", [0.0, 0.5])
def test_a_further_mode_without_a_size_is_nowhere(size):
    h = Hypothesis(("sensor_resonance",), {}, shaped=("sensor_resonance",))
    u, first = np.zeros(h.size), len(h.coordinates)
    names = list(h.calibrated)
    at = first + names.index("sensor_resonance.further_ratio")
    u[at] = h.shapes["sensor_resonance.further_ratio"].at(size)
    for name in ("further_frequency", "further_damping"):
        u[first + names.index(f"sensor_resonance.{name}")] += 0.5
    found = fitted_parameters(
        Candidate(Fit(h, u, np.zeros(h.size, complex), 1.0, 30.0 * np.eye(h.size, dtype=complex)))
    )
    assert any("further" in name for name in found) == bool(size)


@pytest.mark.parametrize(("told", "printed"), [(0.1, False), (5.0, True)])
def test_a_form_that_is_not_told_from_the_plain_one_is_not_printed(told, printed):
    """As "stribeck 2.0 +- 2.0 mm/s" was beside a friction that has no static share."""
    h = Hypothesis(("friction",), {}, shaped=("friction",))
    at = len(h.coordinates) + h.calibrated.index("friction.static")
    u, jacobian = np.zeros(h.size), np.zeros((h.size, 2), complex)
    u[at], jacobian[at, 0] = 1.0, told
    found = fitted_parameters(Candidate(Fit(h, u, np.zeros(2, complex), 1.0, jacobian)))
    assert ("friction.static" in found) == printed


@pytest.mark.parametrize(("reciprocal", "told"), [(1e-4, 30.0), (0.5, 30.0), (0.5, 0.5)])
def test_a_knee_that_is_not_told_from_none_is_not_printed(reciprocal, told):
    """As "command 9.59 kA" was."""
    h = Hypothesis(("saturation",), {}, shaped=("saturation",))
    at = len(h.coordinates) + h.calibrated.index("saturation.command")
    u, jacobian = np.zeros(h.size), np.zeros((h.size, 2), complex)
    u[at], jacobian[at, 0] = reciprocal, told
    found = fitted_parameters(Candidate(Fit(h, u, np.zeros(2, complex), 1.0, jacobian)))
    assert ("saturation.command" in found) == (reciprocal * told > 2)


def test_lost_commands_that_were_counted_are_as_many_as_were_counted():
    """The fit ended at the end of the count, which a mean delay asks for less than."""
    h = Hypothesis(("dropped_samples",), {}, seen={LOST: (0.09, 0.11)})
    u = h.bounded(np.array([c.at(0.01) for c in h.coordinates]))
    assert h.point(u).effects[LOST]["probability"] == pytest.approx(0.09)
    found = fitted_parameters(Candidate(Fit(h, u, np.zeros(2, complex), 1.0, np.zeros((2, h.size), complex).T)))
    assert found["dropped_samples.probability"] == {
        "value": pytest.approx(0.1), "se": pytest.approx(0.01 / WITHIN), "at_bound": False
    }  # fmt: skip


@pytest.mark.parametrize(("field", "knee", "shown"), [(1e3, 0.6, False), (1e3, np.inf, True), (0.8, 0.6, True)])
def test_a_field_that_nothing_reaches_is_not_listed_beside_a_current_that_saturates(field, knee, shown):
    h = Hypothesis(("saturation",), {}, shaped=("saturation",))
    u = np.zeros(h.size)
    u[0] = h.coordinates[0].at(field)
    u[h.calibrated.index("saturation.current") + 1] = 1 / (knee * h.shapes["saturation.current"].parameter.shape)
    data = np.zeros(h.size, complex)
    found = fitted_parameters(Candidate(Fit(h, h.bounded(u), data, 1.0, 1e3 * np.eye(h.size, dtype=complex))))
    assert ("saturation.field" in found) == shown
    assert ("saturation.current" in found) == np.isfinite(knee)
