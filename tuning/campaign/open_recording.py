"""A recording without a period: what drove it follows from command, reading and gains; whether that tells enough."""

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
import scipy

from estimation.stability_margins import margins
from maglev_env.loop.gains import PidGains
from maglev_env.recordings.spectra import RecordedSignals
from maglev_env.rig.excitation import Excitation
from maglev_env.rig.rig import Rig
from sim2real.recorded.drive.controller_output import recovered_injection
from tuning.campaign.gain_set import DRAWS, GainSet, Response, failed_set
from tuning.campaign.lines_shown import LEAST_LINES, identified

if TYPE_CHECKING:
    import xarray as xr

LEVEL_SD = 3.92  # width of a 95 % interval in standard deviations
KNOWN, SMOOTH = 0.3, 9  # relative noise of lines that are used, and lines over which it is looked at
MOST_DOUBT = 2.0  # times the peak sensitivity that single lines may leave possible


def open_set(signals: RecordedSignals, dataset: "xr.Dataset", rig: Rig, gains: PidGains, file: str) -> GainSet:
    """What a recording without a period shows, or why it does not tell the margins; as `with_injection`."""
    nothing = replace(failed_set(gains, file, ""), failed=None, open=True)
    driven = with_injection(signals, dataset, rig, gains)
    if isinstance(driven, str):
        return replace(nothing, untold=driven)
    try:
        found = identified(driven, rig, gains, file)
    except ValueError as error:
        return replace(nothing, untold=str(error))
    curves = {name: _known(getattr(found, name)) for name in ("sensitivity", "plant")}
    return replace(found, **curves, untold=_untold(curves["sensitivity"]), open=True)


def with_injection(signals: RecordedSignals, dataset: "xr.Dataset", rig: Rig, gains: PidGains) -> RecordedSignals | str:
    """The recording with all that was added to its command as a recorded injection, or why that is not known.

    What a reference made the controller add is part of it. It holds no noise of the sensor, so the responses of
    command and displacement to it are not biased by what the loop feeds back.

    Args:
        signals: at the control rate, where it can be had.
        dataset: as it was read.
        rig: nominal.
        gains: under which it was recorded.
    """
    if any(e.kind == "recorded" for e in signals.excitations):
        return signals
    if not np.isclose(signals.sample_rate, rig.control_rate) or dataset.attrs.get("resampled"):
        return f"it is not recorded at the {rig.control_rate:g} Hz of the controller"
    if "command" not in signals.channels:
        return "its command is not recorded"
    read = {name: signals.channels[name] for name in ("command", "displacement")}
    added = recovered_injection(gains, dt=1 / rig.control_rate, **read)
    if not np.ptp(added):
        return "nothing drives it"
    channels = {name: values for name, values in signals.channels.items() if name != "reference"}
    excitation = Excitation("recorded", "current")
    return replace(signals, channels={**channels, "injection": added - added.mean()}, excitations=(excitation,))


def _known(curve: Response | None) -> Response | None:
    """The widest band of a response in which noise leaves something of its lines; None where there is none."""
    if curve is None:
        return None
    doubt = np.sqrt(curve.variance) / np.abs(curve.value)
    told = np.concatenate([[False], scipy.ndimage.median_filter(doubt, SMOOTH, mode="nearest") < KNOWN, [False]])
    edges = np.flatnonzero(np.diff(told.astype(int))).reshape(-1, 2)
    if not edges.size:
        return None
    first, last = max(edges, key=lambda e: np.log(curve.frequency[e[1] - 1] / curve.frequency[e[0]]))
    band = slice(first, last)
    return Response(curve.frequency[band], curve.value[band], curve.variance[band])


def _untold(s: Response | None) -> str | None:
    """Why a sensitivity does not bound its peak, or None."""
    if s is None or s.value.size < LEAST_LINES:
        return "what drives it is no more than the noise"
    found = margins(s.frequency, s.value, s.variance, DRAWS)
    if found.intervals["peak_sensitivity"][1] is None:
        return found.reasons.get("peak_sensitivity", "its peak sensitivity is not bounded")
    worst = float(np.max(np.abs(s.value) + LEVEL_SD / 2 * np.sqrt(s.variance / 2)))
    if worst > MOST_DOUBT * found.peak_sensitivity:
        return f"single lines leave a peak sensitivity of up to {worst:.3g}, {MOST_DOUBT:g} times the one seen"
    return found.reasons.get("peak_sensitivity")
