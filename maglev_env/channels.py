"""The table of channels: every signal of a loop that is simulated, recorded or analysed.

All other lists of channels derive from it. A new channel needs a row here, one in docs/formats.md, and the code that
makes or uses it.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal

Place = Literal["force", "current", "reference"]
SENSORS = ("probe", "self_sensing")  # of the displacement


@dataclass(frozen=True)
class Channel:
    """One signal; on an x-y rig there is one of each axis, with _x or _y behind its name.

    Args:
        unit: SI unit.
        meaning: what it is, for the documentation.
        simulated: its source in a simulated record. "step": the compiled step writes it; "sensing": likewise, but only
            with self-sensing; "drive": it is the reading of the excitation; None: not in the record.
        recorded: whether a campaign may name it.
        spectra: whether estimators use its line spectra: for simulations and recordings ("all"), for recordings only
            ("recorded"), or never (None).
        noisy: whether a rig's [noise] has a level for it; each noisy channel has its own noise stream.
        shows: place of the excitation that this channel measures, see `rig.excitation`.
    """

    unit: str
    meaning: str
    simulated: Literal["step", "sensing", "drive"] | None = None
    recorded: bool = True
    spectra: Literal["all", "recorded"] | None = None
    noisy: bool = False
    shows: Place | None = None


# Their order is that of the simulator's outputs, of the noise streams and of the spectra.
CHANNELS: Mapping[str, Channel] = {
    "displacement": Channel("m", "of the rotor from the centre, as the probe reads it; + is toward the (upper) magnet",
                            "step",
                            spectra="all", noisy=True),
    "command": Channel("A", "current that the controller asks for, the injection included", "step", spectra="all"),
    "position": Channel("m", "true displacement, where the loop runs on a sensed one", "sensing", recorded=False),
    "current": Channel("A", "in the coil", "step", spectra="recorded", noisy=True),
    "force": Channel("N", "on the rotor from outside, as its transducer reads it", "drive",
                     spectra="all", noisy=True, shows="force"),
    "injection": Channel("A", "added to the command", spectra="all", shows="current"),
    "reference": Channel("m", "wanted displacement", shows="reference"),
    "acceleration": Channel("m/s2", "of the rotor; integrated twice where there is no displacement"),
    "voltage": Channel("V", "of the switching amplifier at the coil"),
    "gap_estimate": Channel("m", "output of a self-sensor"),
    "speed": Channel("rad/s", "of rotation"),
}  # fmt: skip


def simulated_channels(sensed: bool = False) -> tuple[str, ...]:
    """Channels of a simulated record, in order; sensed: with self-sensing."""
    return tuple(name for name, c in CHANNELS.items() if c.simulated and (sensed or c.simulated != "sensing"))


def step_channels(sensed: bool = False) -> tuple[str, ...]:
    """Those of `simulated_channels` that the compiled step writes, in order."""
    return tuple(name for name in simulated_channels(sensed) if CHANNELS[name].simulated != "drive")


MEASURED = simulated_channels()  # channels that both a simulated and a measured loop have
SPECTRAL = tuple(name for name, c in CHANNELS.items() if c.spectra == "all")
ANALYSED = tuple(name for name, c in CHANNELS.items() if c.spectra)
NOISY = tuple(name for name, c in CHANNELS.items() if c.noisy)
RECORDED = tuple(name for name, c in CHANNELS.items() if c.recorded)
EFFORTS = ("current", "command", "voltage")  # what drives a coil, which may include what carries the weight
SHOWN_BY: Mapping[Place, str] = {c.shows: name for name, c in CHANNELS.items() if c.shows}


def unit_of(channel: str) -> str:
    """SI unit of a channel, also of one with an axis behind its name."""
    return CHANNELS[channel if channel in CHANNELS else channel[:-2]].unit
