"""A recording: labelled channels in SI units against time, checked on reading; the same for measured and simulated."""

import json
from collections.abc import Collection, Mapping
from dataclasses import asdict, replace
from importlib import metadata
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from maglev_env.channels import MEASURED, SHOWN_BY, unit_of
from maglev_env.experiment import Experiment, channels_of, recorded_channels, sampling, self_sensors
from maglev_env.loop.axes import suffixes
from maglev_env.loop.gains import as_table
from maglev_env.loop.magnets.kinds import geometric_law
from maglev_env.recordings.alarms.alarm import alarms_text
from maglev_env.recordings.alarms.clock import clock_alarms
from maglev_env.recordings.alarms.rail import touched_rail
from maglev_env.recordings.alarms.rules import find_alarms
from maglev_env.recordings.alarms.stuck import stuck_columns
from maglev_env.recordings.campaign import Campaign, ChannelSource, RecordingSpec
from maglev_env.recordings.derived import displacements, induced_left_out
from maglev_env.recordings.excited import check_excited
from maglev_env.recordings.files import Columns
from maglev_env.recordings.formats.time_stamps import Clock, check_clock, unwrapped
from maglev_env.recordings.left_out import TellsNothing
from maglev_env.recordings.masking import MOST_MASKED
from maglev_env.recordings.measurement_chain import corrected, coupled
from maglev_env.recordings.missing_readings import garbled_stamps, without_missing
from maglev_env.recordings.stamped_late import regular_stamps
from maglev_env.rig.excitation import Excitation, Place, lines_at
from maglev_env.rig.rig import axis_rig

if TYPE_CHECKING:
    import xarray as xr

STAMPED = "the time stamps jitter, but the readings do not: they are taken as those of a regular clock"


def read_recording(
    campaign: Campaign,
    spec: RecordingSpec,
    alarmed: bool = False,
    unexcited: bool = False,
    unjudged: Collection[str] = (),
) -> "xr.Dataset":
    """Read a recording: one float64 variable per channel in SI (attribute `units`) over `time` (s, from 0).

    Attributes of the dataset are file, role, sample_rate (Hz), resampled (whether it stands at other times than in the
    file), notes (what was decided about the file and its clock, in words), alarms (see `alarms.alarms_of`), and
    experiment, a JSON object with the gains or controller, excitations, speed_rpm, intersample, the number of whole
    periods, and the rig's name where known. Samples after the last whole period are kept. Jittered time stamps are
    resampled at the stated rate.

    A resampled recording also has what was read at its own time stamps, as the controller saw it, as coordinates over
    `tick`: `tick_time` (s) and `tick_displacement`, ...; not where samples are missing or double, or a channel is
    corrected for a filter or delay.

    Where samples were clipped, or missing and bridged, the dataset has a boolean coordinate `masked` over time
    (`masking.masked_samples` gives it for any recording); clipped channels keep their readings there. They are at most
    MOST_MASKED of all; more is refused.

    Args:
        campaign: The campaign.
        spec: One of its recordings.
        alarmed: Whether a recording with an alarm that refuses it is given all the same, for showing.
        unexcited: Whether one whose force lacks stated lines is.
        unjudged: Channels in which no rule looks for clipped, stuck or repeated readings, since the caller does.

    Raises:
        TellsNothing: An alarm refuses the recording, or what should move does not.
        ValueError: Something is wrong; the message names the file, the channel and the sample (from 0 in the file).
        OSError: The file cannot be read.
    """
    path, rate = campaign.folder / spec.file, spec.sample_rate
    columns = campaign.files.columns(path, spec.layout)
    raw = _raw_columns(columns, spec)
    window = _window(path, spec, next(iter(raw.values())).size)
    of_time = spec.channels["time"].columns if "time" in spec.channels else ()
    for name in of_time:
        raw[name] = unwrapped(raw[name])
        raw[name] = np.where(garbled_stamps(raw[name]), np.nan, raw[name])
    raw, masked, alarms = without_missing(raw, window, rate)
    combined = {name: _combine(raw, source)[window] for name, source in spec.channels.items()}
    for name, values in combined.items():
        if not np.isfinite(values).all():  # products and sums of finite values may be larger than any number
            at = spec.start + int(np.argmin(np.isfinite(values)))
            raise ValueError(f"{path}: channel {name!r}: sample {at} is not a finite number; is its scale right?")
    time = combined.pop("time", np.zeros(0))
    judged = {name: values for name, values in combined.items() if name not in unjudged}
    try:
        clock = check_clock(time, rate)
        if clock.instants is not None and (regular := regular_stamps(time, _readings(judged))) is not None:
            clock = check_clock(regular, rate)
            clock = replace(clock, notes=(STAMPED, *clock.notes))
    except ValueError as error:
        raise ValueError(f"{path}: channel 'time': {error}") from None
    alarms += clock_alarms(clock, rate, spec.start)
    one_axis = campaign.rig if campaign.rig is not None and campaign.rig.axes == 1 else None
    periodic = any(e.periodic for e in spec.excitations)
    for name, values in judged.items():
        if name.partition("_")[0] not in MEASURED or not np.ptp(values):
            continue
        wanted = combined.get(name.replace("displacement", "reference")) if name.startswith("displacement") else None
        for column in spec.channels[name].columns:  # a mean of several probes would hide the clipping of one
            read = raw[column][window]
            alarm, at = touched_rail(name, column, read, values, rate, spec.start, one_axis, periodic, wanted)
            if alarm:
                alarms.append(alarm)
                # A command at a limit is what acted; a reading there hides what was.
                masked |= at & (alarm.severity == "warning" and not name.startswith("command"))
    channels = {}
    for name, values in combined.items():
        source = spec.channels[name]
        held = _held(campaign, spec) if name.partition("_")[0] == "current" else None
        channels[name] = coupled(clock.resampled(values), rate, source.high_pass)
        channels[name] = corrected(channels[name], rate, source.filter, source.delay, held)
        if source.total:
            channels[name] = channels[name] - _bias(campaign, path, name)
    stand_ins, stood_in = displacements(channels, rate)
    channels |= stand_ins
    masked = clock.marked(masked)
    rig = {} if campaign.rig is None else {"rig": campaign.rig.name}
    experiment = {
        "gains": spec.gains and as_table(spec.gains),
        "speed_rpm": spec.speed_rpm,
        "intersample": spec.intersample,
        **rig,
    }
    dataset = _dataset(channels, rate, spec.file, spec.role, spec.excitations, experiment)
    for name in stand_ins:
        dataset[name].attrs["integrated"] = 1
    dataset = dataset.assign_coords(_ticks(campaign, spec, combined, clock))
    looked_at = dataset if clock.rows is None else dataset.assign_coords(row=("time", clock.rows))
    looked_at = looked_at.drop_vars([*unjudged], errors="ignore")
    summed = [
        (name, column, clock.resampled(spec.channels[name].scale * raw[column][window]))
        for name in combined
        if name not in unjudged
        for column, weight in zip(spec.channels[name].columns, spec.channels[name].weights, strict=True)
        if weight and len(spec.channels[name].columns) > 1
    ]
    alarms = [*find_alarms(looked_at, spec.start, one_axis), *stuck_columns(looked_at, summed, spec.start), *alarms]
    alarms = sorted(alarms, key=lambda a: (a.severity != "refuse", a.code != "lost levitation"))
    dataset.attrs["resampled"] = clock.instants is not None
    simulated = spec.gains is not None and not periodic
    induced = induced_left_out(campaign.rig, spec.channels, simulated)
    dataset.attrs["notes"] = [*columns.notes, *clock.notes, *stood_in, *induced]
    dataset.attrs["alarms"] = alarms_text(alarms)
    if masked.any() and masked.mean() <= MOST_MASKED:
        dataset = dataset.assign_coords(masked=("time", masked))
        dataset.attrs["notes"].append(f"{masked.mean():.2%} of the samples are masked: clipped or missing")
    for alarm in alarms:
        if alarm.severity == "refuse":
            if alarmed:
                return dataset
            reason, _, instead = alarm.sentence.rpartition("; ")  # its last part says how to cut or mend it
            raise TellsNothing(reason or alarm.sentence, instead if reason else "record it again", path, alarm)
    for name, values in channels.items():
        _check_moves(path, name, values, spec)
    try:
        if not unexcited:
            check_excited(dataset, spec)
    except ValueError as error:
        raise ValueError(f"{path}: {error}") from None
    return dataset


def simulated_recording(experiment: Experiment, record: np.ndarray) -> "xr.Dataset":
    """The recording of one lane of `simulate_records`, record (channels, samples), with its transient periods.

    It has the channels of `experiment.channels_of`, and the exact injection and reference where the experiment applies
    them. With self-sensing, displacement is the reading of an ideal reference probe, and gap_estimate is what the loop
    uses. The experiment attribute also names the effects, offset, seed, transient_periods and version.

    Raises:
        ValueError: The record does not fit the experiment, or the rotor touched down.
    """
    rig, rate = experiment.rig, experiment.recorded_rate
    names = channels_of(rig, recorded_channels(experiment))
    periods = experiment.periods + experiment.transient_periods
    expected = (len(names), periods * experiment.recorded_per_period)
    if record.shape != expected:
        raise ValueError(f"record has the shape {record.shape}, but its experiment makes {expected}")
    if not np.isfinite(record).all():
        at = int(np.argmin(np.isfinite(record).all(axis=0)))
        raise ValueError(f"the simulated rotor touched down at {at / rate:g} s (sample {at}); there is no recording")
    channels = dict(zip(names, record, strict=True))
    if experiment.sensor != "probe":
        for sensor, end in zip(self_sensors(experiment), suffixes(rig.axes), strict=True):
            read = (channels[f"displacement{end}"] - sensor.shift) / sensor.scale
            channels[f"gap_estimate{end}"] = sensor.gap - read
            channels[f"displacement{end}"] = channels.pop(f"position{end}")
    if not rig.controlled:  # there is no command and no current
        channels = {name: values for name, values in channels.items() if unit_of(name) != "A"}
    multiple, every = sampling(rate, rig.control_rate)
    offsets: dict[Place, float] = {"current": 0.0, "reference": experiment.offset}
    for place, offset in offsets.items():
        if lines_at(experiment.excitations, place).size or offset:
            waves = np.atleast_2d(experiment.waveform(place))
            waves[0] += offset
            for name, wave in zip(channels_of(rig, [SHOWN_BY[place]]), waves, strict=True):
                channels[name] = np.tile(np.repeat(wave, multiple)[::every], periods)
    made = {
        "gains": as_table(experiment.gains) if rig.controlled else None,
        "speed_rpm": experiment.speed_rpm,
        "intersample": "zoh",
        "rig": experiment.rig.name,
        "effects": {name: dict(values) for name, values in experiment.effects.items()},
        "offset": experiment.offset,
        "seed": experiment.seed,
        "transient_periods": experiment.transient_periods,
        "sensor": "probe" if experiment.sensor == "probe" else "self_sensing",
        "version": metadata.version("maglev-workbench"),
    }
    return _dataset(channels, rate, "simulated", "fit", experiment.excitations, made)


def _readings(channels: Mapping[str, np.ndarray]) -> list[np.ndarray]:
    """What moves of the channels that are read from the rotor and its coil."""
    return [v for name, v in channels.items() if name.partition("_")[0] in MEASURED and np.ptp(v)]


def _dataset(
    channels: Mapping[str, np.ndarray],
    rate: float,
    file: str,
    role: str,
    excitations: tuple[Excitation, ...],
    experiment: Mapping[str, Any],
) -> "xr.Dataset":
    import xarray as xr

    samples = next(iter(channels.values())).size
    periodic = [e for e in excitations if e.periodic]
    periods = samples // periodic[0].block(rate)[0] if periodic else None
    made = {"excitations": [asdict(e) for e in excitations], "periods": periods, **experiment}
    variables = {
        name: ("time", np.array(values, dtype=np.float64), {"units": unit_of(name)})
        for name, values in channels.items()
    }
    time = ("time", np.arange(samples) / rate, {"units": "s"})
    attributes = {"file": file, "role": role, "sample_rate": float(rate), "experiment": json.dumps(made)}
    return xr.Dataset(variables, {"time": time}, attributes)


def _ticks(
    campaign: Campaign, spec: RecordingSpec, combined: Mapping[str, np.ndarray], clock: Clock
) -> dict[str, tuple[str, np.ndarray]]:
    """Coordinates of a recording at its own time stamps."""
    if clock.instants is None or clock.gaps or clock.repeated or clock.backward is not None:
        return {}
    found = {"tick_time": ("tick", clock.instants / spec.sample_rate)}
    for name, values in combined.items():
        source = spec.channels[name]
        if not source.chained:
            bias = _bias(campaign, campaign.folder / spec.file, name) if source.total else 0.0
            found[f"tick_{name}"] = ("tick", values - bias)
    return found


def _raw_columns(columns: Columns, spec: RecordingSpec) -> dict[str, np.ndarray]:
    raw: dict[str, np.ndarray] = {}
    for channel, source in spec.channels.items():
        for name in source.columns:
            try:
                raw[name] = raw[name] if name in raw else columns.column(name)
            except ValueError as error:
                raise ValueError(f"{error} (channel {channel!r})") from error
            first = next(iter(raw))
            if raw[name].size != raw[first].size:
                raise ValueError(
                    f"{columns.path}: channel {channel!r}: column {name!r} has {raw[name].size} samples, column "
                    f"{first!r} {raw[first].size}; all channels of a recording must be equally long"
                )
    return raw


def _combine(raw: Mapping[str, np.ndarray], source: ChannelSource) -> np.ndarray:
    with np.errstate(over="ignore", invalid="ignore"):  # the result is checked
        weighted = [w * raw[column] for w, column in zip(source.weights, source.columns, strict=True)]
        read = sum(weighted[1:], weighted[0])
        value = source.scale * (
            read if source.polynomial is None else np.polynomial.Polynomial(source.polynomial)(read)
        )
        return value + source.offset if source.offset else value  # adding 0 would change the bits of -0.0


def _held(campaign: Campaign, spec: RecordingSpec) -> float | None:
    """Time constant (s) with which the current follows a command held from sample to sample; None where that is not
    what is known: no controller, another rate, or no lag."""
    rig = campaign.rig
    if rig is None or spec.gains is None or not np.isclose(spec.sample_rate, rig.control_rate, rtol=1e-6):
        return None
    return rig.amplifier_time_constant or None


def _bias(campaign: Campaign, path: Path, name: str) -> float:
    """Bias current (A) of the rig along the channel's axis, or the voltage (V) that holds it; a total has it in it."""
    if campaign.rig is None or not campaign.rig.controlled:
        raise ValueError(
            f"{path}: channel {name!r}: total = true needs a named rig with a magnet, whose bias it includes"
        )
    rig = axis_rig(campaign.rig, int(name.endswith("_y")))
    current = geometric_law(rig).bias_current
    return current * rig.coil_resistance if name.startswith("voltage") else current


def _window(path: Path, spec: RecordingSpec, total: int) -> slice:
    stop = total if spec.samples is None else spec.start + spec.samples
    if spec.start >= total or stop > total:
        wanted = "" if spec.samples is None else f" and samples = {spec.samples}"
        periods = "" if spec.periods is None else f" ({spec.periods} periods of {spec.samples_per_period})"
        raise ValueError(f"{path}: start = {spec.start}{wanted}{periods} go beyond the file's {total} samples")
    per_period = spec.samples_per_period
    if per_period and stop - spec.start < 2 * per_period:
        raise ValueError(
            f"{path}: {stop - spec.start} samples from sample {spec.start} on hold "
            f"{(stop - spec.start) / per_period:.2f} periods of {per_period}; at least two whole periods are needed"
        )
    return slice(spec.start, stop)


def _check_moves(path: Path, name: str, values: np.ndarray, spec: RecordingSpec) -> None:
    along = {"_x": 0, "_y": 1}.get(name[-2:])
    driven = any(
        e.at == "force" and e.kind != "none" and (along is None or e.components[along]) for e in spec.excitations
    )
    kind = name.partition("_")[0]
    if (kind == "displacement" or (kind == "force" and driven)) and values.min() == values.max():
        raise TellsNothing(f"channel {name!r} is {values[0]:g} in every sample", "is the sensor connected?", path)
