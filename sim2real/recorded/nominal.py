"""The linear responses of the nominal loop's blocks, at which recordings are opened."""

import numpy as np

from maglev_env.experiment import Experiment, axis_experiment
from maglev_env.linear.loop import loop_response
from maglev_env.loop.gains import controller_response, of_axis


def nominal_blocks(e: Experiment, frequency: np.ndarray, with_current: bool) -> np.ndarray:
    """The nominal responses of `Opened` in its order, (7, axes, n); with_current: whether the current is recorded."""
    dt, found = 1 / e.rig.control_rate, []
    z = np.exp(2j * np.pi * frequency * dt)
    for axis in range(e.rig.axes):
        r, own = loop_response(axis_experiment(e, axis), frequency), of_axis(e.gains, axis)
        control = r.controller, r.from_reference, 0 * r.controller, r.from_injection
        if with_current:
            inputs = (controller_response(own, z, dt, of) for of in ("reading", "reference", "current"))
            control = *inputs, np.ones_like(r.controller)
        found.append((control[0], r.amplifier, r.plant, r.receptance / r.sensitivity, *control[1:]))
    return np.array(found).transpose(1, 0, 2)


def outputs_of(with_current: bool, e: Experiment) -> tuple[str, ...]:
    """Outputs that a record gives; with_current: whether the current is recorded."""
    return ("plant", "amplifier") if with_current and e.rig.controlled else ("plant",)
