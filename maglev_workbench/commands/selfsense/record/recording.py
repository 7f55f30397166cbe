"""A recording of a simulated coil: its current, its switching voltage and the true displacement."""

from dataclasses import dataclass
from math import pi
from typing import TYPE_CHECKING

import numpy as np

from maglev_env.recordings.recording import unit_of
from selfsense.sensor import SelfSensor
from selfsense.simulate import simulate

if TYPE_CHECKING:
    import xarray as xr


@dataclass(frozen=True)
class Motion:
    """The motion that is recorded for `seconds`.

    The gap moves sinusoidally with an amplitude (m) at a frequency (Hz); the duty varies as duty_swing cos about one
    half.
    """

    frequency: float
    amplitude: float
    duty_swing: float
    seconds: float


def recorded_coil(sensor: SelfSensor, motion: Motion, seed: int, suffix: str = "") -> "xr.Dataset":
    """The coil's current (A, as read), switching voltage (V, mean since the sample before) and the displacement (m): at
    rest less gap; over time (s) from 0, the first sample being one interval after the coil was without current.

    suffix: of the channels' names, _x on an x-y rig.
    """
    import xarray as xr

    rate = sensor.acquisition.rate
    elapsed = (np.arange(round(motion.seconds * rate)) + 1) / rate
    phase = 2 * pi * motion.frequency * elapsed
    gap = sensor.gap + motion.amplitude * np.sin(phase)
    sensed = simulate([sensor], gap, 2 * motion.duty_swing * np.cos(phase), seed=seed)
    channels = {
        "current": sensed.current[0],
        "voltage": sensor.supply.voltage * sensed.switching[0],
        "displacement": sensor.gap - gap,
    }
    variables = {f"{name}{suffix}": ("time", v, {"units": unit_of(name)}) for name, v in channels.items()}
    time = ("time", np.arange(elapsed.size) / rate, {"units": "s"})
    return xr.Dataset(variables, {"time": time}, {"sample_rate": rate})
