"""Effective stiffness and damping: the values that the controller's transfer function alone would give.

Dissertation (D) eq 4.5-4.7. Delay, amplifier, sensor and eddy currents are left out unless the controller response
contains them. The difference from the identified ("actual") coefficients is the effect of what was left out.
"""

import numpy as np
from numpy.typing import ArrayLike, NDArray


def effective_coefficients(
    frequency: ArrayLike, controller_response: ArrayLike, actuator_gain: float, negative_stiffness: float
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Effective stiffness and damping at each frequency, D eq 4.5.

    k = negative_stiffness + actuator_gain Re G and c = actuator_gain Im G / w.

    Args:
        frequency: Positive frequencies (n,), Hz.
        controller_response: Complex response G (..., n), A/m, from displacement to the current that opposes it; a
            positive proportional gain is then a positive stiffness.
        actuator_gain: Force per current, N/A.
        negative_stiffness: Stiffness of the magnet, N/m; positive of a magnet that a permanent one carries beyond its
            iron's pull. Springs beside the magnet add to k.

    Returns:
        stiffness: Effective stiffness (..., n), N/m.
        damping: Effective damping (..., n), N s/m.

    Raises:
        ValueError: Bad shapes or values.
    """
    omega = _angular(frequency)
    response = np.asarray(controller_response, dtype=np.complex128)
    if response.ndim == 0 or response.shape[-1] != omega.size:
        raise ValueError(f"controller_response must have {omega.size} values in its last dimension, one per frequency")
    return negative_stiffness + actuator_gain * response.real, actuator_gain * response.imag / omega


def pid_effective_coefficients(
    frequency: ArrayLike,
    kp: float,
    ki: float,
    kd: float,
    td: float,
    actuator_gain: float,
    negative_stiffness: float,
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Effective stiffness and damping of a PID controller with an ideal integrator, D eq 4.7.

    G(s) = kp + ki / s + kd s / (1 + td s), D eq 4.6. The integrator of D eq 3.27 is a first-order low-pass instead;
    for that one, use `effective_coefficients` with its response.

    Args:
        frequency: Positive frequencies (n,), Hz.
        kp: Proportional gain, A/m.
        ki: Integral gain, A/(m s).
        kd: Derivative gain, A s/m.
        td: Time constant of the derivative filter, s.
        actuator_gain: Force per current, N/A.
        negative_stiffness: Stiffness of the magnet, N/m, at most 0.

    Returns:
        stiffness: Effective stiffness (n,), N/m.
        damping: Effective damping (n,), N s/m.

    Raises:
        ValueError: Bad values.
    """
    omega = _angular(frequency)
    _check_negative(negative_stiffness)
    lag = 1 + (td * omega) ** 2
    stiffness = actuator_gain * (kp + kd * td * omega**2 / lag) + negative_stiffness
    damping = actuator_gain * (kd / lag - ki / omega**2)
    return stiffness, damping


def _angular(frequency: ArrayLike) -> NDArray[np.float64]:
    f = np.asarray(frequency, dtype=float)
    if f.ndim != 1 or not np.all(np.isfinite(f)) or np.any(f <= 0):
        raise ValueError("frequency must be a one-dimensional array of positive frequencies in Hz")
    return 2 * np.pi * f


def _check_negative(negative_stiffness: float) -> None:
    if not negative_stiffness <= 0:
        raise ValueError(
            "negative_stiffness must not be positive; give the magnet's pull-in stiffness as a number <= 0"
        )
