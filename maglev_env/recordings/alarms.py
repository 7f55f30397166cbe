"""Alarms of a recording: lost levitation, stuck readings, missing or double samples, rails; one rule each.

A rule compares a recording with itself, so that it needs no rig (only its clearance is used), and says nothing of a
sound one (the tests count false alarms on simulated records).
"""

import json
from collections.abc import Iterable
from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING, Literal

import numpy as np

from maglev_env.channels import unit_of
from maglev_env.recordings.formats.time_stamps import Clock
from maglev_env.recordings.levitation_losses import CAUGHT, levitation_losses, runs
from maglev_env.recordings.masking import MOST_MASKED, clipped_samples
from maglev_env.rig.rig import Rig

if TYPE_CHECKING:
    import xarray as xr

Code = Literal["lost levitation", "stuck reading", "samples", "rail"]

# A state counts when it lasts so long (s), and for so many samples: longer than a loop that still works rests at a
# limit, shorter than a rotor needs to be caught again.
STAY, STAY_SAMPLES = 0.05, 10
STUCK_RATIO, STUCK_SAMPLES = 4, 10
# A stuck reading jumps when it is released, or it lasts although the others swing as elsewhere; a quantised one moves
# on by a step, and rests while all is at rest.
STUCK_JUMP, STUCK_LONG, STUCK_SWING = 3, 20, 0.25
MOST_EVENTS = 10
BEYOND = 1.05  # clearances: a displacement that is always farther away is counted from another place
MOVES = 2.5  # converter steps between two readings in the middle of a motion
MOST_EXPLAINED = 0.2  # share of samples that repeat by the resolution of the displacement
READINGS = ("displacement", "current", "command", "force", "gap_estimate")


@dataclass(frozen=True)
class Alarm:
    """What is wrong with a recording.

    Attributes:
        code: Which rule.
        channel: Whose.
        time: When it begins, s from the first sample used.
        sentence: What happened, when, and how to cut or mend it.
        severity: "refuse": nothing is identified from the recording as it is; "warning": it is used with care.
        stretch: First sample of the file, and number of samples, of the longest part without it, where one is left.
    """

    code: Code
    channel: str
    time: float
    sentence: str
    severity: Literal["refuse", "warning"]
    stretch: tuple[int, int] | None = None


def alarms_of(dataset: "xr.Dataset") -> tuple[Alarm, ...]:
    """The alarms that `read_recording` found."""
    return tuple(Alarm(**a) for a in json.loads(dataset.attrs.get("alarms", "[]")))


def alarms_text(alarms: Iterable[Alarm]) -> str:
    """Alarms as the attribute of a dataset."""
    return json.dumps([asdict(a) for a in alarms])


def find_alarms(dataset: "xr.Dataset", start: int = 0, rig: Rig | None = None) -> tuple[Alarm, ...]:
    """Lost levitation, stuck readings and repeated samples of a recording.

    Args:
        dataset: As `read_recording` makes it; where it was resampled with a coordinate `row` over time, the row of
            each sample from the first one used.
        start: Row of the file at which it begins, for the sentences.
        rig: Its nominal rig, for its clearance.
    """
    found = lost_levitation(dataset, start, rig)
    lost = {a.channel for a in found}
    stuck = [a for a in stuck_readings(dataset, start) if a.channel not in lost]
    return (*found, *stuck, *repeated_samples(dataset, start))


def lost_levitation(dataset: "xr.Dataset", start: int = 0, rig: Rig | None = None) -> list[Alarm]:
    """The rotor is at a stop, or out of its working range while the command is at a limit, until it is caught again.

    It is at a stop where it rests at the rig's clearance, or at the end of its readings while the command swings. The
    working range is that of the samples without a stop or limit, widened; and no more than the rig's clearance.
    """
    rate, found = dataset.attrs["sample_rate"], []
    stay = max(STAY_SAMPLES, round(STAY * rate))
    for name in _of_kind(dataset, "displacement"):
        y, end = dataset[name].values, name.removeprefix("displacement")
        efforts = [dataset[kind + end].values for kind in ("command", "voltage", "current") if kind + end in dataset]
        if not efforts:
            continue  # nothing says that it is levitated
        if rig is not None and np.abs(y).min() > BEYOND * rig.clearance:
            found.append(_elsewhere(name, y, rig.clearance))
            continue
        wanted = dataset["reference" + end].values if "reference" + end in dataset else None
        spells, (low, high) = levitation_losses(y, efforts[0], wanted, stay, np.inf if rig is None else rig.clearance)
        if not spells:
            continue
        sound = max(_gaps(spells, y.size), key=lambda part: part[1] - part[0])
        share = sum(last - first for first, last in spells) / y.size
        stretch = (start + sound[0], sound[1] - sound[0]) if sound[1] - sound[0] > CAUGHT * stay else None
        there = np.concatenate([y[slice(*run)] for run in spells])
        when = ", ".join(f"{a / rate:.4g} to {b / rate:.4g} s" for a, b in spells[:MOST_EVENTS])
        more = f" and {len(spells) - MOST_EVENTS} more times" if len(spells) > MOST_EVENTS else ""
        low, high = max(low, y.min()), min(high, y.max())  # nothing is said beyond what was read
        works = f", and works from {_si(low, 'm')} to {_si(high, 'm')}" if high > low else ""
        cut = f"use the longest sound stretch: {_cut(dataset, start, sound)}" if stretch else "record again"
        found.append(
            Alarm(
                "lost levitation",
                name,
                spells[0][0] / rate,
                f"levitation is lost from {when}{more} ({share:.1%} of the record): {name} is at "
                f"{_si(there.min(), 'm')} to {_si(there.max(), 'm')} there{works}; {cut}",
                "refuse",
                stretch,
            )
        )
    return found


def _elsewhere(name: str, y: np.ndarray, clearance: float) -> Alarm:
    """Of a displacement (samples,) that is never between the stops: it is counted from another place."""
    text = (
        f"{name} is at {_si(y.min(), 'm')} to {_si(y.max(), 'm')} all the time, where the rig's clearance leaves "
        f"{_si(clearance, 'm')} to both sides of 0; state its offset in [recording.channels] (m), so that it is 0 at "
        "the centre (of a magnet above: at the gap in the rig), or correct clearance"
    )
    return Alarm("lost levitation", name, 0.0, text, "refuse")


def stuck_readings(dataset: "xr.Dataset", start: int = 0) -> list[Alarm]:
    """A channel repeats a value for much longer than it does elsewhere, and jumps when it is released, or never is."""
    rate, found = dataset.attrs["sample_rate"], []
    moving = [n for n in dataset.data_vars if n.partition("_")[0] in READINGS and np.ptp(dataset[n].values) > 0]
    for name in (n for n in dataset.data_vars if n.partition("_")[0] in READINGS):
        values = dataset[name].values
        if np.ptp(values) == 0:
            if name not in moving and moving and name.partition("_")[0] not in ("force", "command"):
                text = f"{name} is {values[0]:g} {unit_of(name)} in every sample while {moving[0]} moves"
                found.append(Alarm("stuck reading", name, 0.0, f"{text}; is it connected?", "refuse"))
            continue
        change = np.flatnonzero(np.diff(values))
        edges = np.concatenate([[-1], change, [values.size - 1]])
        lengths = np.diff(edges)
        order = np.argsort(-lengths, kind="stable")[: MOST_EVENTS + 1]
        top = lengths[order]
        falls = [k for k in range(len(top) - 1) if top[k] >= STUCK_RATIO * top[k + 1] and top[k] >= STUCK_SAMPLES]
        usual = float(np.median(np.abs(np.diff(values)[change])))
        spells = []
        for k in sorted(order[: falls[-1] + 1]) if falls else []:
            first, last = int(edges[k]) + 1, int(edges[k + 1]) + 1
            jumps = last < values.size and abs(values[last] - values[last - 1]) > STUCK_JUMP * usual
            swings = lengths[k] >= STUCK_LONG * top[falls[-1] + 1] and any(
                np.ptp(dataset[other].values[first:last]) > STUCK_SWING * np.ptp(dataset[other].values)
                for other in moving
                if other != name
            )
            extreme = values[first] in (values.min(), values.max())
            off = first == 0 and values[0] == 0 and not name.startswith("displacement")  # not switched on yet
            if (jumps or swings) and not extreme and not off:
                spells.append((first, last))
        if spells:
            first, last = spells[0]
            more = f", and {len(spells) - 1} more times" if len(spells) > 1 else ""
            sound = max(_gaps(spells, values.size), key=lambda part: part[1] - part[0])
            found.append(
                Alarm(
                    "stuck reading",
                    name,
                    first / rate,
                    f"{name} is stuck at {values[first]:.4g} {unit_of(name)} from {first / rate:.4g} s on for "
                    f"{(last - first) / rate:.3g} s{more}; leave it out: {_cut(dataset, start, sound)}",
                    "refuse",
                )
            )
    return found


def repeated_samples(dataset: "xr.Dataset", start: int = 0) -> list[Alarm]:
    """All channels repeat at once more often than their resolution explains: samples that were stored twice.

    Nothing is said of a resampled recording: its time stamps tell of double samples, and between two equal readings
    interpolation repeats a value that no converter step explains.
    """
    if "row" in dataset.coords:
        return []
    rate = dataset.attrs["sample_rate"]
    moving = [n for n in dataset.data_vars if n.partition("_")[0] in READINGS and np.ptp(dataset[n].values) > 0]
    if len(moving) < 2:
        return []
    # The controller sees the displacement alone: where that repeats, command and current do so, too, and no coincidence
    # of channels tells a double sample from a coarse reading.
    sensed = {n: _explained(dataset[n].values) for n in moving if not n.startswith("command")}
    steady = max((p for n, p in sensed.items() if n.startswith("displacement")), default=0.0)
    if not sensed or steady > MOST_EXPLAINED:
        return []
    values = [dataset[n].values for n in moving]
    equal = np.all([np.diff(v) == 0 for v in values], axis=0)
    if max((b - a for a, b in runs(equal)), default=0) >= STUCK_SAMPLES:
        return []
    # Where all turn round at once, as in each period of a slow sine, coarse readings repeat; one that is stored twice
    # stands in the middle of a motion.
    equal &= np.any([_in_motion(dataset[n].values) for n in sensed], axis=0)
    count, size = int(equal.sum()), equal.size
    # Two steady readings in a row give two equal commands, and a coarse current with them.
    explained = max(10 * float(np.prod([*sensed.values()])), 2 * steady**2) * size
    if count <= 5 + explained:
        return []
    first = int(np.argmax(equal)) + 1
    severity = "refuse" if count > MOST_MASKED * size else "warning"
    text = (
        f"{count} samples repeat the one before in every channel ({count / size:.2%}), the first at "
        f"{first / rate:.4g} s (sample {start + first}): they were stored twice, and the time axis is stretched there"
    )
    return [Alarm("samples", "all channels", first / rate, text, severity)]


def clock_alarms(clock: Clock, rate: float, start: int = 0) -> list[Alarm]:
    """What the time stamps tell of missing and double samples."""
    found, size = [], clock.kept.size
    if clock.backward is not None:
        at = clock.backward
        text = f"time runs backward after {at / rate:.4g} s (sample {start + at}); cut the record there: samples = {at}"
        found.append(Alarm("samples", "time", at / rate, text, "refuse"))
    if clock.gaps:
        at, missing = clock.gaps[0]
        total = sum(lost for _, lost in clock.gaps)
        when = float(clock.instants[at]) / rate if clock.instants is not None else at / rate
        edges = [0, *[i + 1 for i, _ in clock.gaps], size]
        longest = int(np.argmax(np.diff(edges)))
        are = "samples are" if missing > 1 else "sample is"
        text = (
            f"{missing} {are} missing after {when:.4g} s (sample {start + at}), {total} in all in "
            f"{len(clock.gaps)} gaps ({total / (size + total):.2%})"
        )
        few = total <= MOST_MASKED * (size + total)
        cut = f"; use start = {start + edges[longest]}, samples = {edges[longest + 1] - edges[longest]}"
        text += "; they are bridged and masked" if few else cut
        found.append(Alarm("samples", "time", when, text, "warning" if few else "refuse"))
    if clock.repeated:
        at, few = clock.repeated[0], len(clock.repeated) <= MOST_MASKED * size
        text = f"{len(clock.repeated)} time stamps repeat, the first at {at / rate:.4g} s (sample {start + at})"
        text += "; these samples are left out" if few else "; record again"
        found.append(Alarm("samples", "time", at / rate, text, "warning" if few else "refuse"))
    return found


def touched_rail(
    name: str, column: str, raw: np.ndarray, values: np.ndarray, rate: float, start: int = 0, rig: Rig | None = None
) -> tuple[Alarm | None, np.ndarray]:
    """A reading stays at its extreme value, or reaches the end of the rig's converter.

    Args:
        name: Channel.
        column: One of its columns in the file.
        raw: That column, (samples,).
        values: The channel in SI, (samples,).
        rate: Hz.
        start: Sample of the file at which both begin.
        rig: The nominal rig of one axis, for its converter.

    Returns:
        The alarm, and the samples at the rail, (samples,) bool.
    """
    at = clipped_samples(raw)
    if name.startswith("force"):  # between the blows of a hammer it rests at its least value
        at &= raw != np.median(raw)
    what = "stays at its extreme value"
    if rig is not None and name.startswith("displacement") and rig.adc_bits:
        reach = rig.voltage_range / rig.probe_gain * (1 - 2.0 ** (1 - rig.adc_bits))
        if (beyond := np.abs(values) >= reach).any():
            at, what = at | beyond, f"reaches the converter's range of +-{_si(reach, 'm')}"
    if not at.any():
        return None, at
    first, few = int(np.argmax(at)), at.mean() <= MOST_MASKED
    text = (
        f"channel {name!r} (column {column!r}) is clipped at {raw[first]:g} from {first / rate:.4g} s (sample "
        f"{start + first}) on: it {what} in {at.mean():.2%} of the samples"
    )
    kept = (
        "it is used as it stands, as a limit of the controller acts"
        if name.startswith("command")
        else "they are masked"
    )
    text += f"; {kept}" if few else "; nothing can be identified from it: record with less amplitude or gain"
    return Alarm("rail", name, first / rate, text, "warning" if few else "refuse"), at


def _cut(dataset: "xr.Dataset", start: int, part: tuple[int, int]) -> str:
    """What a campaign states to use a part of a recording alone: rows of the file."""
    first, last = part
    if "row" in dataset.coords:
        rows = dataset["row"].values
        first, last = int(rows[first]), int(rows[last - 1]) + 1
    return f"start = {start + first}, samples = {last - first}"


def _of_kind(dataset: "xr.Dataset", kind: str) -> list[str]:
    return [str(name) for name in dataset.data_vars if str(name).partition("_")[0] == kind]


def _explained(values: np.ndarray) -> float:
    """Share of samples that repeat by resolution alone: the step of the readings over the spread of their changes."""
    return min(1.0, _step(values) / (2.5 * max(float(np.median(np.abs(np.diff(values)))) / 0.67, 1e-300)))


def _step(values: np.ndarray) -> float:
    """Smallest change of readings."""
    steps = np.abs(np.diff(values))
    return float(steps[steps > 1e-6 * steps.max()].min())  # steps below are rounding of the same converter step


def _in_motion(values: np.ndarray) -> np.ndarray:
    """Whether a reading moves on by several steps both before and after each of its changes, (samples - 1,) bool."""
    fast = np.pad(np.abs(np.diff(values)) > MOVES * _step(values), 1)
    return fast[:-2] & fast[2:]


def _gaps(spells: list[tuple[int, int]], size: int) -> list[tuple[int, int]]:
    """The stretches between spells."""
    ends = [0, *[b for _, b in spells]]
    starts = [*[a for a, _ in spells], size]
    return list(zip(ends, starts, strict=True))


def _si(value: float, unit: str) -> str:
    return f"{value * 1e3:.4g} m{unit}" if abs(value) >= 1e-4 else f"{value * 1e6:.4g} u{unit}"
