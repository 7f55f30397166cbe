"""From a campaign's recording to the arrays that identification and checks use."""

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from maglev_env.experiment import sampling
from maglev_env.loop.axes import AXES
from maglev_env.recordings.alarms.alarm import alarms_of
from maglev_env.recordings.campaign import Campaign, RecordingSpec
from maglev_env.recordings.left_out import TellsNothing
from maglev_env.recordings.masking import bridged, masked_periods, masked_samples
from maglev_env.recordings.measurement_chain import lagless
from maglev_env.recordings.spectra import RecordedSignals, axis_signals
from maglev_env.rig.excitation import Excitation

if TYPE_CHECKING:
    import xarray as xr


def recorded_signals(
    campaign: Campaign, spec: RecordingSpec, dataset: "xr.Dataset", excited: bool = True
) -> RecordedSignals:
    """A recording as arrays: of two axes when it has the displacement of x and of y, otherwise of one.

    Masked samples are bridged by straight lines; spectra leave out the periods that hold them, where enough others
    remain.

    Where the campaign does not state the force between samples, a designed force on a named rig, recorded at a multiple
    or fraction of its control rate, is taken as held by its converter, as the nominal rig is defined; any other force
    is taken as continuous.

    Args:
        campaign: to which it belongs.
        spec: the recording, as the campaign states it.
        dataset: its channels, of `read_recording`.
        excited: whether a recording that nothing excites is refused.

    Raises:
        TellsNothing: Nothing is excited.
        ValueError: The rates of a held force do not fit.
    """
    where = campaign.folder / spec.name
    if excited and all(e.kind == "none" for e in spec.excitations):
        raise TellsNothing("no excitation is stated", "stiffness and damping need one", where)
    masked = masked_samples(dataset)
    channels = {str(name): bridged(dataset[name].values, masked) for name in dataset.data_vars}
    lettered = [axis for axis, name in enumerate(AXES) if f"displacement_{name}" in channels]
    if campaign.rig is not None and campaign.rig.axes == 2 and not lettered:
        raise ValueError(f"{where}: rig {campaign.rig.name} has two axes; name the channels displacement_x, ... or _y")
    assumed = _stand_in(campaign, channels, spec, lettered)
    hold_rate, why = _hold(campaign, spec)
    left_out, respected = _masked(spec, masked)
    notes = (*dataset.attrs.get("notes", ()), *respected, *assumed, *why)
    signals = RecordedSignals(
        channels,
        spec.sample_rate,
        spec.excitations,
        hold_rate,
        spec.gains,
        notes,
        max(1, len(lettered)),
        left_out=left_out,
        masked=masked if masked.any() else None,
        railed=frozenset(a.channel for a in alarms_of(dataset) if a.code == "rail"),
    )
    if len(lettered) == 1:
        if not any(e.direction for e in spec.excitations):  # without a stated direction, the force acts along the axis
            along = tuple(replace(e, direction=90.0 * lettered[0]) for e in spec.excitations)
            signals = replace(signals, excitations=along)
        return axis_signals(replace(signals, axes=2), lettered[0])
    return signals


def _masked(spec: RecordingSpec, masked: np.ndarray) -> tuple[tuple[int, ...], list[str]]:
    """The periods that spectra leave out because they hold masked samples, and what is said of it."""
    if not masked.any():
        return (), []
    left_out = masked_periods(masked, spec.samples_per_period) if spec.samples_per_period else ()
    if left_out:
        shown = ", ".join(str(p) for p in left_out)
        return left_out, [f"periods {shown} (from 0) hold masked samples: spectra leave them out"]
    return (), ["masked samples are bridged by straight lines: too few periods are free of them"]


def _designed(campaign: Campaign, spec: RecordingSpec, excitation: Excitation) -> np.ndarray:
    """One period as the controller of a named rig generates it, at the rate of the recording."""
    excitation = excitation.on_grid(spec.sample_rate)
    if campaign.rig is None:
        return excitation.waveform(spec.sample_rate)
    try:
        multiple, every = sampling(spec.sample_rate, campaign.rig.control_rate)
    except ValueError:
        return excitation.waveform(spec.sample_rate)
    return np.repeat(excitation.waveform(campaign.rig.control_rate), multiple)[::every]


def _stand_in(
    campaign: Campaign, channels: dict[str, np.ndarray], spec: RecordingSpec, lettered: list[int]
) -> list[str]:
    """Fill in the injection channels of a designed sequence; returns what was assumed."""
    injected = [e for e in spec.excitations if e.periodic and e.at == "current"]
    turned = any(e.direction for e in spec.excitations)
    samples = next(iter(channels.values())).size
    done = []
    for axis in lettered or [0]:
        name = f"injection_{AXES[axis]}" if lettered else "injection"
        share = [1.0 if len(lettered) == 1 and not turned else e.components[axis] for e in injected]
        if any(share) and name not in channels:
            # A stated Schroeder injection is digital, so its design is what was injected.
            one = sum(c * _designed(campaign, spec, e) for c, e in zip(share, injected, strict=True))
            channels[name] = np.resize(one, samples)
            done.append(f"no {name} channel: the designed sequence, a period starting at the first sample, stands in")
    return done


def _hold(campaign: Campaign, spec: RecordingSpec) -> tuple[float | None, list[str]]:
    """Rate (Hz) at which the force, or without one the current, is held (None: continuous), and what was assumed."""
    at_force = [e for e in spec.excitations if e.at == "force" and e.kind != "none"]
    designed = any(e.periodic for e in at_force)
    rate = spec.sample_rate
    if campaign.rig is not None:
        try:
            sampling(rate, campaign.rig.control_rate)
            rate = max(rate, campaign.rig.control_rate)
        except ValueError as error:
            if spec.intersample == "zoh":
                raise ValueError(f"{campaign.folder / spec.name}: {error}; the held force needs that") from None
            designed = False
    if spec.intersample == "zoh":
        return rate, []
    if spec.intersample == "bl":
        return None, []
    if not at_force:
        stepped = campaign.rig is not None and campaign.rig.controlled and lagless(campaign.rig)
        stepped &= spec.samples_per_period is not None  # else the current drives a simulation, in straight lines
        why = 'intersample is not stated: the amplifier is stated to have no lag: its current is taken as held ("zoh")'
        return (rate, [why]) if stepped else (None, [])
    if campaign.rig is not None and designed:
        return rate, ['intersample is not stated: on a named rig a designed force is taken as held ("zoh")']
    half = 0.5 / spec.sample_rate
    return None, [
        f'intersample is not stated: the force is taken as continuous ("bl"); held by a converter ("zoh") it would '
        f"act {half:.3g} s later, and the damping be smaller by {half:.3g} s times the stiffness"
    ]
