"""A reading that repeats a value while the rotor moves."""

from collections.abc import Iterable
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from maglev_env.channels import unit_of
from maglev_env.recordings.alarms.alarm import MOST_EVENTS, READINGS, STUCK_SAMPLES, Alarm, cut_to, stretches_between

if TYPE_CHECKING:
    import xarray as xr

STUCK_RATIO = 4  # times the longest repetition elsewhere
# A stuck reading jumps when it is released, or it lasts although the others swing as elsewhere; a quantised one moves
# on by a step, and rests while all is at rest.
STUCK_JUMP, STUCK_LONG, STUCK_SWING = 3, 20, 0.25


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
            sound = max(stretches_between(spells, values.size), key=lambda part: part[1] - part[0])
            found.append(
                Alarm(
                    "stuck reading",
                    name,
                    first / rate,
                    f"{name} is stuck at {values[first]:.4g} {unit_of(name)} from {first / rate:.4g} s on for "
                    f"{(last - first) / rate:.3g} s{more}; leave it out: {cut_to(dataset, start, sound)}",
                    "refuse",
                )
            )
    return found


def stuck_columns(dataset: "xr.Dataset", columns: Iterable[tuple[str, str, np.ndarray]], start: int = 0) -> list[Alarm]:
    """The same of columns of which a channel is a sum: what moves in the others hides that one of them does not.

    Args:
        dataset: As `read_recording` makes it.
        columns: Channel, column and its readings (samples,) in the unit of the channel.
        start: Row of the file at which it begins, for the sentences.
    """
    found: list[Alarm] = []
    for name, column, values in columns:
        alone = dataset.assign({name: (dataset[name].dims, values, dataset[name].attrs)})
        for alarm in stuck_readings(alone, start):
            if alarm.channel == name:
                rest = alarm.sentence.removeprefix(name)
                found.append(replace(alarm, sentence=f"{name}: column {column!r} of its sum{rest}"))
    return found
