"""Stability margins of one recording: from an injection, or by the nominal actuator within its tolerance."""

from dataclasses import dataclass, replace

import numpy as np

from estimation.iso_14839 import iso_14839_3_zone
from estimation.lines.frequency_response import POOL, frequency_response, loop_variance
from estimation.lines.periods import zero_order_hold
from estimation.normal import NORMAL_95
from estimation.stability_margins import Interval, Margins, margin_arrays, margins
from maglev_env.evaluation.bands import nominal_response
from maglev_env.evaluation.sensitivity import injected_sensitivity
from maglev_env.loop.gains import NO_CONTROLLER, Controllers, of_axis, reads_current
from maglev_env.recordings.spectra import RecordedSignals, RecordSpectra
from maglev_env.rig.drawn import TANGENT, scaled_rig
from maglev_env.rig.rig import Rig

ASSUMED = "no injection at the current: margins assume the nominal actuator and controller"
LEAST = 4  # lines that margins can be read from


@dataclass(frozen=True)
class Stability:
    """Margins with intervals; source is "injection" (measured) or "assumes the nominal actuator"."""

    source: str
    margins: Margins
    iso_14839_3_zone: str
    frequency: np.ndarray
    sensitivity: np.ndarray
    variance: np.ndarray


def stability_of(
    signals: RecordedSignals, spectra: RecordSpectra, rig: Rig | None
) -> tuple[Stability | None, str | None]:
    """The margins that a recording shows, and what limits them; None and why where it shows none.

    Args:
        signals: The recording, of one axis.
        spectra: Its lines.
        rig: Nominal rig of that axis; its `tolerance` widens the margins that assume its actuator.
    """
    statistics, force, injected = spectra.all, spectra.force, spectra.driven["current"]
    forced = force.lines.size >= LEAST and "force" in statistics.channels
    if injected.size >= LEAST and {"command", "injection"} <= signals.channels.keys():
        loop, control_rate = statistics.at_lines(injected), rig and rig.control_rate
        s, variance = injected_sensitivity(loop, (of_axis(signals.gains or NO_CONTROLLER, 0),), control_rate)
        source, why = "injection", None
        if control_rate is None and signals.gains is not None and reads_current(signals.gains, 1.0):
            why = "the controller reads the current: without a rig the margins hold at the command, not the reading"
    elif rig is not None and rig.controlled and signals.gains is not None and forced:
        measured = statistics.at_lines(force.lines)
        receptance, noise = frequency_response(measured, "displacement", "force")
        held = bool(signals.hold_rate)
        feedback = _feedback(rig, signals.gains, force.frequency, held)
        s, variance = 1 - feedback * receptance, np.abs(feedback) ** 2 * noise
        loop, source = force, "assumes the nominal actuator"
        why = ASSUMED
        if rig.tolerance:
            why += f", within the rig's tolerance of {', '.join(sorted(rig.tolerance))}"
    else:
        known = rig is not None and rig.controlled and signals.gains is not None
        lacks = "no excited force that is recorded, beside the nominal controller" if known else "no nominal controller"
        return None, f"no injection at the current and {lacks}: nothing can be said of the loop's margins"
    variance = loop_variance(loop.frequency, s, variance)
    # The variance of a line is the mean over its neighbours of scatters over the periods.
    found = margins(loop.frequency, s, variance, freedom=2 * POOL * (loop.periods - 1))
    if source != "injection" and rig is not None and signals.gains is not None:
        found = _within_tolerance(found, loop.frequency, receptance, rig, signals.gains, held)
    zone3 = iso_14839_3_zone(found.peak_sensitivity)
    return Stability(source, found, zone3, loop.frequency, s, variance), why


def _feedback(rig: Rig, gains: Controllers, frequency: np.ndarray, held: bool) -> np.ndarray:
    """Force of the nominal controller and actuator per displacement reading, N/m, at frequencies (n,) in Hz.

    Args:
        rig: The nominal rig.
        gains: Its controller.
        frequency: (n,), Hz.
        held: Whether the measured force is held over control steps; else it is a continuous one.
    """
    nominal = nominal_response(rig, gains, frequency)
    hold = 1.0 if held else zero_order_hold(frequency / rig.control_rate)
    return nominal.controller * nominal.plant * nominal.sensitivity / nominal.receptance * hold


def _within_tolerance(
    found: Margins, frequency: np.ndarray, receptance: np.ndarray, rig: Rig, gains: Controllers, held: bool
) -> Margins:
    """Margins whose intervals hold also where the nominal parameters are off by their tolerances."""
    before = margin_arrays(frequency, 1 - _feedback(rig, gains, frequency, held) * receptance)
    spread = dict.fromkeys(found.intervals, 0.0)
    for name, tolerance in rig.tolerance.items():
        if getattr(rig, name) is None and name not in TANGENT:
            continue  # the rig has none of it
        other = scaled_rig(rig, {name: 1 + tolerance})
        after = margin_arrays(frequency, 1 - _feedback(other, gains, frequency, held) * receptance)
        for margin in spread:
            moved = float(np.log(after[margin] / before[margin]))
            spread[margin] = float(np.hypot(spread[margin], NORMAL_95 * moved if np.isfinite(moved) else 0.0))

    def wider(name: str) -> Interval:
        value, (low, high) = getattr(found, name), found.intervals[name]
        if value is None:
            return low, high
        return (
            low and float(value * np.exp(-np.hypot(np.log(value / low), spread[name]))),
            high and float(value * np.exp(np.hypot(np.log(high / value), spread[name]))),
        )

    widened = {name: wider(name) for name in found.intervals}
    if widened:
        low, high = widened["peak_sensitivity"]
        least, most = found.intervals["peak_sensitivity"][0], widened["phase_margin"][1]
        # No tolerance moves a peak below 1, nor a phase margin beyond half a turn.
        widened["peak_sensitivity"] = (low and max(low, min(least or 1.0, 1.0)), high)
        widened["phase_margin"] = (widened["phase_margin"][0], most and min(most, 180.0))
    return replace(found, intervals=widened)
