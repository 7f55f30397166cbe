"""The controller's rows of a lane, which are the only ones that change with the gains."""

import numpy as np

from maglev_env.experiment import Experiment
from maglev_env.kernel.layout import AXIS, filter_size
from maglev_env.kernel.structure import Structure
from maglev_env.loop.controller import DECAY_D, DECAY_I, KD, KI, KP
from maglev_env.loop.gains import Controllers, Gains, digital, of_axis
from maglev_env.loop.linear_controller import LinearController
from maglev_lanes.layout import row

PID_ROWS = [row(offset) for offset in (KP, KD, KI, DECAY_D, DECAY_I)]


def pid_constants(gains: Gains, dt: float) -> tuple[float, ...]:
    """Values of PID_ROWS at a control step of dt (s)."""
    return gains.kp, gains.kd / gains.td, gains.ki, float(np.exp(-dt / gains.td)), float(np.exp(-dt / gains.ti))


def controller_kind(controllers: Controllers, dt: float) -> tuple[int, bool]:
    """What of the controllers of all axes is compiled: their highest order, 0 of PID gains, and `Structure.of_error`.

    Raises:
        ValueError: One axis has PID gains and the other one another controller.
    """
    found = [digital(one, dt) for one in (controllers if isinstance(controllers, tuple) else (controllers,))]
    filters = [one for one in found if isinstance(one, LinearController)]
    if 0 < len(filters) < len(found):
        raise ValueError("experiment: give both axes PID gains, or both a linear controller or a form")
    order = max((max(1, one.order) for one in filters), default=0)
    return order, all(one.of_error for one in filters)


def filter_constants(controller: LinearController, order: int, of_error: bool) -> np.ndarray:
    """Rows of a linear controller.

    Of a filter of the error: b0, then (b, a, state) for each power of 1 / z. Of one with several inputs: see
    `maglev_env.loop.controller.HEAD`.
    """

    def padded(polynomial: np.ndarray) -> np.ndarray:
        return np.concatenate([polynomial, np.zeros(order - controller.order)])

    a = padded(np.array(controller.denominator))
    reference, reading, current = map(padded, controller.numerators)
    if of_error:
        return np.concatenate([reading[:1], np.array([reading[1:], a[1:], 0 * a[1:]]).T.reshape(-1)])
    low, high = controller.limit or (-np.inf, np.inf)
    powers = np.array([reference, reading, current, a, padded(controller.cut), 0 * a])[:, 1:]
    return np.concatenate([[reference[0], reading[0], current[0], low, high, 0, 0, 0, 0], powers.T.reshape(-1)])


def filter_rows(controller: LinearController, s: Structure) -> np.ndarray:
    """All rows of an axis' linear controller in lanes of a structure."""
    values = filter_constants(controller, s.controller_order, s.of_error)
    return np.concatenate([values, np.zeros(row(filter_size(s.controller_order, s.of_error)) - values.size)])


def with_controllers(rows: np.ndarray, s: Structure, controllers: Controllers, experiment: Experiment) -> np.ndarray:
    """A copy of the rows of lanes with other controllers of the same `controller_kind`.

    Args:
        rows: of a `LaneBatch`, shape (rows, lanes); not changed.
        s: the structure of the lanes.
        controllers: the new controllers, for all lanes.
        experiment: that of one of the lanes.
    """
    rows, dt = rows.copy(), 1 / experiment.rig.control_rate
    for axis in range(s.axes):
        own, first = digital(of_axis(controllers, axis), dt), axis * row(AXIS)
        if isinstance(own, Gains):
            rows[[first + at for at in PID_ROWS]] = np.array(pid_constants(own, dt))[:, None]
        else:
            values = filter_rows(own, s)
            start = s.axes * row(AXIS) + axis * values.size
            rows[start : start + values.size] = values[:, None]
    return rows
