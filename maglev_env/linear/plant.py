"""The linearised plant of an experiment, in continuous time and exactly sampled.

Effects enter with their linear part (see `linear_axis`), eddy currents with the same branches as in the simulator.
"""

import numpy as np
import scipy

from maglev_env.experiment import Experiment, axis_experiment
from maglev_env.lane_values import lane_values
from maglev_env.linear.axis import POSITION, VELOCITY, cross_terms, linear_axis
from maglev_env.loop.effect import effect_value, split_delay


def discrete_plant(experiment: Experiment) -> tuple[np.ndarray, ...]:
    """The plant over one control sample, from held forces (N) and commands (A) to displacement readings (m).

    With a delay that is not a whole number of samples, each command changes from old to new within the sample.

    Returns:
        A (n, n); B_force, B_old and B_new (n, axes) each; C (axes, n); and the coils' currents (axes, n) in A, without
        what jumps with the command.
    """
    m, c, current = continuous_plant(experiment)
    return *sampled(experiment, m), c, current[:, : c.shape[1]]


def sampled(experiment: Experiment, m: np.ndarray) -> tuple[np.ndarray, ...]:
    """A, B_force, B_old, B_new of `discrete_plant` from the rates m of states, held forces and held commands."""
    dt, axes = 1 / experiment.rig.control_rate, experiment.rig.axes
    n = len(m) - 2 * axes
    _, switch = split_delay(experiment.effects, dt)
    first, second = scipy.linalg.expm(m * switch) if switch else np.eye(len(m)), scipy.linalg.expm(m * (dt - switch))
    whole = second @ first
    b_old = second[:n, :n] @ first[:n, n + axes :]
    return whole[:n, :n], whole[:n, n : n + axes], b_old, second[:n, n + axes :]


def continuous_plant(experiment: Experiment) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Linear equations of all axes in continuous time.

    Returns:
        Rates (n, n) of the states of all axes, then their held forces, then their held commands; readings
        (axes, states) in m; coil currents (axes, n) in A.
    """
    axes = experiment.rig.axes
    views = [axis_experiment(experiment, axis) for axis in range(axes)]
    parts = [linear_axis(view) for view in views]
    starts = np.cumsum([0, *(len(part.rates) - 2 for part in parts)])
    states = int(starts[-1])
    n = states + 2 * axes
    # Indices of each axis' states, force and command among those of all axes.
    own = [np.r_[starts[axis] : starts[axis + 1], states + axis, states + axes + axis] for axis in range(axes)]
    m, c, current = np.zeros((n, n)), np.zeros((axes, n)), np.zeros((axes, n))
    for axis, part in enumerate(parts):
        m[np.ix_(own[axis], own[axis])] = part.rates
        c[axis, own[axis]], current[axis, own[axis]] = part.reading, part.current
    for axis, other in ((0, 1), (1, 0)) if axes == 2 else ():
        stiffness, damping, gain, sensor = cross_terms(experiment, axis, views[other])
        pushed = np.zeros(n)
        pushed[own[other]] = gain * parts[other].pulling
        pushed[own[other][POSITION]] -= stiffness
        pushed[own[other][VELOCITY]] -= damping
        m[own[axis]] += np.outer(parts[axis].driven, pushed / lane_values([views[axis]]).mass)
        c[axis, own[other]] += sensor * parts[other].reading
    scale = np.array([1 + effect_value(view.effects, "sensor_gain") for view in views])
    return m, c[:, :states] * scale[:, None], current
