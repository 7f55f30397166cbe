"""What was added to the command of a loop whose time stamps jitter, from its own samples.

The controller ran at its own ticks: what it makes of readings that were resampled is not what it made of them.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from maglev_env.loop.axes import suffixes
from maglev_env.loop.gains import Controllers, of_axis, reads_current
from maglev_env.recordings.time_stamps import at_steps
from sim2real.recorded.controller_output import recovered_injection

if TYPE_CHECKING:
    import xarray as xr


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
