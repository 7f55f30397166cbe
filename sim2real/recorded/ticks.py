"""A recording whose time stamps jitter, at the ticks of its controller.

What a controller makes of readings that were resampled is not what it made of them, and the rotor moved for as long as
each tick lasted. Simulated at the same ticks, both are exact.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import ceil
from typing import TYPE_CHECKING

import numpy as np

from maglev_env.channels import MEASURED
from maglev_env.loop.axes import suffixes
from maglev_env.loop.gains import Controllers, reads_current
from maglev_env.recordings.masking import bridged, masked_samples
from maglev_env.rig.excitation import Excitation

if TYPE_CHECKING:
    import xarray as xr

AT_INSTANTS = 32  # integration steps of a sample whose instants jitter: they are moved by 1 % of it rms
# Ticks are simulated as regular ones where the time between two of them is a sample to within JITTERED rms, LONGEST at
# most and DRIFTED on average: placed at the nearest of AT_INSTANTS steps, it is off by 1.3 % rms anyway.
JITTERED, LONGEST, DRIFTED = 0.02, 0.25, 1e-3
TURNED = 0.01  # rad: about the model error that responses are trusted to


@dataclass(frozen=True)
class Ticks:
    """A recording at the ticks of its controller.

    Args:
        instants: of the ticks, (ticks,), in samples of the stated rate.
        channels: channel -> (axes, ticks), with masked samples bridged.
    """

    instants: np.ndarray
    channels: Mapping[str, np.ndarray]

    @property
    def simulated(self) -> np.ndarray | None:
        """Instants (ticks,) at which a simulation places them; None where regular ones are as near."""
        off = np.diff(self.instants) - 1
        exact = off.std() > JITTERED or abs(off).max() > LONGEST or abs(off.mean()) > DRIFTED
        return self.instants if exact else None


def jitters(
    dataset: "xr.Dataset", gains: Controllers | None, excitations: Sequence[Excitation], axes: int, rate: float
) -> bool:
    """Whether a recording with a period is better compared without one, at the jittered ticks of its controller.

    What the controller made of resampled readings is wrong by the angle that a line turns within the jitter. At the
    ticks it is exact, if all that drove the loop is recorded or part of the command.

    Args:
        dataset: as `read_recording` makes it.
        gains: the controller; None: not known.
        excitations: what drove the loop.
        axes: of the rig.
        rate: control rate, Hz.
    """
    if not dataset.attrs.get("resampled") or gains is None or not np.isclose(dataset.attrs["sample_rate"], rate):
        return False
    ticks = ticks_of(dataset, gains, axes, rate)
    pushed = any(e.at == "force" for e in excitations) and not any(
        str(v).startswith("force") for v in dataset.data_vars
    )
    if ticks is None or pushed:
        return False
    count = np.arange(ticks.instants.size)
    off = ticks.instants - np.polyval(np.polyfit(count, ticks.instants, 1), count)
    top = max(float(np.max(e.frequencies)) for e in excitations if e.periodic)
    return bool(2 * np.pi * top / rate * off.std() > TURNED)


def ticks_of(dataset: "xr.Dataset", gains: Controllers | None, axes: int, rate: float) -> Ticks | None:
    """The ticks of a resampled recording; None where they were not read, or not all that moved the rotor.

    Args:
        dataset: as `read_recording` makes it.
        gains: the controller; None: another stands in for it.
        axes: of the rig.
        rate: of the recording, Hz.
    """
    own = {
        kind: [f"tick_{kind}{s}" for s in suffixes(axes)]
        for kind in (*MEASURED, "injection", "reference")
        if all(f"{kind}{s}" in dataset.data_vars for s in suffixes(axes))
    }
    at_ticks = {kind for kind, names in own.items() if all(name in dataset.coords for name in names)}
    needed = {"command", "displacement"} | ({"force", "reference"} & own.keys())
    if gains is not None and reads_current(gains, 1 / rate):
        needed.add("current")
    if not needed <= at_ticks:
        return None
    instants = dataset["tick_time"].values * rate
    steps = masked_samples(dataset)
    masked = steps[np.minimum(np.rint(instants).astype(int), steps.size - 1)]
    channels = {
        kind: np.array([bridged(dataset[name].values, masked) for name in own[kind]]) for kind in sorted(at_ticks)
    }
    return Ticks(instants, channels)


def substeps(instants: np.ndarray | None, every: int) -> int:
    """Least number of integration steps per simulated sample.

    Args:
        instants: of the ticks; None: the ticks are regular.
        every: simulated samples per tick.
    """
    return 1 if instants is None else ceil(AT_INSTANTS / every)


def led_in(instants: np.ndarray, samples: int) -> np.ndarray:
    """Instants (ticks,) from zero on, after so many regular ticks."""
    return np.concatenate([np.arange(samples), samples + instants - instants[0]])


def between_ticks(instants: np.ndarray, every: int) -> np.ndarray:
    """Instants (ticks * every,) in steps of which each tick has `every`, however long it lasts."""
    lasts = np.diff(instants, append=instants[-1] + 1)
    return ((instants[:, None] + lasts[:, None] * np.arange(every) / every) * every).reshape(-1)
