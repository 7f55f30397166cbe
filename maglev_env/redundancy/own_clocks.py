"""Channels that stand behind a time of their own, against the one time that the campaign takes for all."""

import numpy as np

from maglev_env.recordings.campaign import Campaign, RecordingSpec
from maglev_env.recordings.files import Columns
from maglev_env.recordings.guess.behaviour import is_time
from maglev_env.recordings.guess.columns.clocks import called_time
from maglev_env.recordings.guess.units import header_unit
from maglev_env.recordings.own_clocks import apart, own_times
from maglev_env.redundancy.finding import Finding


def other_clocks(campaign: Campaign, spec: RecordingSpec) -> list[Finding]:
    """Channels of a text file whose own time differs from that of the others in the same row.

    It says nothing of a channel with a stated delay, nor of clocks that may count from other instants.
    """
    columns = campaign.files.columns(campaign.folder / spec.file, spec.layout)
    clocks = _clocks(columns, slice(spec.start, None if spec.samples is None else spec.start + spec.samples))
    if len(clocks) < 2:
        return []
    by_place = dict(zip(columns.positions, columns.names, strict=True))
    used = {channel: [by_place.get(c, c) for c in source.columns] for channel, source in spec.channels.items()}
    own = own_times(columns.names, clocks)
    moved = [c for channel in ("displacement", "displacement_x") for c in used.get(channel, ()) if c in own]
    main = next((c for c in used.get("time", ()) if c in clocks), own[moved[0]][0] if moved else next(iter(clocks)))
    found = []
    for channel, read in used.items():
        others = [t for c in read if main not in own.get(c, (main,)) for t in own[c]]
        distances = [apart(clocks[main], clocks[t]) for t in others]
        if spec.channels[channel].delay or not distances or not all(far and overlap for far, overlap in distances):
            continue
        distance = min(far for far, _ in distances)
        samples = distance * spec.sample_rate
        text = (
            f"{channel}: its own time, column {others[0]!r}, is {distance:.3g} s ({samples:.3g} samples) from that of "
            "the others in the same row; write both into a file of their own, and maglev new joins files of one run on "
            "their clocks"
        )
        kind = "contradiction" if samples >= 1 else "wiring"
        found.append(Finding("clock", spec.name, channel, distance, None, text, kind))
    return found


def _clocks(columns: Columns, window: slice) -> dict[str, np.ndarray]:
    """The times (samples,) of a text file, in s, by column."""
    clocks: dict[str, np.ndarray] = {}
    for name in columns.names if columns.positions else ():
        called, unit = header_unit(columns.headers.get(name, name))
        if called_time(called, unit):
            values = columns.column(name)[window]
            if is_time(values[np.isfinite(values)]):
                clocks[name] = values * unit.scale
    return clocks
