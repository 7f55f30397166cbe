"""A self-sensor as a small continuous linear system, for the analysis of the loop that it closes."""

from functools import lru_cache

import numpy as np

from selfsense.forward_path import BUTTERWORTH
from selfsense.linear import LinearSensor, linearise
from selfsense.sensor import SelfSensor

STATES = 4  # amplitude difference and its slope, delay, integral
PROBED = 500.0  # Hz; the lag of the forward path beyond its low-pass is taken at this frequency


@lru_cache(maxsize=1024)
def baseband(sensor: SelfSensor) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """A (4, 4), B (4,), C (4,) from true to sensed displacement (m), in continuous time, at half duty.

    The closed loop consists of the low-pass behind the rectifier, the rest of the forward path as a Pade delay, and the
    PI controller. It holds up to about 4 kHz; see `linear.tracking` for the sampled response.

    Raises:
        ValueError: As `linear.linearise`.
    """
    linear = _linear(sensor)
    corner = 2 * np.pi * sensor.estimator.path.low_pass
    s = 2j * np.pi * PROBED
    low_pass = corner**2 / (s**2 + corner / BUTTERWORTH * s + corner**2)
    forward, coil = linear.forward(PROBED), linear.coil(PROBED)
    delay = -np.angle(forward / low_pass) / (2 * np.pi * PROBED)
    gain = abs(forward / low_pass)
    interval = 1 / sensor.acquisition.rate
    kp, ki = sensor.estimator.kp + sensor.estimator.ki * interval / 2, sensor.estimator.ki
    # States: amplitude difference and its slope, delay, integral. The delayed error is x3 - (gap - estimate).
    a, b = np.zeros((STATES, STATES)), np.zeros(STATES)
    estimate = np.array([kp, 0.0, 0.0, 1.0])
    a[0, 1] = 1.0
    a[1, :2] = -(corner**2), -corner / BUTTERWORTH
    a[1] += gain * corner**2 * estimate
    a[1, 2], b[1] = gain * corner**2, -gain * corner**2
    a[2], b[2] = -4 / delay * estimate, 4 / delay
    a[2, 2] -= 2 / delay
    a[3, 0] = ki
    c = estimate * (sensor.scale * abs(coil / forward))
    for cached in (a, b, c):
        cached.flags.writeable = False
    return a, b, c


@lru_cache(maxsize=1024)
def growth_rate(sensor: SelfSensor) -> float:
    """Rate (1/s) at which a small error of the sampled estimator grows at half duty; negative if it decays.

    `baseband` is too slow a model to show it.

    Raises:
        ValueError: As `linear.linearise`.
    """
    linear = _linear(sensor)
    cycle = linear.direct.size / linear.rate
    return float(np.log(linear.growth(sensor.estimator.kp, sensor.estimator.ki)) / cycle)


@lru_cache(maxsize=64)
def _linear(sensor: SelfSensor) -> LinearSensor:
    return linearise(sensor)
