import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from estimation.effective import effective_coefficients, pid_effective_coefficients
from estimation.least_squares import least_squares

FREQUENCY = np.array([0.5, 5.0, 70.0, 250.0])


@settings(max_examples=60, deadline=None)
@given(kp=st.floats(0, 2e4), ki=st.floats(0, 1e5), kd=st.floats(0, 20), td=st.floats(0, 1e-2), gain=st.floats(0.1, 100))
def test_the_closed_form_is_the_response_of_the_pid(kp, ki, kd, td, gain):
    s = 2j * np.pi * FREQUENCY
    response = kp + ki / s + kd * s / (1 + td * s)
    general = effective_coefficients(FREQUENCY, response, gain, -12500.0)
    closed = pid_effective_coefficients(FREQUENCY, kp, ki, kd, td, gain, -12500.0)
    scale = gain * np.abs(response) + 12500.0
    assert np.all(np.abs(closed[0] - general[0]) < 1e-12 * scale)
    assert np.all(np.abs(closed[1] - general[1]) < 1e-12 * scale / np.abs(s))


def test_proportional_gain_is_stiffness_and_derivative_gain_is_damping():
    stiffness, damping = pid_effective_coefficients(FREQUENCY, 8000.0, 0.0, 5.2, 0.0, 5.7, -12500.0)
    np.testing.assert_allclose(stiffness, 5.7 * 8000 - 12500)
    np.testing.assert_allclose(damping, 5.7 * 5.2)


def test_an_ideal_loop_is_identified_as_its_effective_coefficients():
    kp, kd, mass = 8000.0, 5.2, 0.08
    stiffness, damping = pid_effective_coefficients(FREQUENCY, kp, 0.0, kd, 0.0, 5.7, -12500.0)
    s = 2j * np.pi * FREQUENCY
    got = least_squares(FREQUENCY, 1 / (mass * s**2 - 12500 + 5.7 * (kp + kd * s)), mass)
    assert got.stiffness == pytest.approx(stiffness[0])
    assert got.damping == pytest.approx(damping[0])


def test_leading_dimensions_are_kept():
    response = np.ones((3, 2, FREQUENCY.size)) * (1 + 2j)
    stiffness, damping = effective_coefficients(FREQUENCY, response, 2.0, -1.0)
    assert stiffness.shape == damping.shape == response.shape
    np.testing.assert_allclose(stiffness, 1.0)


@pytest.mark.parametrize(
    ("arguments", "name"),
    [
        (([0.0, 1.0], [1j, 1j], 1.0, -1.0), "frequency"),
        (([1.0, 2.0], [1j], 1.0, -1.0), "controller_response"),
    ],
)
def test_bad_input_is_named(arguments, name):
    with pytest.raises(ValueError, match=name):
        effective_coefficients(*arguments)
    if name != "controller_response":
        frequency, _, gain, negative = arguments
        with pytest.raises(ValueError, match=name):
            pid_effective_coefficients(frequency, 1.0, 0.0, 0.0, 0.0, gain, negative)


def test_a_magnet_that_restores_adds_its_stiffness_and_a_pid_form_refuses_it():
    stiffness, _ = effective_coefficients([1.0, 2.0], [3.0 + 0j, 3.0 + 0j], 2.0, 81.0)
    assert stiffness == pytest.approx([87.0, 87.0])
    with pytest.raises(ValueError, match="negative_stiffness"):
        pid_effective_coefficients([1.0, 2.0], 1.0, 0.0, 0.0, 0.0, 2.0, 81.0)
