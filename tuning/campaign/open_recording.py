"""Responses of the loop from a recording without a period: what drove it follows from command, reading and gains."""

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from maglev_env.loop.gains import Gains
from maglev_env.recordings.spectra import RecordedSignals
from maglev_env.rig.excitation import Excitation
from maglev_env.rig.rig import Rig
from sim2real.recorded.drive.controller_output import recovered_injection

if TYPE_CHECKING:
    import xarray as xr


def with_injection(signals: RecordedSignals, dataset: "xr.Dataset", rig: Rig, gains: Gains) -> RecordedSignals | str:
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
