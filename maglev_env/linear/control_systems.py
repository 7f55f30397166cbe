"""The linearised sampled loop as systems of python-control."""

from types import ModuleType
from typing import TYPE_CHECKING

import numpy as np
import scipy

from maglev_env.experiment import Experiment
from maglev_env.linear.open_loop import open_loop
from maglev_env.linear.poles import closed_loop
from maglev_env.loop.gains import of_axis, reads_current, state_space

if TYPE_CHECKING:
    import control

Matrices = tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]


def to_control(experiment: Experiment) -> "tuple[control.StateSpace, control.StateSpace, control.StateSpace]":
    """Plant, controller and closed loop of an experiment for python-control, sampled at the control rate.

    They have one input and one output each, or two (x, y) on an x-y rig. The loop gain is controller * plant; feedback
    is negative. Effects enter with their linear part, delays and lost samples included.

    Args:
        experiment: with rig, effects, sensor and gains; its excitations are not used.

    Returns:
        plant: from the command (A) to the displacement reading (m).
        controller: from the negative reading (m) to the command (A).
        closed: from the force (N), held over each sample, to the reading (m).

    Raises:
        ValueError: The controller reads the coil's current, so that there is no single loop to break.
        ImportError: python-control is not installed.
    """
    control = python_control()
    systems = linear_systems(experiment)
    if "controller" not in systems:
        raise ValueError("to_control: the controller reads the current; use loop_response, which closes that loop")
    plant, controller, closed = (control.ss(*systems[name], 1 / experiment.rig.control_rate) for name in systems)
    return plant, controller, closed


def linear_systems(experiment: Experiment) -> dict[str, Matrices]:
    """A, B, C and D of "plant", "controller" and "closed" as `to_control` describes them, in this order.

    Where the controller reads the coil's current, there is no single loop to break, and only "closed" is given.

    Args:
        experiment: with rig, effects, sensor and gains; its excitations are not used.
    """
    dt, axes = 1 / experiment.rig.control_rate, experiment.rig.axes
    none = np.zeros((axes, axes))
    closed = (*closed_loop(experiment), none)
    if reads_current(experiment.gains, dt):
        return {"closed": closed}
    parts = [state_space(of_axis(experiment.gains, axis), dt) for axis in range(axes)]
    a, b, c = (scipy.linalg.block_diag(*blocks) for blocks in (
        [p[0] for p in parts], [p[1][:, None] for p in parts], [p[2][None] for p in parts],
    ))  # fmt: skip
    controller = (a, b, c, np.diag([p[3] for p in parts]))
    plant = open_loop(experiment)
    return {"plant": (plant.a, plant.command, plant.reading, none), "controller": controller, "closed": closed}


def python_control() -> ModuleType:
    """The module `control`.

    Raises:
        ImportError: It is not installed; the message says what to install.
    """
    try:
        import control
    except ImportError:
        raise ImportError('python-control is not installed: pip install "maglev-workbench[bench]"') from None
    return control
