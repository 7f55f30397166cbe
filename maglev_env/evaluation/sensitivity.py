"""The loop's sensitivity from lines that are injected at the current."""

from collections.abc import Sequence

import numpy as np

from estimation.lines.frequency_response import frequency_response
from estimation.lines.periods import LineStatistics
from maglev_env.loop.gains import Controller, controller_response, reads_current


def injected_sensitivity(
    lines: LineStatistics, controllers: Sequence[Controller], control_rate: float | None
) -> tuple[np.ndarray, np.ndarray]:
    """Sensitivity S of one axis, from an error of the reading to the reading, and its variance.

    Without a current that the controller reads, S is the response command / injection. With one, that response belongs
    to the loop broken at the command; S is then 1 - C displacement / injection, with C from the negative reading to the
    command, which needs no model of the amplifier.

    Args:
        lines: injected lines with command, displacement and injection; (..., n), first axis: experiments.
        controllers: of each experiment, or one for all.
        control_rate: Hz; None: not known, then the response command / injection is returned.
    """
    if control_rate is None or not any(reads_current(one, 1 / control_rate) for one in controllers):
        return frequency_response(lines, "command", "injection")
    z = np.exp(2j * np.pi * lines.frequency / control_rate)
    control = np.array([controller_response(one, z, 1 / control_rate) for one in controllers])
    control = control[0] if len(control) == 1 else control
    moved, variance = frequency_response(lines, "displacement", "injection")
    return 1 - control * moved, np.abs(control) ** 2 * variance
