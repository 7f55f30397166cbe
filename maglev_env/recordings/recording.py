"""A recording: labelled channels in SI units against time, checked on reading; the same for measured and simulated."""

import json
from collections.abc import Mapping
from dataclasses import asdict
from importlib import metadata
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from estimation.periods import period_spectra, split_periods
from maglev_env.channels import MEASURED, SHOWN_BY, unit_of
from maglev_env.experiment import Experiment, channels_of, recorded_channels, sampling, self_sensors
from maglev_env.loop.axes import AXES, suffixes
from maglev_env.loop.gains import as_table
from maglev_env.recordings.campaign import Campaign, ChannelSource, RecordingSpec
from maglev_env.recordings.files import Columns, read_columns
from maglev_env.rig.excitation import Excitation, Place, lines_at

if TYPE_CHECKING:
    import xarray as xr

MEAN_RATE_TOLERANCE = 1e-4
STEP_TOLERANCE = 0.01
# A clipped channel stays at its extreme value and passes the values next to it quickly. A quantised sine also stays at
# its top level, but at most 2.4 times as long as at the next one.
CLIPPED_SHARE, CLIPPED_RUN, CLIPPED_RATIO = 1e-3, 4, 6
LINE_SIGNIFICANCE, LINE_FLOOR = 3.0, 1e-6


def read_recording(campaign: Campaign, spec: RecordingSpec) -> "xr.Dataset":
    """Read a recording: one float64 variable per channel in SI (attribute `units`) over `time` (s, from 0).

    Attributes of the dataset are file, role, sample_rate (Hz), and experiment, a JSON object with the gains or
    controller, excitations, speed_rpm, intersample, the number of whole periods, and the rig's name where known.
    Samples after the last whole period are kept.

    Raises:
        ValueError: Something is wrong; the message names the file, the channel and the sample (from 0 in the file).
        OSError: The file cannot be read.
    """
    path = campaign.folder / spec.file
    columns = read_columns(path)
    raw = _raw_columns(columns, spec)
    window = _window(path, spec, next(iter(raw.values())).size)
    channels = {}
    for name, source in spec.channels.items():
        values = _combine(raw, source)[window]
        finite = np.isfinite(values)
        if not finite.all():
            at = spec.start + int(np.argmin(finite))
            raise ValueError(
                f"{path}: channel {name!r}: sample {at} is {values[at - spec.start]}, not a finite number; "
                "mend it, or use `start` and `samples` to leave it out"
            )
        if name == "time":
            _check_time(path, values, spec)
            continue
        channels[name] = values
        _check_moves(path, name, values, spec)
        if name.partition("_")[0] in MEASURED:
            for column in source.columns:  # a mean of several probes would hide the clipping of one
                _check_clipping(f"{path}: channel {name!r} (column {column!r})", raw[column][window], spec.start)
    rig = {} if campaign.rig is None else {"rig": campaign.rig.name}
    experiment = {
        "gains": spec.gains and as_table(spec.gains),
        "speed_rpm": spec.speed_rpm,
        "intersample": spec.intersample,
        **rig,
    }
    dataset = _dataset(channels, spec.sample_rate, spec.file, spec.role, spec.excitations, experiment)
    try:
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


def check_excited(dataset: "xr.Dataset", spec: RecordingSpec) -> None:
    """Check that the force channel carries every line that a periodic force excitation states.

    A line counts when its mean amplitude over periods exceeds 3 standard deviations of that mean, and 1e-6 of the
    strongest line. Nothing is checked without such an excitation or its channel.

    Raises:
        ValueError: A line is missing.
    """
    for excitation in spec.excitations:
        if excitation.periodic and excitation.at == "force":
            name, forces = _force_along(dataset, excitation)
            if forces is not None:
                per_period = excitation.samples_per_period(spec.sample_rate)
                _check_lines(name, forces, np.array(excitation.lines), per_period, spec.sample_rate / per_period)


def _force_along(dataset: "xr.Dataset", excitation: Excitation) -> tuple[str, np.ndarray | None]:
    """The force along an excitation's direction and, on an x-y rig, across it, (1 or 2, samples).

    With it comes the name of its channel; None where it was not recorded.
    """
    planar = [f"force_{axis}" for axis in AXES]
    if all(name in dataset for name in planar):
        x, y = (dataset[name].values for name in planar)
        c, s = excitation.components
        return "force", np.array([c * x + s * y, c * y - s * x])
    forces = [name for name in map(str, dataset.data_vars) if name.partition("_")[0] == "force"]
    return (forces[0], dataset[forces[0]].values[None]) if len(forces) == 1 else ("force", None)


def _check_lines(name: str, forces: np.ndarray, lines: np.ndarray, per_period: int, fundamental: float) -> None:
    periods = split_periods(forces, per_period)
    # The first period may contain the start of the excitation.
    spectra = np.array([period_spectra(p, lines) for p in periods[1 if len(periods) > 2 else 0 :]])
    whole = np.abs(spectra.mean(axis=0))
    amplitude, noise = whole[0], np.sqrt(spectra.var(axis=0, ddof=1)[0] / len(spectra))
    missing = (amplitude <= LINE_SIGNIFICANCE * noise) | (amplitude <= LINE_FLOOR * whole.max())
    if missing.any():
        line = int(lines[np.argmax(missing)])
        raise ValueError(
            f"channel {name!r}: no excitation at line {line} ({line * fundamental:g} Hz), and at "
            f"{missing.sum()} of {lines.size} stated lines in all; correct the excitation's lines, fundamental or start"
        )


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
    periods = samples // periodic[0].samples_per_period(rate) if periodic else None
    made = {"excitations": [asdict(e) for e in excitations], "periods": periods, **experiment}
    variables = {
        name: ("time", np.array(values, dtype=np.float64), {"units": unit_of(name)})
        for name, values in channels.items()
    }
    time = ("time", np.arange(samples) / rate, {"units": "s"})
    attributes = {"file": file, "role": role, "sample_rate": float(rate), "experiment": json.dumps(made)}
    return xr.Dataset(variables, {"time": time}, attributes)


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
        value = source.scale * (sum(weighted[1:], weighted[0]))
        return value + source.offset if source.offset else value  # adding 0 would change the bits of -0.0


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


def _check_time(path: Path, time: np.ndarray, spec: RecordingSpec) -> None:
    if time.size < 2:
        return
    expected = 1 / spec.sample_rate
    off = np.abs(np.diff(time) - expected)
    if off.max() > STEP_TOLERANCE * expected:
        at = int(np.argmax(off > STEP_TOLERANCE * expected))
        raise ValueError(
            f"{path}: channel 'time': the step after sample {spec.start + at} is {time[at + 1] - time[at]:g} s, not "
            f"{expected:g} s as sample_rate = {spec.sample_rate:g} Hz says: a gap, a jump or another rate"
        )
    mean = (time[-1] - time[0]) / (time.size - 1)
    if abs(mean / expected - 1) > MEAN_RATE_TOLERANCE:
        raise ValueError(
            f"{path}: channel 'time': mean rate {1 / mean:.8g} Hz, not sample_rate = {spec.sample_rate:g} Hz"
        )


def _check_moves(path: Path, name: str, values: np.ndarray, spec: RecordingSpec) -> None:
    along = {"_x": 0, "_y": 1}.get(name[-2:])
    driven = any(
        e.at == "force" and e.kind != "none" and (along is None or e.components[along]) for e in spec.excitations
    )
    kind = name.partition("_")[0]
    if (kind == "displacement" or (kind == "force" and driven)) and values.min() == values.max():
        raise ValueError(f"{path}: channel {name!r} is {values[0]:g} in every sample; is the sensor connected?")


def _check_clipping(where: str, values: np.ndarray, start: int) -> None:
    for level, nearest in ((values.max(), np.max), (values.min(), np.min)):
        at = values == level
        share, run = at.mean(), at[: 1 - CLIPPED_RUN].copy()
        for shift in range(1, CLIPPED_RUN):
            run &= at[shift : at.size - CLIPPED_RUN + 1 + shift]
        if share < CLIPPED_SHARE or not run.any() or at.all():
            continue
        next_level = nearest(values[~at])
        if at.sum() >= CLIPPED_RATIO * (values == next_level).sum():
            first = start + int(np.argmax(run))
            raise ValueError(
                f"{where}: clipped at {level:g} from sample {first} on ({share:.2%} of the samples): "
                "nothing can be identified from it; record again with less amplitude or gain"
            )
