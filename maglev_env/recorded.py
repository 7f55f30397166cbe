"""From a campaign's recording to the arrays that identification and checks work on."""

from typing import TYPE_CHECKING

import numpy as np

from maglev_env.campaign import Campaign, RecordingSpec
from maglev_env.identification import RecordedSignals

if TYPE_CHECKING:
    import xarray as xr


def recorded_signals(campaign: Campaign, spec: RecordingSpec, dataset: "xr.Dataset") -> RecordedSignals:
    """One axis of a recording as arrays. ValueError when it is not periodic or has no displacement or force.

    Where the campaign does not say how the force behaves between samples, a designed force recorded at the control
    rate of a named rig is taken as held by its converter, as the nominal rig is defined; any other as continuous.
    """
    where = campaign.folder / spec.file
    if spec.samples_per_period is None:
        raise ValueError(f"{where}: no periodic excitation is stated; stiffness and damping need one")
    channels = {str(name): dataset[name].values for name in dataset.data_vars}
    assumed = []
    injected = [e for e in spec.excitations if e.periodic and e.at == "current"]
    if injected and "injection" not in channels:
        # A stated Schroeder injection is digital: its design is what was injected.
        one = sum(e.waveform(spec.sample_rate) for e in injected)
        channels["injection"] = np.resize(one, dataset.sizes["time"])
        assumed.append("no injection channel: the designed sequence, a period starting at the first sample, stands in")
    held = spec.intersample == "zoh"
    if spec.intersample is None and campaign.rig is not None and spec.sample_rate == campaign.rig.control_rate:
        held = any(e.periodic and e.at == "force" for e in spec.excitations)
        if held:
            assumed.append('intersample is not stated: at the control rate the force is taken as held ("zoh")')
    if spec.intersample is None and not held:
        half = 0.5 / spec.sample_rate
        assumed.append(
            f'intersample is not stated: the force is taken as continuous ("bl"); held by a converter ("zoh") it would '
            f"act {half:.3g} s later, and the damping be smaller by {half:.3g} s times the stiffness"
        )
    return RecordedSignals(channels, spec.sample_rate, spec.excitations, held, spec.gains, tuple(assumed))
