"""From a campaign's recording to the arrays that identification and checks work on."""

from typing import TYPE_CHECKING

import numpy as np

from maglev_env.campaign import Campaign, RecordingSpec
from maglev_env.identify import RecordedSignals

if TYPE_CHECKING:
    import xarray as xr


def recorded_signals(campaign: Campaign, spec: RecordingSpec, dataset: "xr.Dataset") -> RecordedSignals:
    """One axis of a recording as arrays. ValueError when it is not periodic or has no displacement or force.

    A force is taken as held by a converter (`intersample = "zoh"`) when the campaign says so.
    """
    where = campaign.folder / spec.file
    if spec.samples_per_period is None:
        raise ValueError(f"{where}: no periodic excitation is stated; stiffness and damping need one")
    channels = {str(name): dataset[name].values for name in dataset.data_vars}
    injected = [e for e in spec.excitations if e.periodic and e.at == "current"]
    if injected and "injection" not in channels:
        # A stated Schroeder injection is digital: its design is what was injected.
        one = sum(e.waveform(spec.sample_rate) for e in injected)
        channels["injection"] = np.resize(one, dataset.sizes["time"])
    return RecordedSignals(channels, spec.sample_rate, spec.excitations, spec.intersample == "zoh", spec.gains)
