"""Read a recording without a period for comparison: what drives it, which part and which windows are compared."""

from collections.abc import Mapping
from dataclasses import replace
from math import sqrt
from typing import TYPE_CHECKING

import numpy as np

from maglev_env.channels import MEASURED
from maglev_env.kernel.blocks import prepared
from maglev_env.kernel.driven import Drive as Run
from maglev_env.kernel.replay import replayed
from maglev_env.loop.axes import suffixes
from maglev_env.loop.gains import limited
from maglev_env.recordings.campaign import Campaign, RecordingSpec
from maglev_env.recordings.campaign_tables import ChannelSource
from maglev_env.recordings.left_out import TellsNothing
from maglev_env.recordings.masking import bridged, masked_samples
from maglev_env.rig.rig import Rig
from sim2real.recorded.along_motion import Motion, along_motion
from sim2real.recorded.at_rest.static_evidence import can_rest, rests_of
from sim2real.recorded.at_rest.weight_law import balancing, lacking_in_words
from sim2real.recorded.channel_errors import ChannelError, channel_errors, scale_of
from sim2real.recorded.current_by_voltage import CurrentByVoltage, current_by_voltage, driven_by_voltage
from sim2real.recorded.drive.blows import between_blows
from sim2real.recorded.drive.drive import Drive, Driving, drive_of
from sim2real.recorded.drive.fed_back import fed_back
from sim2real.recorded.drive.innovation import along_innovations
from sim2real.recorded.drive.instrument import along_instruments
from sim2real.recorded.drive.log_filter import WITHIN, corner_of_log, in_words, smoothing
from sim2real.recorded.not_stable import not_stable
from sim2real.recorded.open_record import OpenRecord, compared
from sim2real.recorded.static_load import load_in_words, static_load
from sim2real.recorded.ticks import between_ticks, led_in, substeps, ticks_of
from sim2real.recorded.unstated_controller import unstated_controller

if TYPE_CHECKING:
    import xarray as xr

AT_TICKS = "the controller is simulated at its own jittered ticks; nothing is resampled"
NOT_AT_TICKS = (
    "the stated controller is not used: the recording is resampled, and what it read at its own ticks is not known "
    "(missing or double samples, a channel with a filter or delay, or another rate)"
)
# Standard deviations of what is not stated of a stand-in's drive: the time between its readings and those of the
# displacement, in samples, and along an instrument the terms of order 2, 3, 4 of what undoes a low-pass and fills in
# between samples, in samples to that power: as of a filter of a sample behind an amplifier that lags by one (computed,
# with the images of a held command). Up to TOP of the sample rate these leave 0.3 % of it.
UNTOLD, UNTOLD_ALONG = 12**-0.5, 1.0
SHAPED = {2: 1.0, 3: 0.1, 4: 0.03}
STRAIGHT = {2: 1 / 12}  # without an instrument: what a straight line lacks of a bent current between two samples
TOP = 0.2
# Share of a command that the stated controller does not make, from which on another one made it, and from which on it
# is asked what was added where nobody recorded that.
NOT_MADE, ADDED = 0.05, 0.02
PASSES = 2  # of the simulation that tells how the rotor moves between samples
NOTHING_FREE = "nothing in it is free of the noise that its unknown controller fed back into"
OFF_BALANCE = (
    "an offset of the current or of the displacement, the weight, or the force law; the motion does not tell which, "
    "and the means are no evidence before {asked}"
)
STATED, BY_VOLTAGE, RECORDED = (
    "the campaign states offset_tolerance of displacement and current",
    "the campaign states offset_tolerance of displacement and voltage",
    "the current is recorded, and the campaign states offset_tolerance of displacement and current",
)
METERED = 0.01  # relative scale of a current whose campaign states none, as of a meter that nobody calibrated


def open_record(campaign: Campaign, spec: RecordingSpec, dataset: "xr.Dataset") -> OpenRecord:
    """A recording that does not repeat.

    Args:
        campaign: that names its rig.
        spec: the recording.
        dataset: its channels.

    Raises:
        TellsNothing: nothing can be compared with it.
        ValueError: a comparison with it lacks something; the message says what.
    """
    where, rig = campaign.folder / spec.name, campaign.rig
    if rig is None:
        raise ValueError(f"{where}: the campaign names no rig to compare with")
    rests = rests_of(rig, spec, dataset)
    channels = _channels(rig, dataset)
    notes = list(dataset.attrs.get("notes", ()))
    if "displacement" not in channels:
        raise ValueError(f"{where}: the channel displacement is missing; nothing is known of the rotor without it")
    if "force" in channels:
        channels["force"], said = between_blows(channels["force"], rig.noise.force)
        notes += [said] if said else []
    by_voltage = current_by_voltage(rig, channels, spec.sample_rate)
    if by_voltage is not None:
        channels["current"] = by_voltage.current
        notes.append(by_voltage.note)
    try:
        # The current under a measured voltage is a better drive than what the nominal amplifier makes of a stated
        # controller: it has what the motion induces, and every limit.
        under_voltage = driven_by_voltage(rig, channels)
        unstated = spec.gains is None and unstated_controller(rig, channels, spec.sample_rate)
        drive = drive_of(rig, spec, channels, known=not (under_voltage or unstated), smooth=under_voltage)
        if not drive.stand_in and (wrong := not_stable(drive.experiment)):
            # The recorded loop held the rotor: what the magnets did is in their current, whatever made it. A command
            # goes through the amplifier, which may be what is stated wrong.
            if not rig.controlled or "current" not in channels:
                raise TellsNothing(wrong, "correct it, or record the current in the coil")
            drive = drive_of(rig, spec, channels, known=False)
            drive = replace(drive, notes=(f"{wrong}; it is not used", *drive.notes))
        other = None if dataset.attrs.get("resampled") else _other_controller(rig, drive, spec, channels)
        if other is not None:
            drive = drive_of(rig, spec, channels, known=False)
            drive = replace(drive, notes=(other, *drive.notes))
        notes += _added_unrecorded(rig, drive, spec, channels)
        ticks = instants = None
        if dataset.attrs.get("resampled") and drive.source == "command" and not drive.stand_in:
            # The controller is exact at its own ticks alone; where these are not known, another stands in for it.
            if drive.multiple == 1 and spec.gains is not None:
                ticks = ticks_of(dataset, spec.gains, rig.axes, spec.sample_rate)
            if ticks is None:
                drive = drive_of(rig, spec, channels, known=False)
                drive = replace(drive, notes=(NOT_AT_TICKS, *drive.notes))
        if dataset.attrs.get("resampled") and drive.stand_in and drive.source == "command" and drive.held:
            ticks = ticks_of(dataset, None, rig.axes, spec.sample_rate)
        if ticks is not None:
            channels, instants = dict(ticks.channels), ticks.simulated
            drive = replace(drive, notes=(*drive.notes, AT_TICKS))
        channels = {kind: values[:, :: drive.multiple] for kind, values in channels.items()}
        source, lacks = drive.source, None
        if source is not None and can_rest(rig):
            added = balancing(rig, channels[source], channels["displacement"])
            channels[source] = channels[source] + added
            lacks = added if rests is None else None
            if lacks is not None and (said := lacking_in_words(rig, source, lacks)) is not None:
                asked = STATED if "current" in spec.channels else RECORDED if by_voltage is None else BY_VOLTAGE
                notes.append(f"{said}: {OFF_BALANCE.format(asked=asked)}")
        waves = drive.driving(channels, instants).waves
        known = np.concatenate([w[:, :: drive.every] for w in waves.values()])
        if not np.ptp(known, axis=1).any():
            raise TellsNothing(
                "nothing that is known drives this recording: all of it is constant",
                "record set-point steps, a chirp or an injected multisine",
            )
        rate, among = spec.sample_rate / drive.multiple, len(campaign.recordings)
        stretch = compared(drive.experiment, rate, known, channels["displacement"], among)
    except TellsNothing:
        raise  # the caller, who reads all recordings, adds the name of the file
    except ValueError as error:
        raise ValueError(f"{where}: {error}") from None
    # The simulation begins here with a controller at rest: what it held before is part of what drove the loop.
    lead = stretch.settling if drive.stand_in else 0
    channels = {kind: _led_in(values[:, stretch.samples], lead) for kind, values in channels.items()}
    instants = None if instants is None else led_in(instants[stretch.samples], lead)
    driving = _as_simulated(drive, channels, instants)
    # A command that nobody recorded follows from the readings, except for what the controller held before.
    pulling = channels[source] if source is not None else driving.command
    if source is None and can_rest(rig):
        pulling = pulling + balancing(rig, pulling, channels["displacement"])
    motion = Motion(pulling, channels["displacement"], drive.held, drive.every)
    pulled = replace(motion, driving=channels["current"], held=False) if "current" in channels else motion
    load = static_load(drive.experiment, pulled, driving.waves["force"].mean(axis=1))
    along = along_motion(drive.experiment, motion)
    looked = slice(stretch.settling + lead, stretch.settling + lead + stretch.windows.samples)
    shown = ("displacement",) if drive.source == "current" else ("displacement", "current")
    record = OpenRecord(
        spec.name,
        spec.role,
        rig,
        drive.experiment,
        driving.waves,
        {kind: channels[kind] for kind in shown if kind in channels},
        driving.command,
        driving.added,
        stretch.settling + lead,
        stretch.windows,
        drive.every,
        drive.upstream,
        _of_channels(spec, by_voltage),
        source,
        rests,
        lacks=lacks,
        load=load,
        along=along and along.at(looked),
        instants=None if instants is None else between_ticks(instants, drive.every),
        notes=(*notes, *drive.notes, *stretch.notes, *load_in_words(load, spec.name)),
    )
    if not drive.stand_in or drive.source is None:
        return record
    read = drive.source if by_voltage is None else "voltage"  # the recorded channel of which something may be stated
    stated = _stated(spec, read)
    corner = None if drive.held else corner_of_log(record, channels)
    top = np.inf if drive.held else min(TOP * record.windows.sample_rate, WITHIN * (corner or np.inf))
    found, what = along_instruments(record, channels, top), "with the recorded reference, injection or force"
    if found is None and not any(source.filter or source.delay for source in stated):
        found = along_innovations(record, channels, top)
        what = f"with what its own past and the displacement's leave unexplained of the {drive.source}"
    errors = (*record.errors, *_untold(spec, drive, found is not None, by_voltage))
    if found is not None:
        note = f"only what goes {what} is compared, because it is free of the noise that the controller fed back"
        notes = (*record.notes, note, *in_words(corner, top, TOP * record.windows.sample_rate))
        smoothed = {} if drive.held else smoothing(record, SHAPED, corner)
        return replace(found, errors=errors, smoothed=smoothed, notes=notes)
    smoothed = {} if drive.held else smoothing(record, STRAIGHT, corner)
    record = fed_back(
        replace(record, errors=errors, smoothed=smoothed),
        channels[drive.source],
        drive.between(record.windows.frequency),
    )
    if drive.source == "command" and record.slower_than_controller:
        # What was fed back above the log's rate is folded into it, and no regression finds where it came from.
        raise TellsNothing(
            f"{NOTHING_FREE} the command, which is logged more slowly than the controller makes it",
            "record the reference or the injection, the current in the coil, or the command at the control rate",
        )
    if drive.source == "current" and all(source.delay_tolerance is None for source in stated):
        raise TellsNothing(
            f"{NOTHING_FREE} the current",
            "record the reference, the injection, or the command with the gains of the controller; or state filter and "
            f"delay_tolerance of the {read}",
        )
    return record


def _as_simulated(drive: Drive, channels: Mapping[str, np.ndarray], instants: np.ndarray | None) -> Driving:
    """What drives a simulation, with the displacement between its samples moving as the nominal rig's does.

    A stand-in that runs several times between two samples would answer to what a smooth curve lacks there.
    """
    driving = drive.driving(channels, instants)
    if drive.every == 1 or drive.source is None:
        return driving
    e = drive.experiment
    between = None if instants is None else between_ticks(instants, drive.every)
    lanes = prepared([e], substeps(instants, drive.every))
    for _ in range(PASSES):
        ((moved, *_),) = replayed(lanes, [Run(e, driving.waves, between)])[0]
        if not np.isfinite(moved).all():
            break
        driving = drive.driving(channels, instants, moved)
    return driving


def _other_controller(rig: Rig, drive: Drive, spec: RecordingSpec, channels: Mapping[str, np.ndarray]) -> str | None:
    """What is said of a command that the stated controller does not make of what drives it, all of which is recorded.

    What it makes otherwise would count as an injection, and drive the simulated loop.
    """
    recorded = [e.kind == "recorded" and (e.at != "current" or "injection" in channels) for e in spec.excitations]
    if not recorded or not all(recorded) or (share := _not_made(rig, drive, channels)) < NOT_MADE:
        return None
    return (
        f"{spec.name}: the stated controller is not the one that made the command: {100 * share:.0f} % of it does not "
        "follow from the recorded displacement and what drives the loop; it is not used. Check form, gains, td, limits "
        "and the sign"
    )


def _not_made(rig: Rig, drive: Drive, channels: Mapping[str, np.ndarray]) -> float:
    """Share of the command that the stated controller does not make, beside what its converter rounds off; 0 where no
    command is compared with it, or a limit acts."""
    if drive.stand_in or drive.source != "command":
        return 0.0
    if limited(drive.experiment.gains, 1 / drive.experiment.rig.control_rate):
        return 0.0
    return drive.not_made(channels, rig.command_step / sqrt(12))


def _added_unrecorded(rig: Rig, drive: Drive, spec: RecordingSpec, channels: Mapping[str, np.ndarray]) -> list[str]:
    """A note on what a command holds beside what the stated controller makes of displacement and moving reference: it
    was added, or another controller made it."""
    moves = "reference" in channels and np.ptp(channels["reference"], axis=1).all()
    if "injection" in channels or not moves or (share := _not_made(rig, drive, channels)) < ADDED:
        return []
    return [
        f"{spec.name}: {100 * share:.0f} % of the command does not follow from the recorded displacement and reference "
        "under the stated controller; it is taken for something that was added to the command: if nothing was, check "
        "form, gains, td and limits (of the integrator, too)"
    ]


def _channels(rig: Rig, dataset: "xr.Dataset") -> dict[str, np.ndarray]:
    """Channel -> (axes, samples), with masked samples bridged."""
    names, masked = suffixes(rig.axes), masked_samples(dataset)
    return {
        kind: np.array([bridged(dataset[kind + s].values, masked) for s in names])
        for kind in (*MEASURED, "injection", "reference", "voltage")
        if all(kind + s in dataset for s in names)
    }


def _led_in(series: np.ndarray, samples: int) -> np.ndarray:
    """Series (axes, n) after a smooth rise from zero, (axes, samples + n): the simulated rotor starts at the centre."""
    rise = 0.5 - 0.5 * np.cos(np.pi * np.arange(samples) / max(samples, 1))
    return np.concatenate([series[:, :1] * rise, series], axis=1)


def _stated(spec: RecordingSpec, channel: str) -> list[ChannelSource]:
    """What the campaign states of a channel, of each axis."""
    return [source for name, source in spec.channels.items() if name.partition("_")[0] == channel]


def _of_channels(spec: RecordingSpec, by_voltage: CurrentByVoltage | None) -> tuple[ChannelError, ...]:
    """The errors that a campaign states; those of a voltage from which the current is computed are the current's."""
    found = channel_errors(spec)
    if by_voltage is None:
        return found
    return tuple(replace(e, channel="current") if e.channel == "voltage" else e for e in found)


def _untold(spec: RecordingSpec, drive: Drive, exact: bool, by_voltage: CurrentByVoltage | None) -> list[ChannelError]:
    """Errors of a stand-in's drive of which nothing is stated: the time between its readings and those of the
    displacement, the scale of a current, and what it does between its samples, where it is not held.

    Args:
        exact: whether only what goes with an instrument is compared.
        by_voltage: the current, where it is computed from the coil's voltage; None: it is recorded.
    """
    if not drive.stand_in or drive.source is None:
        return []
    step, found = drive.multiple / spec.sample_rate, []
    names = suffixes(drive.experiment.rig.axes)
    read = drive.source if by_voltage is None else "voltage"
    for axis, letter in enumerate(names):
        driving, stated = drive.source + letter, spec.channels.get(read + letter)
        if stated is None or stated.delay_tolerance is None:
            late = (UNTOLD_ALONG if exact else UNTOLD) * step
            name = f"time between {driving} and displacement"
            found.append(ChannelError(name, drive.source, axis, delay=late, read=read))
        if by_voltage is not None:
            found += by_voltage.errors[axis]
        elif drive.source == "current" and not (stated and stated.scale_tolerance):
            found.append(ChannelError(scale_of(driving), drive.source, axis, scale=METERED))
        shaped = {} if drive.held else SHAPED if exact else STRAIGHT
        for order, size in shaped.items():
            name = f"{driving} between its samples (order {order})"
            found.append(ChannelError(name, drive.source, axis, shape=size * step**order, order=order))
    return found
