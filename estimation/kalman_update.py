"""The measurement update of a Kalman filter."""

import numpy as np


def kalman_update(
    state: np.ndarray, covariance: np.ndarray, innovation: np.ndarray, observed: np.ndarray, noise: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """State and covariance after a measurement, by Joseph's form, whose covariance stays symmetric and positive.

    Source: Bucy and Joseph 1968, Filtering for Stochastic Processes with Applications to Guidance, chapter 16.

    Args:
        state: (n,) before.
        covariance: (n, n) before.
        innovation: (m,): the measurement less what was expected.
        observed: (m, n): the derivative of the measurement by the state.
        noise: covariance (m, m) of the measurement.

    Returns:
        State (n,), covariance (n, n), and the covariance (m, m) of the innovation.

    Raises:
        numpy.linalg.LinAlgError: The innovation's covariance is singular.
    """
    cross = covariance @ observed.T
    spread = observed @ cross + noise
    gain = cross @ np.linalg.inv(spread)
    rest = np.eye(len(state)) - gain @ observed
    return state + gain @ innovation, rest @ covariance @ rest.T + gain @ noise @ gain.T, spread
