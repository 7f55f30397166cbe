"""What was added to the command of a loop whose time stamps jitter, from its own samples.

The controller ran at its own ticks: what it makes of readings that were resampled is not what it made of them.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from maglev_env.loop.axes import suffixes
from maglev_env.loop.gains import Controllers, of_axis, reads_current
from maglev_env.recordings.time_stamps import at_steps
from maglev_env.rig.excitation import Excitation
from sim2real.recorded.controller_output import recovered_injection

if TYPE_CHECKING:
    import xarray as xr

TURNED = 0.01  # rad: about the model error that responses are trusted to


@dataclass(frozen=True)
class Ticks:
    """A recording at the ticks of its controller.

    Args:
        instants: of the ticks, (ticks,), in control steps.
        channels: command, displacement and, where recorded, reference and current -> (axes, ticks).
        gains: the controller.
        dt: control step, s.
    """

    instants: np.ndarray
    channels: Mapping[str, np.ndarray]
    gains: Controllers
    dt: float

    def injection(self, start: int) -> np.ndarray:
        """What was added to the command, (axes, steps from `start` on), A; the controller rests at that step."""
        first = int(np.searchsorted(self.instants, start - 0.5))
        # The ticks count from the step at which they begin, so that none of these steps lies before them.
        instants = np.maximum(self.instants[first:] - start, 0.0)
        found = []
        for axis in range(len(self.channels["command"])):
            own = {name: values[axis, first:] for name, values in self.channels.items()}
            found.append(at_steps(instants, recovered_injection(of_axis(self.gains, axis), dt=self.dt, **own)))
        return np.array(found)


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


def ticks_of(dataset: "xr.Dataset", gains: Controllers, axes: int, rate: float) -> Ticks | None:
    """The ticks of a resampled recording; None where they were not read, or not all that the controller saw.

    Args:
        dataset: as `read_recording` makes it.
        gains: the controller.
        axes: of the rig.
        rate: control rate, Hz.
    """
    channels = {
        kind: np.array([dataset[f"tick_{kind}{s}"].values for s in suffixes(axes)])
        for kind in ("command", "displacement", "reference", "current")
        if all(f"tick_{kind}{s}" in dataset.coords for s in suffixes(axes))
    }
    wanted = {"command", "displacement"} | ({"current"} if reads_current(gains, 1 / rate) else set())
    wanted |= {"reference"} if any(str(name).startswith("reference") for name in dataset.data_vars) else set()
    if not wanted <= channels.keys():
        return None
    kept = {kind: values for kind, values in channels.items() if kind in wanted}
    return Ticks(dataset["tick_time"].values * rate, kept, gains, 1 / rate)
