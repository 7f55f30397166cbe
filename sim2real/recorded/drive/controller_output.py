"""What was added to a recorded command, and what the reference adds, by the controllers' own recursion from rest."""

from dataclasses import replace

import numpy as np

from maglev_env.loop.gains import Controller, controller_output, digital
from maglev_env.loop.linear_controller import LinearController


def recovered_injection(
    controller: Controller,
    command: np.ndarray,
    displacement: np.ndarray,
    dt: float,
    reference: np.ndarray | None = None,
    current: np.ndarray | None = None,
) -> np.ndarray:
    """What was added to a controller's output, (samples,): the command less what the controller makes of its inputs.

    A limit acts on the controller's output, so the result is exact on the limit too.

    Args:
        controller: of this axis; it starts at rest.
        command: in A, after the converter.
        displacement: what the controller read, m.
        dt: control step, s.
        reference: m; None: 0, then the result contains what the controller makes of it.
        current: what the controller read, A; needed if it reads the current.
    """
    return command - controller_output(controller, displacement, dt, reference, current)


def referred(controller: Controller, reference: np.ndarray, dt: float) -> np.ndarray:
    """The part of a controller's output that the reference causes, (samples,), without a limit."""
    own = digital(controller, dt)
    free = replace(own, limit=None) if isinstance(own, LinearController) else own
    return controller_output(free, np.zeros_like(reference), dt, reference)
