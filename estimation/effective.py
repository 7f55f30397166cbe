"""Effective stiffness and damping: what a controller should give by its transfer function alone.

Dissertation (D) eq 4.5-4.7. Delay, amplifier, sensor and eddy currents are left out unless they are put into the
controller response; the difference from the identified ("actual") coefficients is what those cost.
"""

import numpy as np
from numpy.typing import ArrayLike, NDArray


def effective_coefficients(
    frequency: ArrayLike, controller_response: ArrayLike, actuator_gain: float, negative_stiffness: float
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Effective (stiffness N/m, damping N s/m), each (..., n), per frequency: D eq 4.5.

    frequency (n,) Hz, positive; controller_response (..., n) complex A/m from displacement to the current that opposes
    it, so a positive proportional gain is a positive stiffness; actuator_gain N/A; negative_stiffness N/m, <= 0:
    k = negative_stiffness + actuator_gain Re G, c = actuator_gain Im G / w. Springs beside the magnet add to k. Raises
    ValueError on bad shapes or values.
    """
    omega = _angular(frequency)
    response = np.asarray(controller_response, dtype=complex)
    if response.ndim == 0 or response.shape[-1] != omega.size:
        raise ValueError(f"controller_response must have {omega.size} values in its last dimension, one per frequency")
    _check_negative(negative_stiffness)
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
    """Effective (stiffness N/m, damping N s/m), each (n,), of a PID with an ideal integrator: D eq 4.7.

    G(s) = kp + ki / s + kd s / (1 + td s), D eq 4.6, with kp A/m, ki A/(m s), kd A s/m, td s; frequency (n,) Hz,
    positive; actuator_gain N/A; negative_stiffness N/m, <= 0. D eq 4.7 follows from eq 4.5 and 4.6 without error. The
    integrator of D eq 3.27 is a first-order low-pass instead; use `effective_coefficients` with its response. Raises
    ValueError on bad values.
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
