"""The controller's rows of a lane, which are the only ones that change with the gains."""

import numpy as np

from maglev_env.experiment import Experiment
from maglev_env.kernel.layout import AXIS, filter_size
from maglev_env.kernel.structure import Structure
from maglev_env.loop.controller import DECAY_D, DECAY_I, KD, KI, KP
from maglev_env.loop.gains import Controllers, Gains, LinearController, numerator_of, of_axis
from maglev_lanes.layout import row

PID_ROWS = [row(offset) for offset in (KP, KD, KI, DECAY_D, DECAY_I)]


def pid_constants(gains: Gains, dt: float) -> tuple[float, ...]:
    """Values of PID_ROWS at a control step of dt (s)."""
    return gains.kp, gains.kd / gains.td, gains.ki, float(np.exp(-dt / gains.td)), float(np.exp(-dt / gains.ti))


def filter_constants(controller: LinearController, order: int) -> np.ndarray:
    """b0, then (b, a, state) for each power of 1 / z."""
    pad = np.zeros(order - controller.order)
    b = np.concatenate([numerator_of(controller), pad])
    a = np.concatenate([controller.denominator, pad])
    return np.concatenate([b[:1], np.array([b[1:], a[1:], 0 * a[1:]]).T.reshape(-1)])


def with_controllers(rows: np.ndarray, s: Structure, controllers: Controllers, experiment: Experiment) -> np.ndarray:
    """A copy of the rows of lanes with other controllers of the same kind and order, for lanes without substeps.

    Args:
        rows: of a `LaneBatch`, shape (rows, lanes); not changed.
        s: the structure of the lanes.
        controllers: the new controllers, for all lanes.
        experiment: that of one of the lanes.
    """
    rows, dt = rows.copy(), 1 / experiment.rig.control_rate
    for axis in range(s.axes):
        gains, first = of_axis(controllers, axis), axis * row(AXIS)
        if isinstance(gains, Gains):
            rows[[first + at for at in PID_ROWS]] = np.array(pid_constants(gains, dt))[:, None]
        else:
            values = filter_constants(gains, s.controller_order)
            start = s.axes * row(AXIS) + axis * row(filter_size(s.controller_order))
            rows[start : start + values.size] = values[:, None]
    return rows
