"""The current of a coil of which the voltage alone is recorded, by its resistance, its inductance and the motion.

A rotor that moves with the velocity v towards a magnet whose force grows by k_i with its current changes the flux
through the coil, and induces k_i v against that current: by the energy that the coil gives to the rotor, the factor is
the same. Left out, it acts as a damping of k_i^2 / R, behind the coil's own lag.
"""

from collections.abc import Collection, Mapping
from dataclasses import dataclass

import numpy as np

from maglev_env.loop.axes import suffixes
from maglev_env.loop.magnets.kinds import force_law
from maglev_env.loop.magnets.law import linearise
from maglev_env.recordings.derived import coil_current, tells_current
from maglev_env.rig.rig import Rig, axis_rig
from sim2real.recorded.channel_errors import ChannelError, scale_of

# Relative standard deviations where the rig's [tolerance] states none: of the actuator's gain, of a resistance, which
# grows by 4 % as copper warms by 10 K, and of an inductance, which grows as the gap closes and falls with eddy
# currents.
GAIN, RESISTANCE, INDUCTANCE = 0.3, 0.04, 0.1


@dataclass(frozen=True)
class CurrentByVoltage:
    """The current of every coil, and what is not known of it.

    Attributes:
        current: (axes, samples), A.
        errors: Of each axis.
        note: What was assumed, in words.
    """

    current: np.ndarray
    errors: tuple[tuple[ChannelError, ...], ...]
    note: str


def told_by_voltage(rig: Rig, channels: Collection[str]) -> bool:
    """Whether only the voltage of these channels tells a current, and the rig knows the coil."""
    return tells_current(rig) and "voltage" in channels and not {"current", "command"} & {*channels}


def driven_by_voltage(rig: Rig, channels: Collection[str]) -> bool:
    """Whether a voltage at the coil drives the rig, by these channels: its current, recorded or told by the voltage, is
    then what acts, with what the motion induces, which the nominal amplifier behind a stated controller lacks."""
    return tells_current(rig) and "voltage" in channels and "command" not in channels


def current_by_voltage(rig: Rig, channels: Mapping[str, np.ndarray], rate: float) -> CurrentByVoltage | None:
    """The coils' currents where only their voltage is recorded and the rig knows the coil; else None.

    Args:
        rig: The nominal rig.
        channels: Of a recording, name -> (axes, samples), SI.
        rate: Of the samples, Hz.
    """
    if not told_by_voltage(rig, channels):
        return None
    currents, errors = [], []
    for axis, letter in enumerate(suffixes(rig.axes)):
        own = axis_rig(rig, axis)
        assert own.coil_inductance is not None
        gain = linearise(force_law(own))[0]
        # Over each step between two samples, as the voltage is: the mean velocity.
        velocity = rate * np.diff(channels["displacement"][axis], append=channels["displacement"][axis][-1:])
        terms = own.coil_resistance, own.coil_inductance
        currents.append(coil_current(channels["voltage"][axis] - gain * velocity, rate, *terms))
        scale, induced = rig.tolerance.get("coil_resistance", RESISTANCE), rig.tolerance.get("actuator_gain", GAIN)
        slower = rig.tolerance.get("coil_inductance", INDUCTANCE)
        name = f"current{letter}"
        errors.append((
            ChannelError(scale_of(name), "current", axis, scale=scale),
            ChannelError(f"induced voltage of {name}", "current", axis, coil=terms, induced=induced * gain),
            ChannelError(f"inductance behind {name}", "current", axis, coil=terms, inductance=slower),
        ))  # fmt: skip
    note = (
        "the current is computed from the voltage by the coil's resistance and inductance and by what the motion "
        "induces with the nominal actuator gain"
    )
    return CurrentByVoltage(np.array(currents), tuple(errors), note)
