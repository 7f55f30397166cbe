"""The open loop of one axis as a sampled system, from command and force to the reading and the coil's current."""

from dataclasses import dataclass, replace

import numpy as np
import scipy

from maglev_env.experiment import Experiment
from maglev_env.linear.plant import continuous_plant, sampled
from maglev_env.loop.effect import effect_value, split_delay


@dataclass(frozen=True, eq=False)
class OpenLoop:
    """x' = a x + command u + force f, exactly sampled, of n states for k axes; the last are commands that act later.

    Attributes:
        a: (n, n).
        command: (n, k), per A.
        force: (n, k), per N, held over each sample.
        reading: (k, n), m.
        current: (k, n), A; without what the command of the same sample adds.
        jump: (k, k), what that adds, A/A: 0 unless the coil follows its command without any lag.
        dt: s.
    """

    a: np.ndarray
    command: np.ndarray
    force: np.ndarray
    reading: np.ndarray
    current: np.ndarray
    jump: np.ndarray
    dt: float


def open_loop(experiment: Experiment) -> OpenLoop:
    """The linear plant of an experiment with its effects, delay and lost samples included.

    Args:
        experiment: with rig, effects and sensor; of its gains nothing is used.
    """
    dt = 1 / experiment.rig.control_rate
    m, readings, current = continuous_plant(experiment)
    own, b_force, b_old, b_new = sampled(experiment, m)
    delay, fraction = split_delay(experiment.effects, dt)
    lost = effect_value(experiment.effects, "dropped_samples")
    n, axes = len(own), len(readings)
    size = n + (delay + 1) * axes
    # Rows: the command of now, of one sample ago, ...; columns: the states, then the input.
    commands = np.eye((delay + 2) * axes, size + axes, n - axes)
    commands[:axes, :] = 0.0
    commands[:axes, size:] = (1 - lost) * np.eye(axes)
    commands[:axes, n : n + axes] = lost * np.eye(axes)
    whole = np.zeros((size, size + axes))
    whole[:n, :n] = own
    whole[:n] += b_new @ commands[delay * axes : (delay + 1) * axes] + b_old @ commands[(delay + 1) * axes :]
    whole[n:] = commands[: (delay + 1) * axes]
    force, reading = np.zeros((size, axes)), np.zeros((axes, size))
    force[:n], reading[:, :n] = b_force, readings
    acting = delay + 1 if fraction else delay  # the command whose value the coil has at a sample
    flowing = current[:, n + axes :] @ commands[acting * axes : (acting + 1) * axes]
    flowing[:, :n] += current[:, :n]
    return OpenLoop(
        whole[:, :size], whole[:, size:], force, reading, flowing[:, :size], flowing[:, size:], dt
    )  # fmt: skip


def balanced(plant: OpenLoop) -> OpenLoop:
    """The same plant with states in units of like size, as equations ask for that rounding could spoil."""
    n, k = len(plant.a), plant.command.shape[1]
    size = 1 / max(np.abs(plant.reading).max(), np.finfo(float).tiny)
    whole = np.zeros((n + k, n + k))
    whole[:n, :n], whole[:n, n:], whole[n:, :n] = plant.a, plant.command, plant.reading * size
    scale = scipy.linalg.matrix_balance(whole, permute=False, separate=True)[1][0]
    scale = scale[:n] / scale[n]
    return replace(
        plant,
        a=plant.a * scale / scale[:, None],
        command=plant.command / scale[:, None],
        force=plant.force / scale[:, None],
        reading=plant.reading * scale,
        current=plant.current * scale,
    )
