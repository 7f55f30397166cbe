"""What a step of the force does to the linearised loop in time."""

import numpy as np

from maglev_env.experiment import Experiment
from maglev_env.linear.poles import closed_loop


def step_load(experiment: Experiment, duration: float, points: int = 300) -> tuple[np.ndarray, np.ndarray]:
    """Displacement readings after a force of 1 N begins to act at time 0 on the rotor at rest.

    The values are those of the sampled loop, exactly, at every k-th control sample.

    Args:
        experiment: with rig, effects, sensor and gains; its excitations are not used.
        duration: of the curve, s; one control sample at least.
        points: about how many values are given; fewer where the control rate allows fewer.

    Returns:
        Time (n,) in s, and displacement (n, axes, axes) in m/N, with indices [reading, force] axis.
    """
    a, b, c = closed_loop(experiment)
    rate = experiment.rig.control_rate
    stride = max(1, round(duration * rate / points))
    n, axes = a.shape[0], b.shape[1]
    # With the constant force as further states, one power of the matrix advances the loop by a whole stride.
    whole = np.zeros((n + axes, n + axes))
    whole[:n, :n], whole[:n, n:], whole[n:, n:] = a, b, np.eye(axes)
    advance = np.linalg.matrix_power(whole, stride)
    state = np.eye(n + axes)[:, n:]
    times = np.arange(0, max(1, round(duration * rate)) + 1, stride) / rate
    read = np.empty((times.size, axes, axes))
    for i in range(times.size):
        read[i] = c @ state[:n]
        state = advance @ state
    return times, read
