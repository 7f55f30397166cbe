"""The longest stretch of a recording that a gap refuses: no level is to be told of what was bridged."""

from dataclasses import replace
from typing import TYPE_CHECKING

from maglev_env.recordings.alarms.alarm import alarms_of
from maglev_env.recordings.campaign import Campaign, RecordingSpec
from maglev_env.recordings.recording import read_recording

if TYPE_CHECKING:
    import xarray as xr


def without_gaps(campaign: Campaign, spec: RecordingSpec, dataset: "xr.Dataset") -> tuple[RecordingSpec, "xr.Dataset"]:
    """A recording, or its longest stretch where so many samples are missing that it is refused.

    Args:
        campaign: The campaign.
        spec: One of its recordings.
        dataset: What `read_recording` made of it.

    Returns:
        What is read, and its dataset; those given where nothing refuses it for a gap, or the stretch is too short.
    """
    refused = (a for a in alarms_of(dataset) if a.code == "samples" and a.severity == "refuse" and a.stretch)
    alarm = next(refused, None)
    if alarm is None or alarm.stretch is None:
        return spec, dataset
    cut = replace(spec, start=alarm.stretch[0], samples=alarm.stretch[1], periods=None)
    try:
        return cut, read_recording(campaign, cut, alarmed=True, unexcited=True)
    except ValueError:  # fewer than two periods
        return spec, dataset
