"""The rotor is at a stop, or out of its working range: it is not levitated."""

from typing import TYPE_CHECKING

import numpy as np

from maglev_env.recordings.alarms.alarm import MOST_EVENTS, Alarm, cut_to, in_small_units, stretches_between
from maglev_env.recordings.alarms.levitation_losses import CAUGHT, levitation_losses
from maglev_env.rig.rig import Rig

if TYPE_CHECKING:
    import xarray as xr

# A state counts when it lasts so long (s), and for so many samples: longer than a loop that still works rests at a
# limit, shorter than a rotor needs to be caught again.
STAY, STAY_SAMPLES = 0.05, 10
BEYOND = 1.05  # clearances: a displacement that is always farther away is counted from another place


def lost_levitation(dataset: "xr.Dataset", start: int = 0, rig: Rig | None = None) -> list[Alarm]:
    """The rotor is at a stop, or out of its working range while the command is at a limit, until it is caught again.

    It is at a stop where it rests at the rig's clearance, or at the end of its readings while the command swings. The
    working range is that of the samples without a stop or limit, widened; and no more than the rig's clearance.
    """
    rate, found = dataset.attrs["sample_rate"], []
    stay = max(STAY_SAMPLES, round(STAY * rate))
    for name in _of_kind(dataset, "displacement"):
        y, end = dataset[name].values, name.removeprefix("displacement")
        if dataset[name].attrs.get("integrated"):
            continue  # an accelerometer's drift says nothing of where the rotor is
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
        sound = max(stretches_between(spells, y.size), key=lambda part: part[1] - part[0])
        share = sum(last - first for first, last in spells) / y.size
        stretch = (start + sound[0], sound[1] - sound[0]) if sound[1] - sound[0] > CAUGHT * stay else None
        there = np.concatenate([y[slice(*run)] for run in spells])
        when = ", ".join(f"{a / rate:.4g} to {b / rate:.4g} s" for a, b in spells[:MOST_EVENTS])
        more = f" and {len(spells) - MOST_EVENTS} more times" if len(spells) > MOST_EVENTS else ""
        low, high = max(low, y.min()), min(high, y.max())  # nothing is said beyond what was read
        works = f", and works from {in_small_units(low, 'm')} to {in_small_units(high, 'm')}" if high > low else ""
        cut = f"use the longest sound stretch: {cut_to(dataset, start, sound)}" if stretch else "record again"
        found.append(
            Alarm(
                "lost levitation",
                name,
                spells[0][0] / rate,
                f"levitation is lost from {when}{more} ({share:.1%} of the record): {name} is at "
                f"{in_small_units(there.min(), 'm')} to {in_small_units(there.max(), 'm')} there{works}; {cut}",
                "refuse",
                stretch,
            )
        )
    return found


def _elsewhere(name: str, y: np.ndarray, clearance: float) -> Alarm:
    """Of a displacement (samples,) that is never between the stops: it is counted from another place."""
    low, high, room = (in_small_units(value, "m") for value in (y.min(), y.max(), clearance))
    text = (
        f"{name} is at {low} to {high} all the time, where the rig's clearance leaves {room} to both sides of 0; state "
        "its offset in [recording.channels] (m), so that it is 0 at the centre (of a magnet above: at the gap in the "
        "rig), or correct clearance"
    )
    return Alarm("off centre", name, 0.0, text, "refuse")


def _of_kind(dataset: "xr.Dataset", kind: str) -> list[str]:
    return [str(name) for name in dataset.data_vars if str(name).partition("_")[0] == kind]
