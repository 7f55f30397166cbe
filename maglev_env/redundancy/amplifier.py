"""The recorded current against what the nominal amplifier makes of the recorded command."""

from dataclasses import replace

import numpy as np

from maglev_env.loop.gains import reads_current
from maglev_env.redundancy.controller import at_control_rate
from maglev_env.redundancy.rows import Fit, Row, fit, low_pass
from maglev_env.redundancy.view import Lines, View

GAIN = 0.1  # of an amplifier and its current sensor
LAG = 0.1  # relative standard deviation of the amplifier's time constant where the rig states no tolerance
WIDE = 4.0  # standard deviations of a tolerance that count as possible
SHAPE = 0.1
POINTS = 17  # time constants that are tried
ALLOWED = 16.0  # rise of the cost within which a time constant is possible: four standard deviations
DELAY = 0.3  # of a sample
EFFECTS = ("delay", "amplifier_lag", "amplifier_voltage_limit")


def amplified(view: View) -> list[Row]:
    """Gain and delay from the command to the current.

    Eddy currents and all that follows act behind the current; delay and roll-off are those of `delay`, `amplifier_lag`
    and `amplifier_voltage_limit`. A dead band of the command makes the current smaller; so does a limit of the voltage,
    which bends it too, as no scale does. No effect of the library makes the current larger, and none makes it early.
    """
    if view.rig is None or not view.rig.controlled or not {"command", "current"} <= view.recorded:
        return []
    if not view.periodic and not at_control_rate(view):
        return []
    lines = _driven(view)
    if lines is None:
        return []
    nominal = view.nominal(lines.frequency).amplifier
    found = _within(view, lines, nominal, WIDE * view.rig.tolerance.get("amplifier_time_constant", LAG))
    if found is None:
        return []
    lag = 0.0
    if found.misfit > SHAPE:
        source = nominal * lines.parts["command"]
        lag, _ = low_pass(lines.parts["current"], source, lines.frequency, view.rate, lines.periodic, found.misfit)
    cut: tuple[str, ...] = ()
    if found.gain[0] < 1:
        cut = ("deadband", "amplifier_voltage_limit") if found.misfit > SHAPE else ("deadband",)
    return [
        Row("amplifier", {"current": 1, "command": -1}, float(found.gain[0]), float(found.gain_se[0]), GAIN,
            "the command through the nominal amplifier", float(found.delay[0]), float(found.delay_se[0]),
            DELAY / view.rate, found.misfit, SHAPE, cut, EFFECTS if found.delay[0] > -DELAY / view.rate else (), lag)
    ]  # fmt: skip


def _driven(view: View) -> Lines | None:
    """The lines; of a record without a period whose controller reads the current, what the injection or the reference
    drives of them.

    Such a controller feeds the noise of the current back into the command, so that both have it in common.
    """
    lines = view.lines
    if lines.periodic or view.gains is None or not reads_current(view.gains, 1 / view.rig.control_rate):
        return lines
    drives = [name for name in ("injection", "reference") if name in lines.parts and np.ptp(view.channels[name]) > 0]
    if not drives:
        return None
    parts = {name: spectra * lines.parts[drives[0]].conj() for name, spectra in lines.parts.items()}
    return replace(lines, parts=parts, periodic=True)  # means over the segments are compared


def _within(view: View, lines: Lines, nominal: np.ndarray, share: float) -> Fit | None:
    """Of the fits with a time constant within its tolerance that the lines allow, the nearest to gain 1 and delay 0."""
    t = view.rig.amplifier_time_constant
    w = 2j * np.pi * lines.frequency
    fits = []
    for change in np.linspace(-min(share, 0.9), share, POINTS) if t else [0.0]:
        source = nominal * (1 + w * t) / (1 + w * t * (1 + change)) * lines.parts["command"]
        one = fit(lines.parts["current"], [source], lines.frequency, view.rate, lines.periodic)
        if one is not None:
            fits.append(one)
    if not fits:
        return None
    least = min(f.cost for f in fits)
    allowed = [f for f in fits if f.cost <= least + ALLOWED * max(1.0, least / lines.frequency.size)]
    return min(allowed, key=lambda f: abs(np.log(abs(f.gain[0]))) / GAIN + abs(f.delay[0]) * view.rate / DELAY)
