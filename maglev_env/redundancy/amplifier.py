"""The recorded current against what the nominal amplifier makes of the recorded command."""

import numpy as np

from maglev_env.redundancy.controller import at_control_rate
from maglev_env.redundancy.rows import Row, fit, low_pass
from maglev_env.redundancy.view import View

GAIN = 0.1  # of an amplifier and its current sensor
LAG = 0.1  # relative standard deviation of the amplifier's time constant where the rig states no tolerance
WIDE = 4.0  # standard deviations of a tolerance that count as possible
SHAPE = 0.1
DELAY = 0.3  # of a sample
EFFECTS = ("delay", "amplifier_lag", "amplifier_voltage_limit")


def amplified(view: View) -> list[Row]:
    """Gain and delay from the command to the current.

    Eddy currents and all that follows act behind the current, so no effect of the library changes the gain at low
    frequency; its delay and its roll-off are those of `delay`, `amplifier_lag` and `amplifier_voltage_limit`.
    """
    if view.rig is None or not view.rig.controlled or not {"command", "current"} <= view.recorded:
        return []
    if not view.periodic and not at_control_rate(view):
        return []
    lines = view.lines
    source = view.nominal(lines.frequency).amplifier * lines.parts["command"]
    found = fit(lines.parts["current"], [source], lines.frequency, view.rate, lines.periodic)
    if found is None:
        return []
    t = view.rig.amplifier_time_constant
    slack = WIDE * view.rig.tolerance.get("amplifier_time_constant", LAG) * t
    # What the tolerance of the pole does to the amplitude at the highest lines counts as misfit as well.
    top = 2 * np.pi * float(lines.frequency.max()) * t
    shape = SHAPE + WIDE * LAG * top**2 / (1 + top**2)
    lag = 0.0
    if found.misfit > shape:
        lag, _ = low_pass(lines.parts["current"], source, lines.frequency, view.rate, lines.periodic, found.misfit)
    return [
        Row("amplifier", {"current": 1, "command": -1}, float(found.gain[0]), float(found.gain_se[0]), GAIN,
            "the command through the nominal amplifier", float(found.delay[0]), float(found.delay_se[0]),
            slack + DELAY / view.rate, found.misfit, shape, (), EFFECTS, lag)
    ]  # fmt: skip
